//! A scenario with all defaults written out and nothing in it that means nothing: two texts that say
//! the same become the same text. For its identity, not for people.

use std::fmt::Write as _;

use protocol::catalog::Catalog;
use toml::{Table, Value};

use super::keys::{Format, Key, Otherwise, Section, Takes};

/// Tables whose defaults hold even where the table is not given.
const ALWAYS: [&str; 3] = ["realtime", "silence", "expect"];

/// The text, in which comments, order of keys, old names of keys, and what the file leaves to
/// defaults make no difference. `text` is a sound scenario as [`super::read::read`] gives it back,
/// with its graph in it.
pub fn written_out(text: &str, catalog: &Catalog) -> String {
    let format = Format::of(catalog);
    let mut root: Table = text.parse().expect("a scenario that was read is TOML");
    root.remove("description");
    for name in ALWAYS {
        root.entry(name).or_insert_with(|| Value::Table(Table::new()));
    }
    fill(&mut root, format.root(), &format);
    if let Some(Value::Table(defaults)) = root.remove("robot_defaults") {
        for robot in tables(root.get_mut("robot")) {
            for (key, value) in &defaults {
                robot.entry(key).or_insert_with(|| value.clone());
            }
        }
    }
    // After the scenario's own defaults, which go before the format's.
    for robot in tables(root.get_mut("robot")) {
        defaults(robot, format.section("robot"));
    }
    let mut out = String::new();
    write(&mut out, &Value::Table(root));
    out
}

fn tables(list: Option<&mut Value>) -> impl Iterator<Item = &mut Table> {
    let list = list.and_then(Value::as_array_mut).into_iter().flatten();
    list.filter_map(Value::as_table_mut)
}

/// New names for old ones, numbers of the type of their row, and defaults, in all tables below.
fn fill(table: &mut Table, section: &Section, format: &Format) {
    for key in &section.keys {
        for old in key.was {
            if let Some(value) = table.remove(*old) {
                table.insert(key.name.into(), value);
            }
        }
        let Some(value) = table.get_mut(key.name) else { continue };
        match key.takes {
            Takes::Number(..)
            | Takes::Time(_)
            | Takes::Times
            | Takes::Pair(_)
            | Takes::Points(_) => float(value),
            Takes::Table(name) => {
                if let Some(inner) = value.as_table_mut() {
                    fill(inner, format.section(name), format);
                }
            }
            Takes::NamedTables(name) => {
                let tables = value.as_table_mut().into_iter().flat_map(Table::iter_mut);
                tables
                    .filter_map(|(_, inner)| inner.as_table_mut())
                    .for_each(|inner| fill(inner, format.section(name), format));
            }
            Takes::Tables(name) => {
                tables(Some(value)).for_each(|inner| fill(inner, format.section(name), format));
            }
            _ => {}
        }
    }
    // What robots do not say themselves, the scenario's `robot_defaults` may.
    if !["robot", "robot_defaults"].contains(&section.name) {
        defaults(table, section);
    }
}

fn defaults(table: &mut Table, section: &Section) {
    let kind = table.get("kind").and_then(Value::as_str);
    let kind = section.kinds.iter().find(|row| Some(row.word) == kind);
    let may = |key: &&Key| {
        kind.is_none_or(|kind| kind.needs.contains(&key.name) || kind.may.contains(&key.name))
    };
    for key in section.keys.iter().filter(may) {
        let value = match key.otherwise {
            Otherwise::Number(number) => Value::Float(number),
            Otherwise::Whole(number) => Value::Integer(number as i64),
            Otherwise::Word(word) => Value::String(word.into()),
            Otherwise::No => Value::Boolean(false),
            Otherwise::Yes => Value::Boolean(true),
            Otherwise::Needed | Otherwise::Rule(_) | Otherwise::Absent => continue,
        };
        table.entry(key.name).or_insert(value);
    }
}

fn float(value: &mut Value) {
    match value {
        Value::Integer(whole) => *value = Value::Float(*whole as f64),
        Value::Array(list) => list.iter_mut().for_each(float),
        _ => {}
    }
}

/// Keys in the order of their names, whatever the order of the file.
fn write(out: &mut String, value: &Value) {
    match value {
        Value::Table(table) => {
            let mut keys: Vec<&String> = table.keys().collect();
            keys.sort();
            out.push('{');
            for key in keys {
                let _ = write!(out, "{key:?}:");
                write(out, &table[key]);
                out.push('\n');
            }
            out.push('}');
        }
        Value::Array(list) => {
            out.push('[');
            for value in list {
                write(out, value);
                out.push(',');
            }
            out.push(']');
        }
        Value::String(text) => {
            let _ = write!(out, "{text:?}");
        }
        Value::Float(float) => {
            let _ = write!(out, "{float:?}");
        }
        other => {
            let _ = write!(out, "{other}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CATALOG: Catalog = Catalog { laws: Vec::new(), methods: Vec::new() };

    #[test]
    fn what_means_the_same_is_the_same_and_what_does_not_is_not() {
        let text = "name = 'a'\nduration_s = 3\nperiod_s = 0.01\nrobot_defaults = { law = 'x' }\n\
                    robot = [{ name = 'r1', pose = { x_m = 1, y_m = 0.5 } }]\n";
        let same = "# a comment\nperiod_s = 1e-2\nseed = 1\nname = \"a\"\ndescription = 'b'\n\
                    duration_s = 3.0\nrecord_hz = 100\n[silence]\n[[robot]]\nlaw = 'x'\n\
                    name = 'r1'\nmax_restarts = 3\nrestart_policy = 'on-failure'\n\
                    [robot.pose]\ny_m = 0.5\nx_m = 1.0\n";
        let written = written_out(text, &CATALOG);
        assert!(written.contains("\"record_hz\":100.0"), "{written}");
        assert_eq!(written, written_out(same, &CATALOG));
        for other in [
            text.replace("0.01", "0.010000000000000002"),
            text.replace("'r1'", "'r2'"),
            text.replace("x_m = 1,", "x_m = -1,"),
            format!("seed = 2\n{text}"),
            text.replace("law = 'x'", "law = 'y'"),
        ] {
            assert_ne!(written, written_out(&other, &CATALOG), "{other}");
        }
    }

    #[test]
    fn a_robots_own_word_goes_before_the_scenarios_and_that_before_the_formats() {
        let text = |own: &str, all: &str| {
            written_out(
                &format!("robot_defaults = {{ {all} }}\nrobot = [{{ name = 'a', {own} }}]"),
                &CATALOG,
            )
        };
        let always = text("restart_policy = 'always'", "");
        assert_eq!(text("restart_policy = 'always'", "restart_policy = 'never'"), always);
        assert_eq!(text("", "restart_policy = 'always'"), always);
        assert_ne!(text("", ""), always);
    }

    #[test]
    fn a_fault_gets_the_defaults_of_its_kind_alone() {
        let text = "[[fault]]\nkind = 'kill'\nrobot = 'r1'\nat_s = 1";
        let written = written_out(text, &CATALOG);
        assert!(!written.contains("stuck"), "{written}");
    }
}
