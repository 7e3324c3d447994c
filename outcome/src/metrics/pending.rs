//! Values that robots reported with their samples. A report may be newer than the ground truth that was read: a value
//! counts once a ground-truth sample after its own is known, so that results do not depend on when a report arrives.

use std::collections::VecDeque;

/// Values that later ground-truth samples will count, robot by robot.
pub(crate) struct PendingValues<T> {
    /// Values of each robot with the run time of their samples, ns, oldest first.
    queues: Vec<VecDeque<(u64, T)>>,
}

impl<T> PendingValues<T> {
    /// Creates the state without any value.
    pub(crate) fn new(robots: usize) -> PendingValues<T> {
        PendingValues { queues: (0..robots).map(|_| VecDeque::new()).collect() }
    }

    /// Adds the value that a robot reported with its sample of run time `t_ns`, ns.
    pub(crate) fn push(&mut self, robot: usize, t_ns: u64, value: T) {
        self.queues[robot].push_back((t_ns, value));
    }

    /// Removes all values of samples before run time `t_ns`, ns, and passes each to `take`, with the index of its robot
    /// and the run time of its sample, ns: robot by robot, oldest first.
    pub(crate) fn take_before(&mut self, t_ns: u64, mut take: impl FnMut(usize, u64, T)) {
        for (robot, queue) in self.queues.iter_mut().enumerate() {
            // Most queues have no such value.
            while queue.front().is_some_and(|(at_ns, _)| *at_ns < t_ns) {
                queue.pop_front().into_iter().for_each(|(at_ns, value)| take(robot, at_ns, value));
            }
        }
    }
}
