//! Time-varying scale of the formation: `[scale]`.

use formation::ns_to_seconds;
use formation::scale::Scale;
use protocol::law::Reference;

use super::Scenario;
use super::diagnostic::Diagnostic;
use super::fields::kinds;
use super::keys;
use super::table::{TableReader, TypedValue};
use crate::check::Opening;

/// Parses `[scale]`. `scenario` is complete except for the scale. `None`: constant 1.
pub(super) fn parse_scale(
    root: &TableReader<'_, keys::Root>,
    scenario: &Scenario,
) -> Result<Option<Scale>, Diagnostic> {
    let Some(value) = root.get(keys::Root::scale) else { return Ok(None) };
    let keeps_slot = |robot: &super::Robot| robot.role.reference == Reference::Offsets;
    if scenario.lead.is_none() && !scenario.robots.iter().any(keeps_slot) {
        return Err(value.error_about_key(
            "is given, but no robot leads or keeps a slot",
            "expected a robot with a law of a leader or of a formation",
        ));
    }
    let table = value.table()?;
    match table.kind()? {
        "sine" => parse_sine_scale(&table),
        _ => parse_closing_scale(&table, &value, scenario),
    }
    .map(Some)
}

/// Parses an oscillating scale, which must stay above 0.
fn parse_sine_scale(table: &TableReader<'_, keys::Scale>) -> Result<Scale, Diagnostic> {
    let mean = table.number(keys::Scale::mean)?;
    let Some(amplitude) = table.get(keys::Scale::amplitude) else {
        return Ok(Scale::Sine { mean, amplitude: 0.0, period_s: 1.0 });
    };
    let amplitude_value = amplitude.number()?;
    if amplitude_value >= mean {
        return Err(amplitude.error_about_key(
            format!("is {amplitude_value}: the formation would shrink to a point"),
            format!("expected less than `mean`, {mean}"),
        ));
    }
    Ok(Scale::Sine {
        mean,
        amplitude: amplitude_value,
        period_s: table.number(keys::Scale::period_s)?,
    })
}

/// Parses a scale that is open and then closes. Missing values are computed from slots, starts and speeds.
fn parse_closing_scale(
    table: &TableReader<'_, keys::Scale>,
    value: &TypedValue<'_, kinds::Table<keys::Scale>>,
    scenario: &Scenario,
) -> Result<Scale, Diagnostic> {
    let opening = Opening::compute(scenario);
    let time_s = |key| Ok(table.optional_time_ns(key)?.map(ns_to_seconds));
    let (from, hold_s, over_s) =
        (table.get(keys::Scale::from), time_s(keys::Scale::hold_s)?, time_s(keys::Scale::over_s)?);
    let given_scale = from.as_ref().map(|from| from.number()).transpose()?;
    let given_or_computed = |given: Option<f64>, compute: fn(&Opening) -> f64| {
        given.or(opening.as_ref().map(compute)).ok_or_else(|| {
            value.error_about_key(
                "is incomplete: how far and how long to open does not follow from this graph",
                "expected `from`, `hold_s` and `over_s`",
            )
        })
    };
    let from_scale = given_or_computed(given_scale, |opening| opening.from)?;
    if let Some(from) = from.filter(|_| from_scale < 1.0) {
        return Err(from.error_about_key(
            format!("is {from_scale}: the formation would open, not close"),
            "expected 1 or more",
        ));
    }
    let hold_s = given_or_computed(hold_s, |opening| opening.hold_s)?;
    let over_s = given_or_computed(over_s, |opening| opening.over_s)?;
    let mut scale = Scale::Closing { from: from_scale, hold_s, over_s, reopen_at_s: Vec::new() };
    let times = table.get(keys::Scale::reopen_at_s).map(|times| times.times_ns()).transpose()?;
    for (time, at_ns) in times.unwrap_or_default() {
        let closed_s = scale.closing_end_s().unwrap_or_default();
        if ns_to_seconds(at_ns) < closed_s {
            return Err(time.error_about_key(
                format!("is {}, before the formation has closed", ns_to_seconds(at_ns)),
                format!("expected at least {closed_s} s"),
            ));
        }
        if let Scale::Closing { reopen_at_s, .. } = &mut scale {
            reopen_at_s.push(ns_to_seconds(at_ns));
        }
    }
    Ok(scale)
}
