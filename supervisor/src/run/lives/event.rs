//! What may happen to a robot's process, and what is to be done about it.

use outcome::metrics::fault::End;

/// On whose account something is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Who {
    /// The scenario's.
    Plan,
    /// Somebody's, through the live view.
    Hand,
    /// Somebody's who sent a signal to the process. It is done already.
    Outside,
}

impl Who {
    /// How it is written down.
    pub fn word(self) -> &'static str {
        match self {
            Who::Plan => "as planned",
            Who::Hand => "by hand",
            Who::Outside => "by somebody else",
        }
    }
}

/// What happens to a robot, or is done to it on purpose. Faults go by their numbers in the report.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum Event {
    /// SIGKILL on purpose; a replacement at that run time, ns.
    Kill { robot: usize, fault: usize, restart_at_ns: Option<u64>, who: Who },
    /// SIGSTOP. `ends`: a thaw is planned for it.
    Freeze { robot: usize, fault: usize, ends: bool, who: Who },
    /// SIGCONT.
    Thaw { robot: usize, fault: usize, who: Who },
    /// Somebody wants a dead robot back.
    Restart { robot: usize },
    /// Somebody cuts a link.
    Cut { edge: usize, fault: usize },
    /// Somebody mends a link that was cut so.
    Mend { edge: usize },
    /// Its process is dead and reaped.
    Died(Death),
    /// What a dead process of it left is removed.
    Cleaned { robot: usize },
    /// Its process reported; whether it takes part by now.
    Reported { robot: usize, takes_part: bool },
    /// Its host is not heard any more.
    Unreachable { robot: usize, fault: usize, why: String },
    /// Its host is heard again.
    Reachable { robot: usize, why: String },
    /// Whatever is due may be started.
    Due,
}

/// How a robot's process ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Death {
    /// Whose.
    pub robot: usize,
    /// In words.
    pub how: String,
    /// With exit code 0.
    pub success: bool,
    /// With the exit code for a failed infrastructure (4): the agent, not the law, could not go on.
    pub gave_up: bool,
    /// Nobody had moved yet.
    pub starting_up: bool,
    /// Run time at which it was last seen alive, ns.
    pub alive_ns: u64,
    /// The number of the fault that it is, if nobody had planned it.
    pub fault: usize,
}

/// What is to be done, in this order.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum Effect {
    /// A process is started.
    Start { robot: usize, incarnation: u64 },
    /// SIGKILL.
    Kill(usize),
    /// SIGSTOP.
    Stop(usize),
    /// SIGCONT.
    GoOn(usize),
    /// The plant waits for it from now on.
    Join(usize),
    /// The plant waits for it no more.
    Leave(usize),
    /// What its process left is to be removed.
    CleanUp(usize),
    /// It is told which of its links are cut by hand.
    TellLinks(usize),
    /// A line of the events.
    Note { kind: &'static str, robot: usize, detail: String },
    /// A fault with a number began now.
    Began(usize),
    /// A death that nobody had planned is a fault, which began at that run time, ns.
    DiedUnplanned { robot: usize, how: String, at_ns: u64, fault: usize },
    /// A replacement died before the fault was over by which its predecessor died.
    DiedAgain { robot: usize, how: String },
    /// A fault ended at that run time, ns.
    Ended { fault: usize, end: End, at_ns: u64 },
    /// A robot gave up, and nobody will replace it: the run cannot go on.
    GaveUp { robot: usize, how: String },
}
