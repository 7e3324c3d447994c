//! What must hold for exit code 0: `[expect]`.

use super::diagnostic::Diagnostic;
use super::table::Table;
use super::{Expectations, seconds};

/// `[expect]`.
pub(super) fn expect(root: &Table<'_>, duration_ns: u64) -> Result<Expectations, Diagnostic> {
    let table = root.table("expect")?;
    let whole = |key: &str| table.get(key).map(|value| value.whole()).transpose();
    let converged_by_s = table.maybe_number("converged_by_s")?;
    if let (Some(by_s), Some(value)) = (converged_by_s, table.get("converged_by_s"))
        && by_s > seconds(duration_ns)
    {
        return Err(value.wrong(
            format!("is {by_s}, when the run is over"),
            format!("expected at most `duration_s`, {} s", seconds(duration_ns)),
        ));
    }
    Ok(Expectations {
        min_distance_m: table.maybe_number("min_distance_m")?,
        final_error_m_max: table.maybe_number("final_error_m_max")?,
        final_ideal_error_m_max: table.maybe_number("final_ideal_error_m_max")?,
        tracking_error_m_max: table.maybe_number("tracking_error_m_max")?,
        hull_distance_m_max: table.maybe_number("hull_distance_m_max")?,
        converged_by_s,
        recovered_within_s: table.maybe_number("recovered_within_s")?,
        deadline_misses_max: whole("deadline_misses_max")?,
        exit: whole("exit")?.map(|code| code as u8),
        converged_error_m: table.number("converged_error_m")?,
    })
}
