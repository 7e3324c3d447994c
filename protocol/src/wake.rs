//! When processes wake up: a phase for each robot, and what is known of one wake-up.

/// One wake-up of a process's timer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wake {
    /// The deadline waited for, ns.
    pub due_ns: u64,
    /// How long after it the wait returned, ns.
    pub lateness_ns: u64,
}

/// A phase in [0, 1) of its own for the robot with this place in the scenario: multiples of the
/// golden ratio's fractional part spread evenly, however many robots there are.
pub fn golden_phase(index: usize) -> f64 {
    (0.618_033_988_7 * index as f64).fract()
}
