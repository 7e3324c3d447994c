//! Control laws in external programs: `[laws.NAME]`.
//!
//! They are parsed first, because the gains that they name become keys of robots.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;

use protocol::catalog::Catalog;
use protocol::law::{LIARS_MAX_KEY, LawDescription, Role};
use protocol::law_message::{MESSAGE_BYTES_MAX, MessageArray, MessageFormat};
use protocol::signals::SIGNALS_MAX;
use toml::de::{DeTable, DeValue};

use super::diagnostic::{Diagnostic, SourceText};
use super::fields::kinds;
use super::keys::{self, FileFormat};
use super::program::ExternalProgram;
use super::table::{Document, TableReader, TypedValue};

/// Key of a gain, with its lowest and its highest value.
type GainRange = (&'static str, [f64; 2]);

/// Control law in an external program.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramLaw {
    /// Name, the value of the key `law`.
    pub name: String,
    /// Program that robots with this law run.
    pub program: ExternalProgram,
    /// Distance up to which these robots sense others, m; `None` for that of the avoidance method.
    pub sensing_radius_m: Option<f64>,
}

/// Returns the catalog with the external laws of the text added. `program_folder` is the folder that must contain their
/// files; `None`: not checked.
pub(super) fn add_external_laws(
    catalog: &Catalog,
    source: &SourceText,
    entries: &DeTable<'_>,
    program_folder: Option<&Path>,
) -> Result<Catalog, Diagnostic> {
    let mut known = catalog.clone();
    if entries.get("laws").is_none() {
        return Ok(known);
    }
    let format = FileFormat::new(catalog);
    let document = Document::new(source.clone(), &format);
    let root: TableReader<'_, keys::Root> = TableReader::root(&document, entries, "the scenario");
    for (name, table) in root.named_tables(keys::Root::laws)? {
        known.laws.push(parse_law_description(name, &table, catalog, &format)?);
        if let Some(folder) = program_folder {
            ExternalProgram::check_files_exist(&table, folder)?;
        }
    }
    Ok(known)
}

/// Returns all external laws with their programs.
pub(super) fn parse_laws(
    root: &TableReader<'_, keys::Root>,
) -> Result<Vec<ProgramLaw>, Diagnostic> {
    let law = |(name, table): (&str, TableReader<'_, keys::Law>)| {
        let sensing_radius_m = table.optional_number(keys::Law::sensing_radius_m)?;
        Ok(ProgramLaw {
            name: name.to_owned(),
            program: ExternalProgram::read(&table)?,
            sensing_radius_m,
        })
    };
    root.named_tables(keys::Root::laws)?.into_iter().map(law).collect()
}

fn parse_law_description(
    name: &str,
    table: &TableReader<'_, keys::Law>,
    catalog: &Catalog,
    format: &FileFormat,
) -> Result<LawDescription, Diagnostic> {
    if !is_name(name, |c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
        return Err(table.error_at_table(
            format!("`{name}` is the name of a law"),
            "expected letters, digits, `-` and `_`, and a letter first",
        ));
    }
    if catalog.laws.iter().any(|law| law.name == name) {
        return Err(table.error_at_table(
            format!("\"{name}\" is a law that is built in"),
            "expected another name",
        ));
    }
    let roles = [Role::LEADER, Role::FORMATION, Role::CONTAINED, Role::GOAL, Role::FREE]
        .map(|role| (role.name, role));
    let role = table.required_value(keys::Law::role)?.parse_word(&roles)?;
    let gains = parse_gains(table, catalog, format)?;
    let ranges = gain_ranges(table, &gains)?;
    let params = table.get(keys::Law::params).map(|params| params.any_table()).transpose()?;
    let correction_max = table
        .get(keys::Law::correction_max)
        .map(|key| parse_bounding_gain(&key, &gains, &ranges))
        .transpose()?;
    Ok(LawDescription {
        name: intern_name(name),
        role,
        source: "in a program of the scenario's own",
        gain_keys: intern_list(gains),
        gain_ranges: intern_ranges(ranges),
        feed_forward: table.boolean(keys::Law::feed_forward)?,
        correction_max,
        params: Some(intern_params(params)),
        message_format: parse_message_format(table)?.map(intern_format),
        queued_messages_max: table.integer(keys::Law::message_queue)? as usize,
        may_withhold_beacon: table.boolean(keys::Law::withholds)?,
        signals: intern_list(parse_signals(table)?),
    })
}

