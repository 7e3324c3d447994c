//! Axis of a campaign: a key and the values that it takes.

use std::path::PathBuf;

use formation::portable_math;

use crate::scenario::diagnostic::Diagnostic;
use crate::scenario::table::{TypedValue, format_as_toml};
use toml::de::DeValue;

use crate::campaign::starts::RandomStarts;

/// Maximum number of values of an axis. More are assumed to be a typing error.
const VALUES_MAX: usize = 100_000;

/// Value of an axis of faults, or of a word in faults, that omits these faults.
pub(crate) const NO_FAULT_VALUE: &str = "none";

/// Axis of a campaign: one parameter and the values that it takes.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Name: a scenario key, `fault`, a word in the campaign's `faults`, or the `axis` of cases.
    pub key: String,
    /// Kind of parameter that the axis sets.
    pub kind: AxisKind,
    /// Values, at least one.
    pub settings: Vec<Setting>,
}

/// Kind of parameter that an axis sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisKind {
    /// A scenario key.
    Key,
    /// Faults of the scenario.
    Fault,
    /// A word in the campaign's `faults`.
    FaultPlaceholder,
    /// Several parameters, as given by its cases.
    Cases,
}

/// One value of an axis.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Setting {
    /// Text in tables.
    pub display_text: String,
    /// Text for `--set`.
    pub toml: String,
    /// Numeric value. `None` for other values.
    pub numeric_value: Option<f64>,
    /// Faults of this value, in the syntax of `--fault`. Empty for axes of keys and words.
    pub faults: Vec<String>,
    /// Other parameters of a case. `None` for other axes.
    pub case: Case,
}

/// Parameters of a case other than its faults.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Case {
    /// Scenario file in place of that of the campaign.
    pub scenario: Option<PathBuf>,
    /// Scenario keys that runs with this value set, in the syntax of `--set`.
    pub assignments: Vec<String>,
    /// Random starts in place of those of the campaign.
    pub random_starts: Option<RandomStarts>,
}

/// Parses an axis.
pub(crate) fn parse_axis<T>(
    key: &str,
    kind: AxisKind,
    value: &TypedValue<'_, T>,
) -> Result<Axis, Diagnostic> {
    let expected = "expected a list of values, or { from, to, count, spacing }";
    let settings = match (value.toml_value(), kind) {
        (DeValue::Array(_), AxisKind::Fault) => value
            .elements(expected)?
            .iter()
            .map(parse_fault_setting)
            .collect::<Result<Vec<_>, _>>()?,
        (DeValue::Array(_), _) => {
            let mut settings: Vec<_> =
                value.elements(expected)?.iter().map(parse_setting).collect();
            // A rate whose fault is omitted counts as 0.
            let rates =
                settings.iter_mut().filter(|setting| setting.display_text == NO_FAULT_VALUE);
            rates
                .filter(|_| kind == AxisKind::FaultPlaceholder)
                .for_each(|rate| rate.numeric_value = Some(0.0));
            settings
        }
        (DeValue::Table(_), AxisKind::Key | AxisKind::FaultPlaceholder) => parse_range(value)?,
        _ => return Err(value.wrong_type_error(expected)),
    };
    if settings.is_empty() {
        return Err(value.error_about_key("has no value", expected));
    }
    for (index, setting) in settings.iter().enumerate() {
        if settings[..index].iter().any(|other| other.display_text == setting.display_text) {
            let message = format!("has the value {} twice", setting.display_text);
            return Err(value.error_about_key(message, "expected each value once"));
        }
    }
    Ok(Axis { key: key.to_owned(), kind, settings })
}

fn parse_setting<T>(value: &TypedValue<'_, T>) -> Setting {
    let toml = format_as_toml(value.toml_value());
    let display_text = match value.toml_value() {
        DeValue::String(text) => text.clone().into_owned(),
        _ => toml.clone(),
    };
    Setting { display_text, numeric_value: numeric_value(value), toml, ..Setting::default() }
}

fn setting_from_number(number: f64) -> Setting {
    let text = number.to_string();
    Setting {
        display_text: text.clone(),
        toml: text,
        numeric_value: Some(number),
        ..Setting::default()
    }
}

