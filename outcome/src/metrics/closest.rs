//! Two robots, how near they were, and when.

/// Two robots at their nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Closest {
    /// |alpha_i - alpha_j|, m.
    pub(super) distance_m: f64,
    /// Their places, the smaller one first.
    pub(super) pair: [usize; 2],
    /// When, ns.
    pub(super) t_ns: u64,
}
