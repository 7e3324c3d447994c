//! What must hold for exit code 0: `[expect]`.

use super::diagnostic::Diagnostic;
use super::table::Table;
use super::{Expectations, seconds};

const EXPECT_KEYS: &[&str] = &[
    "min_distance_m",
    "final_error_m_max",
    "tracking_error_m_max",
    "hull_distance_m_max",
    "converged_by_s",
    "recovered_within_s",
    "deadline_misses_max",
    "exit",
    "converged_error_m",
];

/// `[expect]`.
pub(super) fn expect(root: &Table<'_>, duration_ns: u64) -> Result<Expectations, Diagnostic> {
    let table = root.get("expect").map(|value| value.table(EXPECT_KEYS)).transpose()?;
    let get = |key: &str| table.as_ref().and_then(|table| table.get(key));
    let positive = |key: &str, unit: &str| get(key).map(|v| v.positive(unit)).transpose();
    let converged_by_s = positive("converged_by_s", "s")?;
    if let (Some(by_s), Some(value)) = (converged_by_s, get("converged_by_s"))
        && by_s > seconds(duration_ns)
    {
        return Err(value.wrong(
            format!("is {by_s}, when the run is over"),
            format!("expected at most `duration_s`, {} s", seconds(duration_ns)),
        ));
    }
    Ok(Expectations {
        min_distance_m: positive("min_distance_m", "m")?,
        final_error_m_max: positive("final_error_m_max", "m")?,
        tracking_error_m_max: positive("tracking_error_m_max", "m")?,
        hull_distance_m_max: get("hull_distance_m_max").map(|v| v.not_negative("m")).transpose()?,
        converged_by_s,
        recovered_within_s: positive("recovered_within_s", "s")?,
        deadline_misses_max: get("deadline_misses_max")
            .map(|value| value.integer(0, i64::MAX as u64))
            .transpose()?,
        exit: get("exit").map(|value| value.integer(0, 255)).transpose()?.map(|code| code as u8),
        converged_error_m: positive("converged_error_m", "m")?.unwrap_or(0.01),
    })
}