fn numeric_value<T>(value: &TypedValue<'_, T>) -> Option<f64> {
    match value.toml_value() {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) => integer.as_str().parse().ok(),
        _ => None,
    }
}

/// Parses `"none"`, a fault, or a list of faults.
fn parse_fault_setting<T>(value: &TypedValue<'_, T>) -> Result<Setting, Diagnostic> {
    let expected =
        "expected a fault as for `--fault`, such as \"kill r2 @10\", a list of them, or \"none\"";
    let faults: Vec<String> = match value.toml_value() {
        DeValue::Array(_) => value.texts(expected)?,
        _ => vec![value.text(expected)?.to_owned()]
            .into_iter()
            .filter(|f| f != NO_FAULT_VALUE)
            .collect(),
    };
    let display_text =
        if faults.is_empty() { NO_FAULT_VALUE.to_owned() } else { faults.join("; ") };
    Ok(Setting { toml: display_text.clone(), display_text, faults, ..Setting::default() })
}

/// Parses a range `{ from, to, count, spacing }`. It includes both ends.
fn parse_range<T>(value: &TypedValue<'_, T>) -> Result<Vec<Setting>, Diagnostic> {
    let expected = "expected { from, to, count, spacing }";
    let (mut limits, mut count, mut log) = ([None, None], None, None);
    for (key, inner) in value.entries(expected)? {
        let finite = || {
            let found = numeric_value(&inner).filter(|number| number.is_finite());
            found.ok_or_else(|| inner.error_about_key("is no number", "expected a finite number"))
        };
        match &*key {
            "from" => limits[0] = Some(finite()?),
            "to" => limits[1] = Some(finite()?),
            "count" => {
                let found = numeric_value(&inner).filter(|n| n.fract() == 0.0 && *n >= 2.0);
                let expected = format!("expected a whole number from 2 to {VALUES_MAX}");
                let found = found.filter(|n| *n <= VALUES_MAX as f64);
                count =
                    Some(found.ok_or_else(|| inner.error_about_key("is no count", expected))?
                        as usize);
            }
            "spacing" => {
                let expected = "expected \"linear\" or \"log\"";
                log = Some(match inner.text(expected)? {
                    "linear" => false,
                    "log" => true,
                    other => return Err(inner.error_about_key(format!("is \"{other}\""), expected)),
                });
            }
            _ => return Err(inner.error_at_value(format!("a range has no key `{key}`"), expected)),
        }
    }
    let ([Some(from), Some(to)], Some(count)) = (limits, count) else {
        return Err(value.error_about_key("lacks `from`, `to` or `count`", expected));
    };
    let log = log.unwrap_or(false);
    if log && (from <= 0.0 || to <= 0.0) {
        return Err(
            value.error_about_key("is logarithmic and not above 0", "expected both ends above 0")
        );
    }
    Ok(evenly_spaced_values(from, to, count, log).into_iter().map(setting_from_number).collect())
}

/// Returns evenly spaced values. Both ends are exact; the others are rounded to 12 digits, which avoids values such as
/// 0.30000000000000004.
fn evenly_spaced_values(from: f64, to: f64, count: usize, log: bool) -> Vec<f64> {
    let point = |i: usize| {
        let fraction = i as f64 / (count - 1) as f64;
        let value = match log {
            true => from * portable_math::pow(to / from, fraction),
            false => from + fraction * (to - from),
        };
        match i {
            0 => from,
            _ if i == count - 1 => to,
            _ => format!("{value:.11e}").parse().expect("a number"),
        }
    };
    (0..count).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ranges_are_evenly_spaced_in_short_numbers() {
        assert_eq!(evenly_spaced_values(0.0, 0.5, 6, false), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(evenly_spaced_values(0.001, 1.0, 4, true), [0.001, 0.01, 0.1, 1.0]);
    }

    proptest! {
        #[test]
        fn range_values_increase_from_first_to_last(
            from in 1e-6..1e3f64, length in 1e-3..1e3f64, count in 2..200_usize, log in any::<bool>(),
        ) {
            let points = evenly_spaced_values(from, from + length, count, log);
            prop_assert_eq!((points[0], points[count - 1]), (from, from + length));
            prop_assert!(points.is_sorted() && points.len() == count);
        }
    }
}
