//! Error or warning about a scenario.

use serde::Serialize;

use crate::scenario::diagnostic::Severity;

/// Maximum number of robots that a finding names.
pub(super) const NAMES_MAX: usize = 6;

/// Error or warning about a scenario.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Severity: with an error the scenario cannot be run.
    pub severity: Severity,
    /// Problem, with the found values.
    pub message: String,
    /// Allowed values or remedy.
    pub expected: String,
    /// Path of the key that causes it, such as `avoidance.kind`, `robot.r1.pose` or `edge.0.offset_m`.
    pub path: String,
}

pub(super) fn error_finding(
    path: impl Into<String>,
    message: String,
    expected: impl Into<String>,
) -> Finding {
    Finding { severity: Severity::Error, message, expected: expected.into(), path: path.into() }
}

pub(super) fn warning_finding(
    path: impl Into<String>,
    message: String,
    expected: impl Into<String>,
) -> Finding {
    Finding { severity: Severity::Warning, ..error_finding(path, message, expected) }
}
