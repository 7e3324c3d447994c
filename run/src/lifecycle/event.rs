//! Events of a run, and the effects that follow from them: orders for the driver, and records.

use outcome::metrics::fault::FaultEnd;

/// Initiator of an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Initiator {
    /// The scenario, which plans the action.
    Plan,
    /// A client of the live view.
    LiveViewClient,
    /// A process outside of the run, which sent the signal itself.
    OtherProcess,
}

impl Initiator {
    /// Returns the word for `events.csv`.
    pub fn keyword(self) -> &'static str {
        match self {
            Initiator::Plan => "as planned",
            Initiator::LiveViewClient => "by hand",
            Initiator::OtherProcess => "by another process",
        }
    }
}

/// Event of a run: planned, or reported by the driver. Faults are identified by their numbers in the report.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum LifecycleEvent {
    /// SIGKILL on purpose, and the run time of a replacement, ns.
    Kill { robot: usize, fault: usize, restart_at_ns: Option<u64>, initiator: Initiator },
    /// SIGSTOP. `has_planned_thaw` is whether a thaw is planned.
    Freeze { robot: usize, fault: usize, has_planned_thaw: bool, initiator: Initiator },
    /// SIGCONT after a freeze.
    Thaw { robot: usize, fault: usize, initiator: Initiator },
    /// Planned SIGKILL of the plant.
    KillPlant { fault: usize },
    /// The plant's process was stopped.
    PlantStopped { fault: usize, initiator: Initiator },
    /// The plant's process was resumed.
    PlantResumed { fault: usize, initiator: Initiator },
    /// Planned start of `processes` load processes.
    StartLoad { fault: usize, processes: usize },
    /// Load processes were started. `detail` is their number as text.
    LoadStarted { fault: usize, detail: String },
    /// Planned end of the load processes of a fault.
    EndLoad { fault: usize },
    /// Interactive restart of a dead robot.
    Restart { robot: usize },
    /// Interactive cut of a link.
    CutLink { edge: usize, fault: usize },
    /// Interactive repair of a link that was cut interactively.
    RepairLink { edge: usize },
    /// The process of a robot is dead and reaped.
    ProcessDied(ProcessDeath),
    /// The stale resources of a dead process of the robot are removed.
    CleanedUp { robot: usize },
    /// The process of a robot reported its status. `takes_part` is whether the robot takes part.
    StatusReported { robot: usize, takes_part: bool },
    /// The host of the robot is unreachable.
    HostUnreachable { robot: usize, fault: usize, reason: String },
    /// The host of the robot is reachable again.
    HostReachable { robot: usize, reason: String },
    /// Time has passed: due processes may be started.
    TimePassed,
}

/// Exit of a robot's process.
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessDeath {
    /// Index of the robot.
    pub robot: usize,
    /// Cause, as text.
    pub cause: String,
    /// Whether the process exited with code 0.
    pub exited_successfully: bool,
    /// Whether the process exited with code 4, an infrastructure failure: the agent failed, not the control law.
    pub is_infrastructure_failure: bool,
    /// Whether no robot had moved yet.
    pub is_before_motion: bool,
    /// Run time at which the process was last seen alive, ns.
    pub last_seen_alive_ns: u64,
    /// Number of the fault under which an unplanned death is reported.
    pub fault: usize,
}

/// Effect of an event.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Order for the driver.
    Order(DriverOrder),
    /// Record of the run.
    Record(RunRecord),
}

/// Order for the driver of a run. Orders are executed in the order in which they are returned.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum DriverOrder {
    /// Start a process.
    Start { robot: usize, incarnation: u64 },
    /// Send SIGKILL to the process of a robot.
    Kill(usize),
    /// Send SIGSTOP to the process of a robot.
    Stop(usize),
    /// Send SIGCONT to the process of a robot.
    Resume(usize),
    /// Make the plant wait for a robot.
    JoinBarrier(usize),
    /// Make the plant no longer wait for a robot.
    LeaveBarrier(usize),
    /// Remove the stale resources of a robot's dead process.
    CleanUp(usize),
    /// Send a robot the list of its in-links that are cut interactively.
    SendCutLinks(usize),
    /// Send SIGKILL to the plant.
    KillPlant,
    /// Start `processes` load processes for a fault, and report [`LifecycleEvent::LoadStarted`].
    StartLoad { fault: usize, processes: usize },
    /// Kill the load processes of a fault.
    EndLoad { fault: usize },
    /// Warn of an unplanned death. `is_replacement` is whether the process was a replacement, and died before the end
    /// of the fault that killed its predecessor.
    WarnOfDeath { robot: usize, cause: String, is_replacement: bool },
    /// End the run: a robot gave up and will not be replaced.
    EndRun { robot: usize, cause: String },
}

/// Record of a run, for its events and its metrics.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum RunRecord {
    /// Line of the events, of a robot or of the whole run.
    Note { kind: &'static str, robot: Option<usize>, detail: String },
    /// Beginning of a numbered fault, now.
    FaultBegan(usize),
    /// Unplanned death, which is a fault that began at that run time, ns.
    UnplannedDeath { robot: usize, cause: String, at_ns: u64, fault: usize },
    /// End of a fault at that run time, ns.
    FaultEnded { fault: usize, end: FaultEnd, at_ns: u64 },
}
