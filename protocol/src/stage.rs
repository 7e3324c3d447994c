//! Measured latencies and causes of lateness, with their numbers on the wire.

use serde::{Deserialize, Serialize};

wire_enum! {
    /// A measured quantity.
    Stage: u32 {
        /// Wake-up latency (real time): from a timer's deadline to the return of the wait; see also
        /// [`Stage::PlannedDelay`].
        Wake = 0 "wake",
        /// Time from the sending of odometry to its reception by the agent.
        Odometry = 1 "odometry",
        /// Time from the reception of odometry to the sending of the command.
        Compute = 2 "compute",
        /// Sensor-to-actuator latency at the plant. Real time: from the stamp of the odometry to the reception of
        /// the command that answers it. Lockstep, where stamps are simulated: from the sending of the odometry.
        Command = 3 "command",
        /// Age of a neighbor's newest beacon when a command used it, by stamps; simulated time in lockstep. Lost
        /// neighbors are not used: see [`crate::age`] for the age at every instant.
        BeaconAge = 4 "beacon_age",
        /// Time from the sending of a beacon to its reception (real time).
        BeaconDelivery = 5 "beacon_delivery",
        /// Wake-up latency that is no fault of the machine: a planned freeze or slowdown lasted past the
        /// deadline.
        PlannedDelay = 6 "held",
        /// Wake-up latency of a process that only waits on a timer with the robots' period: the baseline of the
        /// machine.
        Machine = 7 "machine",
        /// Lateness of a wake-up or command caused by the robot's own computation ([`LatenessCause::Work`]).
        LateWork = 8 "late_work",
        /// Lateness of a wake-up or command that waited for a CPU core ([`LatenessCause::Core`]).
        LateCore = 9 "late_core",
        /// Lateness of a wake-up or command caused by page faults ([`LatenessCause::PageFaults`]).
        LateFaults = 10 "late_faults",
        /// Lateness of a wake-up or command caused by steal time of the virtual machine ([`LatenessCause::Host`]).
        LateHost = 11 "late_host",
        /// Lateness of a wake-up or command that no counter explains ([`LatenessCause::Unknown`]).
        LateUnknown = 12 "late_unknown",
    }
}

/// Cause of a late wake-up or command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum LatenessCause {
    /// The robot's own computation took longer than its period.
    Work,
    /// Run-queue delay: other threads ran while it was ready to run.
    Core,
    /// Page faults: memory had to be mapped, or read from a disk.
    PageFaults,
    /// Steal time: the host of this virtual machine ran another guest or process.
    Host,
    /// Unknown cause, which no counter explains.
    Unknown,
}

impl LatenessCause {
    /// All causes, in the order of their stages.
    pub const ALL: [LatenessCause; 5] = [
        LatenessCause::Work,
        LatenessCause::Core,
        LatenessCause::PageFaults,
        LatenessCause::Host,
        LatenessCause::Unknown,
    ];

    /// Returns the stage under which lateness by this cause is recorded.
    pub fn stage(self) -> Stage {
        match self {
            LatenessCause::Work => Stage::LateWork,
            LatenessCause::Core => Stage::LateCore,
            LatenessCause::PageFaults => Stage::LateFaults,
            LatenessCause::Host => Stage::LateHost,
            LatenessCause::Unknown => Stage::LateUnknown,
        }
    }

    /// Returns the cause as text.
    pub fn text(self) -> &'static str {
        match self {
            LatenessCause::Work => "own work",
            LatenessCause::Core => "waited for a core",
            LatenessCause::PageFaults => "page faults",
            LatenessCause::Host => "the host took the core",
            LatenessCause::Unknown => "no cause found",
        }
    }
}
