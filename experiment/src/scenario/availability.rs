//! Consistency of planned faults: which robots are alive and not frozen when a fault starts.

use super::{Fault, FaultKind, ns_to_seconds};

/// Robots that are alive and not frozen after the faults recorded so far.
pub(super) struct Availability {
    /// For each robot, the time at which it is restarted after its latest kill, ns. `None`: never.
    dead_until_ns: Vec<Option<u64>>,
    /// For each robot, the end of its latest freeze, ns.
    frozen_until_ns: Vec<u64>,
}

/// Reason why a fault is impossible.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ImpossibleFault {
    /// The robot is dead at that time, until `until_ns`.
    RobotDead { robot: usize, until_ns: Option<u64> },
    /// The robot is frozen at that time, until `until_ns`.
    RobotFrozen { robot: usize, until_ns: u64 },
}

impl ImpossibleFault {
    /// Returns the reason and the remedy as text.
    pub(super) fn describe<'n>(self, name: impl Fn(usize) -> &'n str) -> (String, String) {
        let (robot, state, expected) = match self {
            ImpossibleFault::RobotDead { robot, until_ns: Some(until_ns) } => {
                let (until_s, name) = (ns_to_seconds(until_ns), name(robot));
                (
                    robot,
                    "dead",
                    format!("expected more than {until_s} s, when {name} is started again"),
                )
            }
            ImpossibleFault::RobotDead { robot, until_ns: None } => {
                let kill = format!("the kill of {} before this one", name(robot));
                (robot, "dead", format!("expected `restart_after_s` in {kill}"))
            }
            ImpossibleFault::RobotFrozen { robot, until_ns } => {
                let (until_s, name) = (ns_to_seconds(until_ns), name(robot));
                (robot, "frozen", format!("expected at least {until_s} s, when {name} is resumed"))
            }
        };
        (format!("{} is {state} already", name(robot)), expected)
    }
}

impl Availability {
    pub(super) fn new(robots: usize) -> Availability {
        Availability { dead_until_ns: vec![Some(0); robots], frozen_until_ns: vec![0; robots] }
    }

    /// Returns the robots that are neither dead nor frozen at `time_ns`.
    pub(super) fn available_robots(&self, time_ns: u64) -> Vec<usize> {
        (0..self.frozen_until_ns.len())
            .filter(|&robot| !self.is_dead_or_frozen(robot, time_ns))
            .collect()
    }

    /// Returns whether the robot is dead or frozen at `time_ns`.
    fn is_dead_or_frozen(&self, robot: usize, time_ns: u64) -> bool {
        self.is_dead(robot, time_ns) || self.frozen_until_ns[robot] > time_ns
    }

    fn is_dead(&self, robot: usize, time_ns: u64) -> bool {
        self.dead_until_ns[robot].is_none_or(|until_ns| until_ns >= time_ns && until_ns > 0)
    }

    /// Records a fault, which must not start before those recorded earlier. Returns an error if its robot is dead or
    /// frozen.
    pub(super) fn record_fault(&mut self, fault: &Fault) -> Result<(), ImpossibleFault> {
        let start_ns = fault.start_ns;
        match fault.kind {
            FaultKind::Kill { robot, .. } | FaultKind::Freeze { robot }
                if self.is_dead(robot, start_ns) =>
            {
                return Err(ImpossibleFault::RobotDead {
                    robot,
                    until_ns: self.dead_until_ns[robot],
                });
            }
            FaultKind::Kill { robot, restart_after_ns } => {
                self.dead_until_ns[robot] = restart_after_ns.map(|after_ns| start_ns + after_ns);
                self.frozen_until_ns[robot] = 0;
            }
            FaultKind::Freeze { robot } => {
                let until_ns = self.frozen_until_ns[robot];
                if until_ns > start_ns {
                    return Err(ImpossibleFault::RobotFrozen { robot, until_ns });
                }
                self.frozen_until_ns[robot] = fault.end_ns().unwrap_or(u64::MAX);
            }
            _ => {}
        }
        Ok(())
    }
}
