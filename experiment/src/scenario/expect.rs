//! Acceptance criteria: `[expect]`.

use super::diagnostic::Diagnostic;
use super::fields::kinds;
use super::keys;
use super::metrics::{Metric, parse_metric_bounds};
use super::robots::parse_robot_index;
use super::table::{TableReader, TypedValue};
use super::{AliveAtEnd, Expectations, Robot, Wall, ns_to_seconds};

/// Parses `[expect]`.
pub(super) fn parse_expectations(
    root: &TableReader<'_, keys::Root>,
    robots: &[Robot],
    walls: &[Wall],
    metrics: &[Metric],
    duration_ns: u64,
) -> Result<Expectations, Diagnostic> {
    let table = root.table(keys::Root::expect)?;
    let number = |key| table.optional_number(key);
    let integer = |key| table.get(key).map(|value| value.integer()).transpose();
    let converged_by_s = table.optional_number(keys::Expect::converged_by_s)?;
    if let (Some(by_s), Some(value)) = (converged_by_s, table.get(keys::Expect::converged_by_s))
        && by_s > ns_to_seconds(duration_ns)
    {
        return Err(value.error_about_key(
            format!("is {by_s}, when the run is over"),
            format!(
                "expected at most `duration_s`, {} s; `--set expect={{}}` runs it without expectations",
                ns_to_seconds(duration_ns)
            ),
        ));
    }
    if let Some(clearance) = table.get(keys::Expect::min_clearance_m).filter(|_| walls.is_empty()) {
        return Err(clearance.error_about_key(
            "is set, but there is no wall",
            "expected a `[[wall]]` or an `[[obstacle]]`, or no such key",
        ));
    }
    Ok(Expectations {
        min_distance_m: number(keys::Expect::min_distance_m)?,
        min_distance_over_d: number(keys::Expect::min_distance_over_d)?,
        min_clearance_m: number(keys::Expect::min_clearance_m)?,
        final_error_m_max: number(keys::Expect::final_error_m_max)?,
        final_ideal_error_m_max: number(keys::Expect::final_ideal_error_m_max)?,
        tracking_error_m_max: number(keys::Expect::tracking_error_m_max)?,
        hull_distance_m_max: number(keys::Expect::hull_distance_m_max)?,
        converged_by_s,
        recovered_within_s: number(keys::Expect::recovered_within_s)?,
        alive_at_end: table
            .get(keys::Expect::alive_at_end)
            .map(|value| parse_alive_at_end(&value, robots))
            .transpose()?,
        deadline_misses_max: integer(keys::Expect::deadline_misses_max)?,
        exit_code: integer(keys::Expect::exit)?.map(|code| code as u8),
        metrics: parse_metric_bounds(&table, metrics)?,
        converged_error_m: table.number(keys::Expect::converged_error_m)?,
    })
}

/// Parses `alive_at_end`: names of robots, or their number.
fn parse_alive_at_end(
    value: &TypedValue<'_, kinds::NamesOrCount>,
    robots: &[Robot],
) -> Result<AliveAtEnd, Diagnostic> {
    if !value.is_list() {
        let count = value.count()?;
        if count > robots.len() as u64 {
            let expected = format!("expected at most {}, all robots", robots.len());
            return Err(value.error_about_key(format!("is {count}"), expected));
        }
        return Ok(AliveAtEnd::Count(count));
    }
    let mut names = Vec::new();
    for name in value.elements("expected names of robots, or how many")? {
        let robot = parse_robot_index(&name, robots)?;
        if names.contains(&robot) {
            return Err(name.error_about_key("names a robot twice", "expected each robot once"));
        }
        names.push(robot);
    }
    Ok(AliveAtEnd::Robots(names))
}
