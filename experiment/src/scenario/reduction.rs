//! Reductions of recorded values to one number: over time, and over robots.

use serde::Deserialize;

/// Reduction of the values that one robot recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeReduction {
    /// Value that was recorded last.
    Last,
    /// Mean of all values.
    Mean,
    /// Smallest value.
    Min,
    /// Largest value.
    Max,
    /// Sum of all values.
    Sum,
}

/// Reduction of the values of the robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RobotReduction {
    /// Largest value.
    Max,
    /// Smallest value.
    Min,
    /// Mean of the values.
    Mean,
    /// Sum of the values.
    Sum,
}
