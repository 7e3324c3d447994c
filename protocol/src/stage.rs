//! What is measured of delays, and why something was late: the words, and their numbers on the wire.

use serde::{Deserialize, Serialize};

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Stage {
    /// Real time: from a timer's deadline to the return of the wait for it; but see [`Stage::Held`].
    Wake = 0,
    /// From the sending of odometry to its taking by the agent.
    Odometry = 1,
    /// From the taking of odometry to the sending of the answer.
    Compute = 2,
    /// Sensor to actuator, at the plant. Real time: from the odometry's stamp to the taking of the
    /// command that answers it. Lockstep, where stamps are simulated: from the odometry's sending.
    Command = 3,
    /// Age of a neighbour's newest beacon when an answer used it, by stamps. In lockstep it is
    /// simulated time. Lost neighbours are not used: see [`crate::age`] for the age at every instant.
    BeaconAge = 4,
    /// Real time: from the sending of a beacon to its taking.
    BeaconDelivery = 5,
    /// The same as [`Stage::Wake`] where it was no fault of the machine: the robot was frozen on
    /// purpose past the deadline, or slow on purpose.
    Held = 6,
    /// The same as [`Stage::Wake`] of a process with the robots' timer and nothing else: what the
    /// machine did to anybody.
    Machine = 7,
    /// How late a wake-up or an answer was that was late by this [`Cause`]: its own work.
    LateWork = 8,
    /// The same: it waited for a core.
    LateCore = 9,
    /// The same: page faults.
    LateFaults = 10,
    /// The same: the host of this virtual machine ran somebody else.
    LateHost = 11,
    /// The same: nothing that is counted explains it.
    LateUnknown = 12,
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
            Cause::Unknown => "unknown",
        }
    }
}

impl Stage {
    /// All of them, in the order of their numbers.
    pub const ALL: [Stage; 13] = [
        Stage::Wake,
        Stage::Odometry,
        Stage::Compute,
        Stage::Command,
        Stage::BeaconAge,
        Stage::BeaconDelivery,
        Stage::Held,
        Stage::Machine,
        Stage::LateWork,
        Stage::LateCore,
        Stage::LateFaults,
        Stage::LateHost,
        Stage::LateUnknown,
    ];

    /// The stage that a number in a [`LatencyRow`](crate::message::LatencyRow) stands for.
    pub fn from_number(number: u32) -> Option<Stage> {
        Stage::ALL.get(number as usize).copied()
    }

    /// The word for it in files.
    pub fn word(self) -> &'static str {
        match self {
            Stage::Wake => "wake",
            Stage::Odometry => "odometry",
            Stage::Compute => "compute",
            Stage::Command => "command",
            Stage::BeaconAge => "beacon_age",
            Stage::BeaconDelivery => "beacon_delivery",
            Stage::Held => "held",
            Stage::Machine => "machine",
            Stage::LateWork => "late_work",
            Stage::LateCore => "late_core",
            Stage::LateFaults => "late_faults",
            Stage::LateHost => "late_host",
            Stage::LateUnknown => "late_unknown",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_survives_the_wire() {
        for stage in Stage::ALL {
            assert_eq!(Stage::from_number(stage as u32), Some(stage));
        }
        assert_eq!(Stage::from_number(Stage::ALL.len() as u32), None);
    }

    #[test]
    fn every_cause_has_a_stage_of_its_own() {
        let stages = Cause::ALL.map(Cause::stage);
        for (place, stage) in stages.iter().enumerate() {
            assert!(!stages[..place].contains(stage), "{stage:?}");
            assert!(stage.word().starts_with("late_"));
        }
    }
}
