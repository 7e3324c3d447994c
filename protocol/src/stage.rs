//! What is measured of delays, and why something was late: the words, and their numbers on the wire.

use serde::{Deserialize, Serialize};

numbered! {
    /// What is measured.
    Stage: u32 {
        /// Real time: from a timer's deadline to the return of the wait for it; but see [`Stage::Held`].
        Wake = 0 "wake",
        /// From the sending of odometry to its taking by the agent.
        Odometry = 1 "odometry",
        /// From the taking of odometry to the sending of the answer.
        Compute = 2 "compute",
        /// Sensor to actuator, at the plant. Real time: from the odometry's stamp to the taking of the
        /// command that answers it. Lockstep, where stamps are simulated: from the odometry's sending.
        Command = 3 "command",
        /// Age of a neighbour's newest beacon when an answer used it, by stamps. In lockstep it is
        /// simulated time. Lost neighbours are not used: see [`crate::age`] for the age at every instant.
        BeaconAge = 4 "beacon_age",
        /// Real time: from the sending of a beacon to its taking.
        BeaconDelivery = 5 "beacon_delivery",
        /// The same as [`Stage::Wake`] where it was no fault of the machine: the robot was frozen on
        /// purpose past the deadline, or slow on purpose.
        Held = 6 "held",
        /// The same as [`Stage::Wake`] of a process with the robots' timer and nothing else: what the
        /// machine did to anybody.
        Machine = 7 "machine",
        /// How late a wake-up or an answer was that was late by this [`Cause`]: its own work.
        LateWork = 8 "late_work",
        /// The same: it waited for a core.
        LateCore = 9 "late_core",
        /// The same: page faults.
        LateFaults = 10 "late_faults",
        /// The same: the host of this virtual machine ran somebody else.
        LateHost = 11 "late_host",
        /// The same: nothing that is counted explains it.
        LateUnknown = 12 "late_unknown",
    }
}

/// Why something was late.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Cause {
    /// The robot's own work took longer than its period.
    Work,
    /// It was ready to run, and others ran.
    Core,
    /// Memory had to be mapped, or read from a disk.
    Faults,
    /// The host of this virtual machine ran somebody else.
    Host,
    /// Nothing that is counted explains it.
    Unknown,
}

impl Cause {
    /// All of them.
    pub const ALL: [Cause; 5] =
        [Cause::Work, Cause::Core, Cause::Faults, Cause::Host, Cause::Unknown];

    /// The stage of what was late by it.
    pub fn stage(self) -> Stage {
        match self {
            Cause::Work => Stage::LateWork,
            Cause::Core => Stage::LateCore,
            Cause::Faults => Stage::LateFaults,
            Cause::Host => Stage::LateHost,
            Cause::Unknown => Stage::LateUnknown,
        }
    }

    /// The cause in words.
    pub fn words(self) -> &'static str {
        match self {
            Cause::Work => "own work",
            Cause::Core => "waited for a core",
            Cause::Faults => "page faults",
            Cause::Host => "the host took the core",
            Cause::Unknown => "no cause found",
        }
    }
}