/// Parses the keys of the law's gains.
fn parse_gains(
    table: &TableReader<'_, keys::Law>,
    catalog: &Catalog,
    format: &FileFormat,
) -> Result<Vec<&'static str>, Diagnostic> {
    let expected = "expected a list of keys, as in [\"k_m_s\"]";
    let Some(list) = table.get(keys::Law::gains) else { return Ok(Vec::new()) };
    let mut gains: Vec<&'static str> = Vec::new();
    for value in list.elements(expected)? {
        let key = value.text(expected)?;
        if !is_key_name(key) {
            return Err(value.error_about_key(
                format!("is \"{key}\""),
                "expected lower-case letters, digits and `_`, with the unit last, as in \"k_m_s\"",
            ));
        }
        let of_robots = format.section("robot").find_key(key).is_some();
        let of_a_law = catalog.laws.iter().any(|law| law.gain_keys.contains(&key));
        if of_robots && !of_a_law {
            return Err(value.error_about_key(
                format!("is \"{key}\", which is already a key of robots"),
                "expected another name with the unit last, such as \"k_m_s\"",
            ));
        }
        if gains.contains(&key) {
            return Err(value.error_about_key(
                format!("is \"{key}\", which is listed twice"),
                "expected every key once",
            ));
        }
        gains.push(intern_name(key));
    }
    Ok(gains)
}

