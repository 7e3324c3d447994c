//! Search space of `phalanx hunt`: `[hunt]`.

use super::diagnostic::{Diagnostic, most_similar_word};
use super::fields::{TypedKey, kinds};
use super::keys::{Hunt, Root};
use super::robots::parse_robot_index;
use super::table::{TableReader, TypedValue};
use super::{HuntBounds, Robot, VariedPart, ns_to_seconds};

/// Parts of a scenario that can vary, with their names for `vary` and `--vary`.
pub const VARY_VALUES: &[(&str, VariedPart)] = &[
    ("starts", VariedPart::Starts),
    ("faults", VariedPart::Faults),
    ("delays", VariedPart::Delays),
    ("noise", VariedPart::Noise),
    ("gains", VariedPart::Gains),
];

/// Kinds of faults that a hunt can draw: all that act within one process.
const FAULT_KINDS: &[&str] = &[
    "kill", "freeze", "slow", "cut", "loss", "bursts", "fading", "delay", "lie", "blackout",
    "noise", "wheels",
];

/// Parses `[hunt]`.
pub(super) fn parse_hunt(
    root: &TableReader<'_, Root>,
    robots: &[Robot],
    [duration_ns, period_ns]: [u64; 2],
    d_m: f64,
) -> Result<HuntBounds, Diagnostic> {
    let table = root.table(Root::hunt)?;
    let vary = parse_words(&table, Hunt::vary, &|word| {
        VARY_VALUES.iter().find(|(known, _)| *known == word).map(|(_, varied)| *varied)
    })?;
    let kinds = parse_words(&table, Hunt::kinds, &|word| {
        FAULT_KINDS.iter().find(|known| **known == word).copied()
    })?;
    let robot_indices = match table.get(Hunt::robots) {
        None => (0..robots.len()).collect(),
        Some(list) => {
            let names = list.elements("expected a list of names of robots")?;
            check_not_empty(&list, &names)?;
            names.iter().map(|name| parse_robot_index(name, robots)).collect::<Result<_, _>>()?
        }
    };
    let from_ns = table.time_ns(Hunt::from_s)?;
    let until_ns = table.optional_time_ns(Hunt::until_s)?.unwrap_or(duration_ns / 2);
    if until_ns <= from_ns || until_ns > duration_ns {
        let key = table.get(Hunt::until_s).or_else(|| table.get(Hunt::from_s));
        return Err(key.expect("half of the duration is above 0").error_about_key(
            format!(
                "leaves no time for faults: from {} s to {} s",
                ns_to_seconds(from_ns),
                ns_to_seconds(until_ns)
            ),
            format!(
                "expected `from_s` below `until_s`, and `until_s` at most {} s",
                ns_to_seconds(duration_ns)
            ),
        ));
    }
    let loss = table.required_value(Hunt::loss_max)?;
    let loss_max = loss.number()?;
    if loss_max > 1.0 {
        return Err(loss.error_about_key(
            format!("is {loss_max}"),
            "expected a fraction above 0 and at most 1",
        ));
    }
    let box_m = parse_positive_pair(&table, Hunt::box_m, [4.0 * d_m; 2])?;
    let gain_factors = parse_positive_pair(&table, Hunt::gain_factors, [0.5, 2.0])?;
    if let ([factor_min, factor_max], Some(key)) = (gain_factors, table.get(Hunt::gain_factors))
        && factor_min >= factor_max
    {
        let expected = "expected the smaller factor first, such as [0.5, 2.0]";
        return Err(key.error_about_key(format!("is [{factor_min}, {factor_max}]"), expected));
    }
    Ok(HuntBounds {
        varied_parts: vary
            .unwrap_or_else(|| vec![VariedPart::Starts, VariedPart::Faults, VariedPart::Delays]),
        faults_max: table.integer(Hunt::faults_max)? as usize,
        // Few control laws tolerate Byzantine robots.
        fault_kinds: kinds
            .unwrap_or_else(|| FAULT_KINDS.iter().copied().filter(|kind| *kind != "lie").collect()),
        robots: robot_indices,
        earliest_fault_start_ns: from_ns,
        latest_fault_end_ns: until_ns,
        start_box_m: box_m,
        separation_min_m: table.optional_number(Hunt::apart_m)?.unwrap_or(1.5 * d_m),
        delay_ns_max: table.optional_time_ns(Hunt::delay_s_max)?.unwrap_or(4 * period_ns),
        loss_max,
        noise_m_max: table.optional_number(Hunt::noise_m_max)?.unwrap_or(0.05 * d_m),
        noise_heading_rad_max: table.number(Hunt::noise_heading_rad_max)?,
        message_error_max: table.number(Hunt::message_error_max)?,
        gain_factors,
    })
}

/// Parses a list of words with their meanings, or returns `None` if it is not given.
fn parse_words<T>(
    table: &TableReader<'_, Hunt>,
    key: TypedKey<Hunt, kinds::Texts>,
    meaning: &dyn Fn(&str) -> Option<T>,
) -> Result<Option<Vec<T>>, Diagnostic> {
    let Some(list) = table.get(key) else { return Ok(None) };
    let known: Vec<&str> = match key.name() {
        "kinds" => FAULT_KINDS.to_vec(),
        _ => VARY_VALUES.iter().map(|(word, _)| *word).collect(),
    };
    let expected = format!("expected one or more of {}", known.join(", "));
    let words = list.elements(&expected)?;
    check_not_empty(&list, &words)?;
    let parse_word = |word: &TypedValue<'_, kinds::Texts>| {
        let text = word.text(&expected)?;
        meaning(text).ok_or_else(|| {
            let close = most_similar_word(text, known.iter().copied());
            let close = close.map(|close| format!("did you mean \"{close}\"?"));
            word.error_about_key(
                format!("is \"{text}\""),
                close.unwrap_or_else(|| expected.clone()),
            )
        })
    };
    words.iter().map(parse_word).collect::<Result<_, _>>().map(Some)
}

fn check_not_empty<T>(
    list: &TypedValue<'_, T>,
    elements: &[TypedValue<'_, T>],
) -> Result<(), Diagnostic> {
    match elements {
        [] => Err(list.error_about_key(
            "is empty: nothing would vary",
            "expected at least one, or no such key",
        )),
        _ => Ok(()),
    }
}

/// Parses two numbers above 0.
fn parse_positive_pair(
    table: &TableReader<'_, Hunt>,
    key: TypedKey<Hunt, kinds::Pair>,
    default: [f64; 2],
) -> Result<[f64; 2], Diagnostic> {
    let Some(value) = table.get(key) else { return Ok(default) };
    match value.pair()? {
        pair if pair.iter().all(|number| *number > 0.0) => Ok(pair),
        [a, b] => {
            Err(value.error_about_key(format!("is [{a}, {b}]"), "expected two numbers above 0"))
        }
    }
}
