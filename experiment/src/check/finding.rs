//! Something about a scenario that is wrong, or worth knowing.

use serde::Serialize;

use crate::scenario::diagnostic::Severity;

/// No finding names more robots than this.
pub(super) const NAMES_MAX: usize = 6;

/// Something about a scenario that is wrong, or worth knowing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Whether it can be run all the same.
    pub severity: Severity,
    /// What is wrong, with the offending values.
    pub message: String,
    /// What was expected instead.
    pub expected: String,
    /// The key that says so, as in `avoidance.kind`, `robot.r1.pose` or `edge.0.offset_m`.
    pub path: String,
}

pub(super) fn error(
    path: impl Into<String>,
    message: String,
    expected: impl Into<String>,
) -> Finding {
    Finding { severity: Severity::Error, message, expected: expected.into(), path: path.into() }
}

pub(super) fn warning(
    path: impl Into<String>,
    message: String,
    expected: impl Into<String>,
) -> Finding {
    Finding { severity: Severity::Warning, ..error(path, message, expected) }
}
