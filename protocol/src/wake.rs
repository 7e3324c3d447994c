//! Wake-ups of processes: the timer phase of each robot, and one measured wake-up.

/// One wake-up of a process's timer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WakeUp {
    /// Deadline of the wait, ns.
    pub due_ns: u64,
    /// Wake-up latency: time from the deadline to the return of the wait, ns.
    pub lateness_ns: u64,
}

/// Returns the timer phase in [0, 1) of the robot with this scenario index. Multiples of the fractional part of
/// the golden ratio are spread evenly, for any number of robots.
pub fn golden_phase(index: usize) -> f64 {
    (0.618_033_988_7 * index as f64).fract()
}
