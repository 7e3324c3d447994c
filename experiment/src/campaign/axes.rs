//! One axis of a campaign: a key, and the values that it takes.

use std::path::PathBuf;

use formation::portable_math;

use crate::scenario::diagnostic::Diagnostic;
use crate::scenario::table::{Value, spelled};
use toml::de::DeValue;

use crate::campaign::starts::Starts;

/// More values on one axis are a slip of the keyboard.
const VALUES_MAX: usize = 100_000;

/// The value of an axis of faults, or of a word in faults, with which they do not happen.
pub(crate) const NONE: &str = "none";

/// What runs differ in.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// A key of the scenario, `fault`, a name in the campaign's `faults`, or one that cases give it.
    pub key: String,
    /// Which of these.
    pub kind: AxisKind,
    /// Its values, at least one.
    pub settings: Vec<Setting>,
}

/// What an axis sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisKind {
    /// A key of the scenario.
    Key,
    /// Faults.
    Fault,
    /// A word in the campaign's `faults`.
    InFaults,
    /// What its cases say.
    Cases,
}

/// One value of an axis.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Setting {
    /// As tables have it.
    pub shown: String,
    /// As `--set` has it.
    pub toml: String,
    /// A number, if it is one.
    pub number: Option<f64>,
    /// Of an axis of faults or of cases: these, in the words of `--fault`.
    pub faults: Vec<String>,
    /// Of an axis of cases: what else it says.
    pub case: Case,
}

/// What a case says beside its faults.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Case {
    /// Another scenario.
    pub scenario: Option<PathBuf>,
    /// What its runs change, as `--set` has it.
    pub set: Vec<String>,
    /// Where its robots start.
    pub starts: Option<Starts>,
}

/// Reads an axis.
pub(crate) fn axis(key: &str, kind: AxisKind, value: &Value<'_>) -> Result<Axis, Diagnostic> {
    let expected = "expected a list of values, or { from, to, count, spacing }";
    let settings = match (value.raw(), kind) {
        (DeValue::Array(_), AxisKind::Fault) => {
            value.elements(expected)?.iter().map(faults).collect::<Result<Vec<_>, _>>()?
        }
        (DeValue::Array(_), _) => {
            let mut settings: Vec<_> = value.elements(expected)?.iter().map(setting).collect();
            // A rate that does not happen is one of 0.
            let rates = settings.iter_mut().filter(|setting| setting.shown == NONE);
            rates.filter(|_| kind == AxisKind::InFaults).for_each(|rate| rate.number = Some(0.0));
            settings
        }
        (DeValue::Table(_), AxisKind::Key | AxisKind::InFaults) => range(value)?,
        _ => return Err(value.wrong_type(expected)),
    };
    if settings.is_empty() {
        return Err(value.wrong("has no value", expected));
    }
    for (place, setting) in settings.iter().enumerate() {
        if settings[..place].iter().any(|other| other.shown == setting.shown) {
            let message = format!("has the value {} twice", setting.shown);
            return Err(value.wrong(message, "expected each value once"));
        }
    }
    Ok(Axis { key: key.to_owned(), kind, settings })
}

fn setting(value: &Value<'_>) -> Setting {
    let toml = spelled(value.raw());
    let shown = match value.raw() {
        DeValue::String(text) => text.clone().into_owned(),
        _ => toml.clone(),
    };
    Setting { shown, number: number(value), toml, ..Setting::default() }
}

fn of_number(number: f64) -> Setting {
    let text = number.to_string();
    Setting { shown: text.clone(), toml: text, number: Some(number), ..Setting::default() }
}

fn number(value: &Value<'_>) -> Option<f64> {
    match value.raw() {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) => integer.as_str().parse().ok(),
        _ => None,
    }
}

/// `"none"`, a fault, or a list of them.
fn faults(value: &Value<'_>) -> Result<Setting, Diagnostic> {
    let expected =
        "expected a fault in words, such as \"kill r2 @10\", a list of them, or \"none\"";
    let faults: Vec<String> = match value.raw() {
        DeValue::Array(_) => value.texts(expected)?,
        _ => vec![value.text(expected)?.to_owned()].into_iter().filter(|f| f != NONE).collect(),
    };
    let shown = if faults.is_empty() { NONE.to_owned() } else { faults.join("; ") };
    Ok(Setting { toml: shown.clone(), shown, faults, ..Setting::default() })
}

/// `{ from, to, count, spacing }`: both ends are on it.
fn range(value: &Value<'_>) -> Result<Vec<Setting>, Diagnostic> {
    let expected = "expected { from, to, count, spacing }";
    let (mut ends, mut count, mut log) = ([None, None], None, None);
    for (key, inner) in value.entries(expected)? {
        let finite = || {
            let found = number(&inner).filter(|number| number.is_finite());
            found.ok_or_else(|| inner.wrong("is no number", "expected a finite number"))
        };
        match &*key {
            "from" => ends[0] = Some(finite()?),
            "to" => ends[1] = Some(finite()?),
            "count" => {
                let found = number(&inner).filter(|n| n.fract() == 0.0 && *n >= 2.0);
                let expected = format!("expected a whole number from 2 to {VALUES_MAX}");
                let found = found.filter(|n| *n <= VALUES_MAX as f64);
                count = Some(found.ok_or_else(|| inner.wrong("is no count", expected))? as usize);
            }
            "spacing" => {
                let expected = "expected \"linear\" or \"log\"";
                log = Some(match inner.text(expected)? {
                    "linear" => false,
                    "log" => true,
                    other => return Err(inner.wrong(format!("is \"{other}\""), expected)),
                });
            }
            _ => return Err(inner.here(format!("a range has no key `{key}`"), expected)),
        }
    }
    let ([Some(from), Some(to)], Some(count)) = (ends, count) else {
        return Err(value.wrong("lacks `from`, `to` or `count`", expected));
    };
    let log = log.unwrap_or(false);
    if log && (from <= 0.0 || to <= 0.0) {
        return Err(value.wrong("is logarithmic and not above 0", "expected both ends above 0"));
    }
    Ok(points(from, to, count, log).into_iter().map(of_number).collect())
}

/// Evenly spaced, both ends exactly, in between to 12 digits: nobody asked for 0.30000000000000004.
fn points(from: f64, to: f64, count: usize, log: bool) -> Vec<f64> {
    let point = |i: usize| {
        let share = i as f64 / (count - 1) as f64;
        let value = match log {
            true => from * portable_math::pow(to / from, share),
            false => from + share * (to - from),
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
        assert_eq!(points(0.0, 0.5, 6, false), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(points(0.001, 1.0, 4, true), [0.001, 0.01, 0.1, 1.0]);
    }

    proptest! {
        #[test]
        fn a_range_rises_from_one_end_to_the_other(
            from in 1e-6..1e3f64, length in 1e-3..1e3f64, count in 2..200_usize, log in any::<bool>(),
        ) {
            let points = points(from, from + length, count, log);
            prop_assert_eq!((points[0], points[count - 1]), (from, from + length));
            prop_assert!(points.is_sorted() && points.len() == count);
        }
    }
}
