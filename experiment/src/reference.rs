//! The page of the book that lists every key of a scenario: made of the rows of
//! [`crate::scenario::keys`] and of what the agents know, nothing else.

use std::fmt::Write;

use protocol::catalog::Catalog;
use toml::de::DeValue;

use crate::scenario::fault::FORMS;
use crate::scenario::keys::{Format, Key, Otherwise, Range, Section, Takes};
use crate::scenario::models::MODELS;
use crate::scenario::table::{NUMBER_MAX, SECONDS_MAX, spelled};

const HEAD: &str = "\
# Scenario keys

Written by `phalanx schema --markdown` from the table that the reader of scenarios uses; do not edit it.

A key that is marked **needed** must be given where its table is. Ranges are inclusive unless they say otherwise. Robots take keys from
`robot_defaults` and from the nodes of an imported graph too.
";

/// The page for these laws and methods, in Markdown.
pub fn reference(catalog: &Catalog) -> String {
    let mut page = HEAD.to_owned() + &sections(&Format::of(catalog), "The whole file");
    models(&mut page);
    laws(&mut page, catalog);
    methods(&mut page, catalog);
    faults(&mut page);
    page
}

/// A table for each section; `whole`: the heading of the first.
pub fn sections(format: &Format, whole: &str) -> String {
    let mut page = String::new();
    for section in &format.sections {
        let heading = match std::ptr::eq(section, format.root()) {
            true => whole.to_owned(),
            false => format!("`{}`", section.name),
        };
        table(&mut page, section, &heading, format);
    }
    page
}

fn table(page: &mut String, section: &Section, heading: &str, format: &Format) {
    // Writing to a string cannot fail, here and below.
    let _ = writeln!(page, "\n## {heading}\n\n{}\n", section.says);
    if section.keys.is_empty() {
        return;
    }
    page.push_str(
        "| key | type | unit | default | range | what it is |\n|---|---|---|---|---|---|\n",
    );
    for key in &section.keys {
        let (kind, range) = type_of(key, section, format);
        let range = if key.bounds.is_empty() { &range } else { key.bounds };
        let _ = writeln!(
            page,
            "| `{}` | {kind} | {} | {} | {range} | {} |",
            key.name,
            key.unit().replace("^2", "²"),
            default(key, section),
            says(key),
        );
    }
    if !section.kinds.is_empty() {
        let _ = writeln!(page, "\n| `kind` | what it is | needs | may have |\n|---|---|---|---|");
        for kind in &section.kinds {
            let (needs, may) = (names(&kind.needs), names(&kind.may));
            let _ = writeln!(page, "| `{}` | {} | {needs} | {may} |", kind.word, kind.says);
        }
    }
}

/// Type and range of a key's value, in words.
fn type_of(key: &Key, section: &Section, format: &Format) -> (String, String) {
    let within = |range: Range, most: f64| match range {
        Range::Any => format!("-{most:e} to {most:e}"),
        Range::NotNegative => format!("0 to {most:e}"),
        Range::Positive => format!("above 0, to {most:e}"),
        Range::NotZero => format!("-{most:e} to {most:e}, not 0"),
    };
    let link = |section: &str| format!("[`{section}`](#{section})");
    let plain = |kind: &str| (kind.to_owned(), String::new());
    match key.takes {
        Takes::Text => plain("string"),
        Takes::Word(words) => {
            let words: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
            ("word".into(), names(&words))
        }
        Takes::Kind => ("word".into(), names(&section.words())),
        Takes::Law => ("word".into(), format!("a [law](#laws): {}", names(&format.laws))),
        Takes::Method => {
            ("word".into(), format!("a [method](#avoidance-methods): {}", names(&format.methods)))
        }
        Takes::Truth => plain("boolean"),
        Takes::Number(range) => ("number".into(), within(range, NUMBER_MAX)),
        Takes::Time(range) => ("number, whole nanoseconds".into(), within(range, SECONDS_MAX)),
        Takes::Times => {
            let range = within(Range::NotNegative, SECONDS_MAX);
            ("list of numbers, whole nanoseconds".into(), range)
        }
        Takes::Whole(least, most) if most == i64::MAX as u64 => {
            ("integer".into(), format!("{least} to 2<sup>63</sup> - 1"))
        }
        Takes::Whole(least, most) => ("integer".into(), format!("{least} to {most}")),
        Takes::Pair => ("[x, y]".into(), within(Range::Any, NUMBER_MAX)),
        Takes::Points => ("list of [x, y]".into(), within(Range::Any, NUMBER_MAX)),
        Takes::Texts | Takes::Names => plain("list of strings"),
        Takes::NamesOrCount => plain("list of strings, or integer"),
        Takes::Table(section) => plain(&format!("table {}", link(section))),
        Takes::Tables(section) => plain(&format!("list of tables {}", link(section))),
        Takes::NamedTables(section) => plain(&format!("table of tables {}", link(section))),
        Takes::Any(words) => plain(words),
    }
}

