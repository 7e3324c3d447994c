//! Acceptance criteria: `[expect]`.

use super::diagnostic::Diagnostic;
use super::robots::robot_named;
use super::table::{Table, Value};
use super::{AliveAtEnd, Expectations, Robot, Wall, seconds};

/// Parses `[expect]`.
pub(super) fn expect(
    root: &Table<'_>,
    robots: &[Robot],
    walls: &[Wall],
    duration_ns: u64,
) -> Result<Expectations, Diagnostic> {
    let table = root.table("expect")?;
    let number = |key| table.maybe_number(key);
    let whole = |key: &str| table.get(key).map(|value| value.whole()).transpose();
    let converged_by_s = table.maybe_number("converged_by_s")?;
    if let (Some(by_s), Some(value)) = (converged_by_s, table.get("converged_by_s"))
        && by_s > seconds(duration_ns)
    {
        return Err(value.wrong(
            format!("is {by_s}, when the run is over"),
            format!(
                "expected at most `duration_s`, {} s; `--set expect={{}}` runs it without expectations",
                seconds(duration_ns)
            ),
        ));
    }
    if let Some(clearance) = table.get("min_clearance_m").filter(|_| walls.is_empty()) {
        return Err(clearance.wrong(
            "is set, but there is no wall",
            "expected a `[[wall]]` or an `[[obstacle]]`, or no such key",
        ));
    }
    Ok(Expectations {
        min_distance_m: number("min_distance_m")?,
        min_clearance_m: number("min_clearance_m")?,
        final_error_m_max: number("final_error_m_max")?,
        final_ideal_error_m_max: number("final_ideal_error_m_max")?,
        tracking_error_m_max: number("tracking_error_m_max")?,
        hull_distance_m_max: number("hull_distance_m_max")?,
        converged_by_s,
        recovered_within_s: number("recovered_within_s")?,
        alive_at_end: table.get("alive_at_end").map(|value| alive(&value, robots)).transpose()?,
        deadline_misses_max: whole("deadline_misses_max")?,
        exit: whole("exit")?.map(|code| code as u8),
        converged_error_m: table.number("converged_error_m")?,
    })
}

/// Parses `alive_at_end`: names of robots, or their number.
fn alive(value: &Value<'_>, robots: &[Robot]) -> Result<AliveAtEnd, Diagnostic> {
    if !value.is_list() {
        let count = value.whole()?;
        if count > robots.len() as u64 {
            let expected = format!("expected at most {}, all robots", robots.len());
            return Err(value.wrong(format!("is {count}"), expected));
        }
        return Ok(AliveAtEnd::Count(count));
    }
    let mut names = Vec::new();
    for name in value.elements("expected names of robots, or how many")? {
        let robot = robot_named(&name, robots)?;
        if names.contains(&robot) {
            return Err(name.wrong("names a robot twice", "expected each robot once"));
        }
        names.push(robot);
    }
    Ok(AliveAtEnd::Names(names))
}