/// Parses the ranges of some of the law's gains.
fn gain_ranges(
    table: &TableReader<'_, keys::Law>,
    gains: &[&'static str],
) -> Result<Vec<GainRange>, Diagnostic> {
    let expected = "expected the lowest and the highest value of some of the `gains`, such as { k_per_s = [-2.0, 2.0] }";
    let Some(given) = table.get(keys::Law::gain_ranges) else { return Ok(Vec::new()) };
    let mut ranges = Vec::new();
    for (key, value) in given.entries(expected)? {
        let Some(gain) = gains.iter().find(|gain| **gain == key) else {
            return Err(value.error_about_key("is not one of the law's `gains`", expected));
        };
        if *gain == LIARS_MAX_KEY {
            return Err(value.error_about_key("is a whole number above 0", "expected no range"));
        }
        let [lowest, highest] = value.pair()?;
        if lowest >= highest {
            return Err(value.error_about_key(format!("is [{lowest}, {highest}]"), expected));
        }
        ranges.push((*gain, [lowest, highest]));
    }
    Ok(ranges)
}

/// Parses the names of the law's signals.
fn parse_signals(table: &TableReader<'_, keys::Law>) -> Result<Vec<&'static str>, Diagnostic> {
    let expected = "expected a list of names, as in [\"cost_m2\"]";
    let Some(list) = table.get(keys::Law::signals) else { return Ok(Vec::new()) };
    let mut signals: Vec<&'static str> = Vec::new();
    for value in list.elements(expected)? {
        let name = value.text(expected)?;
        if !is_key_name(name) {
            return Err(value.error_about_key(
                format!("is \"{name}\""),
                "expected lower-case letters, digits and `_`, with the unit last, as in \"cost_m2\"",
            ));
        }
        if signals.contains(&name) {
            return Err(value.error_about_key(
                format!("is \"{name}\", which is listed twice"),
                "expected every name once",
            ));
        }
        signals.push(intern_name(name));
    }
    match signals.len() {
        0..=SIGNALS_MAX => Ok(signals),
        count => Err(list.error_about_key(
            format!("has {count} names"),
            format!("expected at most {SIGNALS_MAX}"),
        )),
    }
}

/// Returns whether a text can name a gain, an array or a signal.
pub(super) fn is_key_name(name: &str) -> bool {
    is_name(name, |c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// Parses the format of the law's messages.
fn parse_message_format(
    table: &TableReader<'_, keys::Law>,
) -> Result<Option<MessageFormat>, Diagnostic> {
    let arrays = match (table.get(keys::Law::message), table.get(keys::Law::message_bytes_max)) {
        (None, None) => return Ok(None),
        (None, Some(bytes)) => {
            return Ok(Some(MessageFormat::with_bytes(bytes.integer()? as usize)));
        }
        (Some(arrays), None) => arrays,
        (Some(_), Some(bytes)) => {
            let expected = "expected one of them: arrays of numbers, or bytes";
            return Err(bytes.error_about_key("is given, and `message` too", expected));
        }
    };
    let expected =
        "expected named arrays with their shapes, such as { v_m_s = 2, plan_m = [20, 2], bid = 1 }";
    let entries = arrays.entries(expected)?;
    if entries.is_empty() {
        return Err(arrays.error_about_key("is empty", expected));
    }
    let mut format = MessageFormat::with_arrays(Vec::new());
    for (name, shape) in entries {
        if !is_key_name(&name) {
            let expected =
                "expected lower-case letters, digits and `_`, with the unit last, as in \"v_m_s\"";
            return Err(shape.error_about_key("is no name of an array", expected));
        }
        let array = MessageArray { name: name.into(), shape: parse_array_shape(&shape)?.into() };
        format.arrays.to_mut().push(array);
        format = MessageFormat::with_arrays(format.arrays.into_owned());
        if format.bytes_max > MESSAGE_BYTES_MAX {
            return Err(arrays.error_about_key(
                format!("has {} bytes: 8 for each number", format.bytes_max),
                format!("expected at most {MESSAGE_BYTES_MAX}"),
            ));
        }
    }
    Ok(Some(format))
}

/// Parses the shape of an array: 1 for a number, a length, or a list of lengths.
fn parse_array_shape(shape: &TypedValue<'_, kinds::Any>) -> Result<Vec<usize>, Diagnostic> {
    let expected = "expected the number of numbers, or the lengths of two or more dimensions, such as [20, 2]; each \
                    from 1 to 8192";
    let length = |value: &TypedValue<'_, kinds::Any>| match value.toml_value() {
        DeValue::Integer(length) => match usize::from_str_radix(length.as_str(), length.radix()) {
            Ok(length) if (1..=MESSAGE_BYTES_MAX / 8).contains(&length) => Ok(length),
            _ => Err(value.error_about_key(format!("is {length}"), expected)),
        },
        _ => Err(value.wrong_type_error(expected)),
    };
    if !shape.is_list() {
        let count = length(shape)?;
        return Ok(if count == 1 { Vec::new() } else { vec![count] });
    }
    let lengths: Vec<usize> =
        shape.elements(expected)?.iter().map(length).collect::<Result<_, _>>()?;
    let numbers = lengths.iter().try_fold(1usize, |numbers, &length| numbers.checked_mul(length));
    match numbers {
        Some(numbers) if !lengths.is_empty() && numbers <= MESSAGE_BYTES_MAX / 8 => Ok(lengths),
        _ => Err(shape.error_about_key(format!("is {lengths:?}"), expected)),
    }
}

/// Parses the name of the gain that bounds the correction of the law.
fn parse_bounding_gain(
    value: &TypedValue<'_, kinds::Text>,
    gains: &[&'static str],
    ranges: &[GainRange],
) -> Result<&'static str, Diagnostic> {
    let expected = match gains {
        [] => "expected one of the law's `gains`, which has none".to_owned(),
        gains => format!("expected one of its gains: {}", gains.join(", ")),
    };
    let key = value.text(&expected)?;
    if ranges.iter().any(|(gain, [lowest, _])| *gain == key && *lowest <= 0.0) {
        return Err(value.error_about_key(
            format!("is \"{key}\", which may be 0 or less by `gain_ranges`"),
            "expected a gain that is always above 0",
        ));
    }
    let found = gains.iter().find(|gain| **gain == key);
    found.copied().ok_or_else(|| value.error_about_key(format!("is \"{key}\""), expected))
}

fn is_name(name: &str, is_allowed: impl Fn(char) -> bool) -> bool {
    let is_first_allowed = |c: char| c.is_ascii_alphabetic() && is_allowed(c);
    name.starts_with(is_first_allowed)
        && name.len() <= NAME_BYTES_MAX
        && name.chars().all(is_allowed)
}

/// Maximum length of the name of a law or gain, bytes.
const NAME_BYTES_MAX: usize = 40;

/// Returns the name as a static string, which descriptions of laws require. Each distinct name is leaked only once.
fn intern_name(name: &str) -> &'static str {
    static INTERNED: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut names = INTERNED.lock().expect("no thread panics while it holds the set");
    if let Some(known) = names.get(name) {
        return known;
    }
    let name = Box::leak(Box::from(name));
    names.insert(name);
    name
}

/// Returns the parameters with static lifetime. Each distinct table is leaked only once.
fn intern_params(params: Option<toml::Table>) -> &'static toml::Table {
    static INTERNED: Mutex<Vec<&'static toml::Table>> = Mutex::new(Vec::new());
    intern(&INTERNED, params.unwrap_or_default())
}

/// Returns the format with static lifetime. Each distinct format is leaked only once.
fn intern_format(format: MessageFormat) -> &'static MessageFormat {
    static INTERNED: Mutex<Vec<&'static MessageFormat>> = Mutex::new(Vec::new());
    intern(&INTERNED, format)
}

/// Returns the ranges with static lifetime. Each distinct list is leaked only once.
fn intern_ranges(ranges: Vec<GainRange>) -> &'static [GainRange] {
    static INTERNED: Mutex<Vec<&'static Vec<GainRange>>> = Mutex::new(Vec::new());
    let ranges: &'static Vec<GainRange> = intern(&INTERNED, ranges);
    ranges
}

fn intern<T: PartialEq>(interned: &Mutex<Vec<&'static T>>, value: T) -> &'static T {
    let mut interned = interned.lock().expect("no thread panics while it holds the lock");
    if let Some(known) = interned.iter().find(|known| ***known == value) {
        return known;
    }
    let value = Box::leak(Box::new(value));
    interned.push(value);
    value
}

/// Returns the list with static lifetime. Each distinct list is leaked only once.
fn intern_list(list: Vec<&'static str>) -> &'static [&'static str] {
    static INTERNED: Mutex<BTreeSet<&'static [&'static str]>> = Mutex::new(BTreeSet::new());
    let mut lists = INTERNED.lock().expect("no thread panics while it holds the set");
    if let Some(known) = lists.get(&list[..]) {
        return known;
    }
    let list = Vec::leak(list);
    lists.insert(list);
    list
}