fn default(key: &Key, section: &Section) -> String {
    let of_some_kinds =
        key.name != "kind" && section.kinds.iter().any(|kind| !kind.needs.contains(&key.name));
    match &key.otherwise {
        Otherwise::Needed if of_some_kinds => "needed by kinds below".into(),
        Otherwise::Needed => "**needed**".into(),
        Otherwise::Default(DeValue::String(word)) => format!("`{word}`"),
        // As short as numbers are written.
        Otherwise::Default(DeValue::Float(number)) => {
            number.as_str().parse::<f64>().expect("a number").to_string()
        }
        Otherwise::Default(other) => spelled(other),
        Otherwise::Rule(rule) => rule.to_string(),
        Otherwise::Absent => "-".into(),
    }
}

fn says(key: &Key) -> String {
    let mut says = key.says.replace('|', "\\|");
    if let Takes::Word(words) = key.takes {
        for (word, meaning) in words.iter().filter(|(_, meaning)| !meaning.is_empty()) {
            let _ = write!(says, "; `{word}`: {meaning}");
        }
    }
    if !key.was.is_empty() {
        let _ = write!(says, "; older name: {}", names(key.was));
    }
    says
}

fn models(page: &mut String) {
    page.push_str(
        "\n## Models\n\nWhat a robot has with `model`, where its keys do not say otherwise. The front point is a choice of \
         this project.\n\n| `model` | front point (m) | body (m) | wheels (m/s) | track (m) | a_v (m/s²) | a_w (rad/s²) | source \
         |\n|---|---|---|---|---|---|---|---|\n",
    );
    for model in MODELS {
        let _ = writeln!(
            page,
            "| `{}` | {} | {} | {} | {} | {} | {} | {} |",
            model.name,
            model.front_point_m,
            model.body_radius_m,
            model.wheels.speed_max_m_s,
            model.wheels.track_m,
            model.acceleration_m_s2,
            model.turn_acceleration_rad_s2,
            model.source
        );
    }
}

fn laws(page: &mut String, catalog: &Catalog) {
    page.push_str(
        "\n## Laws\n\n| `law` | equation | robots with it | gains | feed-forward |\n\
         |---|---|---|---|---|\n",
    );
    for law in &catalog.laws {
        let gains = names(law.gains);
        let used = if law.feed_forward { "yes" } else { "no" };
        let (name, source, does) = (law.name, law.source, law.role.does);
        let _ = writeln!(page, "| `{name}` | {source} | {does} | {gains} | {used} |");
    }
}

fn methods(page: &mut String, catalog: &Catalog) {
    page.push_str("\n## Avoidance methods\n\n| `kind` | source | needs `speed_max_m_s` | its own keys |\n|---|---|---|---|\n");
    for method in &catalog.methods {
        let own: Vec<&str> = method.gains.iter().map(|gain| gain.key).collect();
        let limited = if method.clamps_speed { "yes" } else { "no" };
        let _ = writeln!(
            page,
            "| `{}` | {} | {limited} | {} |",
            method.name,
            method.source,
            names(&own)
        );
    }
}

fn faults(page: &mut String) {
    page.push_str(
        "\n## Faults on the command line\n\nThe same as a table `[[fault]]`, for `--fault`:\n\n```text\n",
    );
    for form in FORMS {
        let _ = writeln!(page, "{}", form.grammar);
    }
    page.push_str("```\n");
}

fn names(names: &[&str]) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    if names.is_empty() { "-".into() } else { names.join(", ") }
}
