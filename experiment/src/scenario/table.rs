//! Values of a TOML text together with their places, so that every mistake can be pointed at.
//!
//! [`Table`] and [`Value`] take types, units, ranges and defaults from the rows of `keys`; asking
//! for a key that has no row is a mistake in this crate, and panics.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;

use serde::de::value::{Error, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer as _};
use toml::de::{DeTable, DeValue};

use super::diagnostic::{Diagnostic, Shown, Source, meant};
use super::keys::{Format, IfMissing, Key, Range as Numbers, Section, ValueType};

/// Largest magnitude of any number, in its unit: what is larger is a slip of the keyboard, and
/// squares of it would leave the range of exact arithmetic.
pub const NUMBER_MAX: f64 = 1e9;
/// Longest time, s: 115 days. Sums and hundredfolds of it still fit into 64 bits of nanoseconds.
pub const SECONDS_MAX: f64 = 1e7;
/// A time may miss a whole nanosecond by this much, ns.
const NANOSECOND_TOLERANCE: f64 = 1e-6;

/// Where each key was found, by its path: `avoidance.kind`, `robot.r1.pose`, `edge.0`.
pub type Places = BTreeMap<String, Range<usize>>;

/// The text, and the places found in it so far.
#[derive(Debug)]
pub struct Document<'f> {
    /// The text.
    pub source: Source,
    /// Which keys it may have.
    format: &'f Format,
    /// Where things are.
    pub places: RefCell<Places>,
    /// What is worth a warning: old names of keys.
    pub warnings: RefCell<Vec<Diagnostic>>,
}

impl<'f> Document<'f> {
    /// A text of which nothing was read.
    pub fn new(source: Source, format: &'f Format) -> Document<'f> {
        Document { source, format, places: RefCell::default(), warnings: RefCell::default() }
    }
}

/// A table, under the path by which people would name it.
#[derive(Debug, Clone)]
pub struct Table<'t> {
    document: &'t Document<'t>,
    path: String,
    /// What to call it: `[avoidance]`, `robot r1`.
    title: String,
    section: &'t Section,
    /// None where it is not given.
    entries: Option<&'t DeTable<'t>>,
    /// Where keys are looked for that it does not have.
    defaults: Option<Box<Table<'t>>>,
    span: Range<usize>,
}

/// A value and its place.
#[derive(Debug, Clone)]
pub struct Value<'t> {
    document: &'t Document<'t>,
    /// The key's path.
    path: String,
    /// The key as messages name it.
    key: String,
    row: &'t Key,
    value: &'t DeValue<'t>,
    span: Range<usize>,
}

impl<'t> Document<'t> {
    /// A table of the text, under no path and title as yet.
    fn table(
        &'t self,
        section: &str,
        entries: Option<&'t DeTable<'t>>,
        span: Range<usize>,
    ) -> Table<'t> {
        let (document, section) = (self, self.format.section(section));
        let (path, title) = (String::new(), String::new());
        Table { document, path, title, section, entries, defaults: None, span }
    }
}

impl<'t> Table<'t> {
    /// The whole document, under the title by which messages name it.
    pub fn root(
        document: &'t Document<'t>,
        entries: &'t DeTable<'t>,
        title: &'static str,
    ) -> Table<'t> {
        let root = document.table(document.format.root().name, Some(entries), 0..0);
        Table { title: title.to_owned(), ..root }
    }

    /// The same table with those keys of `defaults` that it does not have itself.
    pub fn with_defaults(self, defaults: Option<Table<'t>>) -> Table<'t> {
        Table { defaults: defaults.map(Box::new), ..self }
    }

    /// The same table under another path and title: a list's element, once its name is known.
    pub fn named(self, path: &str, title: &str) -> Table<'t> {
        self.document.places.borrow_mut().insert(path.to_owned(), self.span.clone());
        Table { path: path.to_owned(), title: title.to_owned(), ..self }
    }

    /// Refuses keys that it may not have, and warns of old names.
    pub fn only(&self) -> Result<(), Diagnostic> {
        self.only_these(&|_| true, true)
    }

    /// The word of its `kind`, with which it has no other keys than it may.
    pub fn kind(&self) -> Result<&'static str, Diagnostic> {
        let word = self.kind_alone()?;
        let kinds = self.section.kinds.iter().filter(|kind| kind.word == word);
        let kinds: Vec<_> = kinds.collect();
        self.only_these(&|key: &Key| kinds.iter().any(|kind| kind.allows(key.name)), false)?;
        Ok(word)
    }

    /// The word of its `kind`, whatever its other keys are.
    pub fn kind_alone(&self) -> Result<&'static str, Diagnostic> {
        let words: Vec<_> =
            self.section.kind_names().into_iter().map(|word| (word, word)).collect();
        self.need("kind")?.word(&words)
    }

    /// Refuses keys other than `kind` and these.
    pub fn only_with(&self, keys: &[&str]) -> Result<(), Diagnostic> {
        self.only_these(&|key: &Key| keys.contains(&key.name), false)
    }

    fn only_these(&self, may: &dyn Fn(&Key) -> bool, elsewhere: bool) -> Result<(), Diagnostic> {
        let rows = self.section.keys.iter().filter(|key| key.name == "kind" || may(key));
        let rows: Vec<&Key> = rows.collect();
        let mut keys: Vec<_> = self.keys().collect();
        keys.sort_by_key(|(_, span)| span.start);
        let wrong = |span, message, expected| self.document.source.error(span, message, expected);
        for (word, span) in &keys {
            if rows.iter().any(|row| row.name == *word) {
                continue;
            }
            let Some(row) = rows.iter().find(|row| row.old_names.contains(word)) else {
                let expected =
                    self.document.format.suggestion(self.section, &rows, word, elsewhere);
                return Err(wrong(span, format!("{} has no key `{word}`", self.title), expected));
            };
            let new = row.name;
            if keys.iter().any(|(other, _)| *other == new) {
                let message = format!("{} has `{new}` and `{word}`, its old name", self.title);
                return Err(wrong(span, message, format!("expected `{new}` alone")));
            }
            let message = format!("`{word}` is called `{new}` now");
            let expected = format!("expected `{new}`; the old name still works");
            let warning = wrong(span, message, expected).as_warning();
            self.document.warnings.borrow_mut().push(warning);
        }
        Ok(())
    }

    /// What is found at `path` stands here.
    pub fn is_at(&self, path: &str) {
        self.document.places.borrow_mut().insert(path.to_owned(), self.span.clone());
    }

    /// Where it stands; with a header, only that.
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// The keys that are there, with their places.
    pub fn keys(&self) -> impl Iterator<Item = (&'t str, Range<usize>)> + use<'t> {
        let entries = self.entries.into_iter().flat_map(|entries| entries.iter());
        entries.map(|(key, _)| (key.get_ref().as_ref(), key.span()))
    }

    fn row(&self, key: &str) -> &'t Key {
        let row = self.section.key(key);
        row.unwrap_or_else(|| panic!("`{key}` is a key of {}", self.section.name))
    }

    /// The value of `key`, if it is there or among the defaults.
    pub fn get(&self, key: &str) -> Option<Value<'t>> {
        let row = self.row(key);
        let given = self.entries.and_then(|entries| {
            let old = || row.old_names.iter().find_map(|old| entries.get(*old));
            entries.get(key).or_else(old)
        });
        let path = self.path_of(key);
        let Some(found) = given else {
            let defaults = self.defaults.as_ref().filter(|d| d.section.key(key).is_some())?;
            let value = defaults.get(key)?;
            self.document.places.borrow_mut().insert(path, value.span.clone());
            return Some(value);
        };
        self.document.places.borrow_mut().insert(path, found.span());
        Some(self.value(row, found.get_ref(), found.span()))
    }

    fn value(&self, row: &'t Key, value: &'t DeValue<'t>, span: Range<usize>) -> Value<'t> {
        let (path, key) = (self.path_of(row.name), row.name.to_owned());
        Value { document: self.document, path, key, row, value, span }
    }

    /// The value of `key`, or its default; without one it must be given.
    pub fn need(&self, key: &str) -> Result<Value<'t>, Diagnostic> {
        let row = self.row(key);
        match (self.get(key), &row.if_missing) {
            (Some(given), _) => Ok(given),
            (None, IfMissing::Default(default)) => Ok(self.value(row, default, self.span())),
            (None, _) => Err(self.missing(key, &row.description)),
        }
    }

    /// The number of `key`, or its default.
    pub fn number(&self, key: &str) -> Result<f64, Diagnostic> {
        self.need(key)?.number()
    }

    /// The time of `key`, or its default, ns.
    pub fn time_ns(&self, key: &str) -> Result<u64, Diagnostic> {
        self.need(key)?.time_ns()
    }

    /// The whole number of `key`, or its default.
    pub fn whole(&self, key: &str) -> Result<u64, Diagnostic> {
        self.need(key)?.whole()
    }

    /// Whether `key` says so.
    pub fn truth(&self, key: &str) -> Result<bool, Diagnostic> {
        self.need(key)?.truth()
    }

    /// What the word of `key`, or its default, is called in files of every kind: as `T` reads it.
    pub fn word<T: DeserializeOwned>(&self, key: &str) -> Result<T, Diagnostic> {
        let ValueType::Word(words) = self.row(key).value_type else { panic!("`{key}` is a word") };
        let words: Vec<_> = words.iter().map(|&(word, _)| (word, word)).collect();
        let word: StrDeserializer<'_, Error> = self.need(key)?.word(&words)?.into_deserializer();
        Ok(T::deserialize(word).expect("every word of a row means something"))
    }

    /// The number of `key`, if it is given.
    pub fn maybe_number(&self, key: &str) -> Result<Option<f64>, Diagnostic> {
        self.get(key).map(|value| value.number()).transpose()
    }

    /// The table `key`; an empty one if it is not given.
    pub fn table(&self, key: &str) -> Result<Table<'t>, Diagnostic> {
        if let Some(value) = self.get(key) {
            return value.table();
        }
        let ValueType::Table(section) = self.row(key).value_type else {
            panic!("`{key}` is a table")
        };
        let table = self.document.table(section, None, self.span());
        Ok(Table { path: self.path_of(key), title: format!("[{key}]"), ..table })
    }

    /// The times of `key`, if it is given, ns.
    pub fn maybe_time_ns(&self, key: &str) -> Result<Option<u64>, Diagnostic> {
        self.get(key).map(|value| value.time_ns()).transpose()
    }

    /// That `key` is not there, or is called otherwise; `expected` says what to add.
    pub fn missing(&self, key: &str, expected: &str) -> Diagnostic {
        let stands_for_it = |(word, _): &(&str, Range<usize>)| {
            let row = self.section.key(key).filter(|_| self.section.key(word).is_none());
            row.is_some_and(|row| row.is_meant_by(word) || meant(word, [key]).is_some())
        };
        if let Some((word, span)) = self.keys().find(stands_for_it) {
            let message = format!("{} has no key `{word}`", self.title);
            return self.document.source.error(&span, message, format!("did you mean `{key}`?"));
        }
        let message = format!("{} has no `{key}`", self.title);
        self.here(message, format!("expected `{key}`: {expected}"))
    }

    /// An error at this table.
    pub fn here(&self, message: impl Into<String>, expected: impl Into<String>) -> Diagnostic {
        self.document.source.error(&self.span, message, expected)
    }

    /// The tables of the list `key`; none if it is absent.
    pub fn tables(&self, key: &str) -> Result<Vec<Table<'t>>, Diagnostic> {
        let Some(list) = self.get(key) else { return Ok(Vec::new()) };
        let expected = format!(
            "expected a list of tables, each headed `[[{key}]]`, or {key} = [{{ ... }}, ...]"
        );
        let DeValue::Array(elements) = list.value else { return Err(list.wrong_type(&expected)) };
        let ValueType::Tables(section) = list.row.value_type else {
            panic!("`{key}` is a list of tables")
        };
        let element = |(index, element): (usize, &'t toml::Spanned<DeValue<'t>>)| {
            let title = format!("{key} {}", index + 1);
            let DeValue::Table(entries) = element.get_ref() else {
                let message = format!("{title} is {}", with_article(element.get_ref()));
                return Err(self.document.source.error(&element.span(), message, &expected));
            };
            let table = self.document.table(section, Some(entries), element.span());
            Ok(table.named(&format!("{key}.{index}"), &title))
        };
        elements.iter().enumerate().map(element).collect()
    }

    /// The tables in the table `key`, by their names; none if it is absent.
    pub fn named_tables(&self, key: &str) -> Result<Vec<(&'t str, Table<'t>)>, Diagnostic> {
        let Some(named) = self.get(key) else { return Ok(Vec::new()) };
        let ValueType::NamedTables(section) = named.row.value_type else {
            panic!("`{key}` has tables")
        };
        let expected = format!("expected a table with a name of its own, headed `[{key}.NAME]`");
        let DeValue::Table(tables) = named.value else { return Err(named.wrong_type(&expected)) };
        let mut found = Vec::new();
        for (name, value) in tables {
            let path = format!("{key}.{}", name.get_ref());
            let DeValue::Table(entries) = value.get_ref() else {
                let message = format!("`{path}` is {}", with_article(value.get_ref()));
                return Err(self.document.source.error(&value.span(), message, expected));
            };
            let table = self.document.table(section, Some(entries), value.span());
            let table = table.named(&path, &format!("[{path}]"));
            table.only()?;
            found.push((name.get_ref().as_ref(), table));
        }
        Ok(found)
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}

impl<'t> Value<'t> {
    /// An error at this value.
    pub fn here(&self, message: impl Into<String>, expected: impl Into<String>) -> Diagnostic {
        self.document.source.error(&self.span, message, expected)
    }

    /// An error at this value: `message` says what is wrong with the key named before it.
    pub fn wrong(
        &self,
        message: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.document.source.error(&self.span, format!("`{}` {message}", self.key), expected)
    }

    /// Where it stands.
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// Returns the file, line and column of another value of the same text.
    pub fn location(&self, span: &Range<usize>) -> String {
        self.document.source.location(span)
    }

    /// What is found at `path` stands here; whoever looks for its parents finds them here too.
    pub fn is_at(&self, path: &str) {
        let mut places = self.document.places.borrow_mut();
        let mut path = path;
        places.insert(path.to_owned(), self.span.clone());
        while let Some((parent, _)) = path.rsplit_once('.') {
            path = parent;
            places.entry(path.to_owned()).or_insert_with(|| self.span.clone());
        }
    }

    /// The table that this value is.
    pub fn table(&self) -> Result<Table<'t>, Diagnostic> {
        let ValueType::Table(section) = self.row.value_type else {
            panic!("`{}` is a table", self.key)
        };
        let DeValue::Table(entries) = self.value else {
            let keys = &self.document.format.section(section).keys;
            let names: Vec<&str> = keys.iter().map(|key| key.name).collect();
            return Err(self.wrong_type(&format!("expected a table of {}", names.join(", "))));
        };
        let title = match self.path == self.key {
            true => format!("[{}]", self.key),
            false => format!("`{}`", self.key),
        };
        let table = self.document.table(section, Some(entries), self.span());
        let table = Table { path: self.path.clone(), title, ..table };
        table.only()?;
        Ok(table)
    }

    /// A string.
    pub fn text(&self, expected: &str) -> Result<&'t str, Diagnostic> {
        match self.value {
            DeValue::String(text) => Ok(text.as_ref()),
            _ => Err(self.wrong_type(expected)),
        }
    }

    /// A list of strings.
    pub fn texts(&self, expected: &str) -> Result<Vec<String>, Diagnostic> {
        let elements = self.elements(expected)?.into_iter();
        elements.map(|element| Ok(element.text(expected)?.to_owned())).collect()
    }

    /// What its word means, one of these.
    pub fn word<T: Copy>(&self, words: &[(&str, T)]) -> Result<T, Diagnostic> {
        let list: Vec<String> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        let expected = match &list[..] {
            [only] => format!("expected {only}"),
            list => format!("expected one of {}", list.join(", ")),
        };
        let text = self.text(&expected)?;
        match words.iter().find(|(word, _)| *word == text) {
            Some((_, meaning)) => Ok(*meaning),
            None => {
                let close = meant(text, words.iter().map(|&(word, _)| word));
                let close = close.map(|close| format!("did you mean \"{close}\"?"));
                Err(self.wrong(format!("is \"{text}\""), close.unwrap_or(expected)))
            }
        }
    }

    /// A number, in the unit and range of its row.
    pub fn number(&self) -> Result<f64, Diagnostic> {
        match self.row.value_type {
            ValueType::Number(range) => self.within(range),
            _ => panic!("`{}` is a number", self.key),
        }
    }

    /// A time in seconds, in the range of its row, as whole nanoseconds.
    pub fn time_ns(&self) -> Result<u64, Diagnostic> {
        match self.row.value_type {
            ValueType::Time(range) => self.whole_nanoseconds(self.within(range)?),
            ValueType::Times => self.whole_nanoseconds(self.within(Numbers::NotNegative)?),
            _ => panic!("`{}` is a time", self.key),
        }
    }

    /// A list of times in seconds, from 0, each with its place, as whole nanoseconds.
    pub fn times_ns(&self) -> Result<Vec<(Value<'t>, u64)>, Diagnostic> {
        let times = self.elements("expected a list of times in seconds: [120.0, 300.0]")?;
        times.into_iter().map(|time| time.time_ns().map(|ns| (time, ns))).collect()
    }

    fn within(&self, range: Numbers) -> Result<f64, Diagnostic> {
        let (number, unit) = (self.finite()?, self.row.unit());
        let expected = match range {
            Numbers::Positive if number <= 0.0 => {
                format!("expected a number{} above 0", in_unit(unit))
            }
            Numbers::NotZero if number == 0.0 => {
                format!("expected a number{} other than 0", in_unit(unit))
            }
            Numbers::NotNegative if number < 0.0 => format!("expected 0{} or more", spaced(unit)),
            _ => return Ok(number),
        };
        Err(self.wrong(format!("is {}", Shown(number)), expected))
    }

    /// A finite number of sane size.
    fn finite(&self) -> Result<f64, Diagnostic> {
        let unit = self.row.unit();
        let expected = format!("expected a number{}", in_unit(unit));
        let (number, text) = match self.value {
            DeValue::Float(float) => (float.as_str().parse::<f64>().ok(), float.to_string()),
            DeValue::Integer(integer) => (
                i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|n| n as f64),
                integer.to_string(),
            ),
            _ => return Err(self.wrong_type(&expected)),
        };
        match number {
            Some(number) if number.abs() <= NUMBER_MAX => Ok(number),
            Some(number) if !number.is_finite() => Err(self
                .wrong(format!("is {text}"), format!("expected a finite number{}", in_unit(unit)))),
            _ => Err(self.wrong(
                format!("is {text}"),
                format!("expected a number{} of at most 1e9 in size", in_unit(unit)),
            )),
        }
    }

    fn whole_nanoseconds(&self, seconds: f64) -> Result<u64, Diagnostic> {
        if seconds > SECONDS_MAX {
            return Err(
                self.wrong(format!("is {}", Shown(seconds)), "expected at most 1e7 s (115 days)")
            );
        }
        let ns = seconds * 1e9;
        // Beyond some seconds, the spacing of floating-point numbers is the coarser bound.
        let tolerance = NANOSECOND_TOLERANCE.max(2.0 * ns * f64::EPSILON);
        if (ns - ns.round()).abs() > tolerance || (seconds > 0.0 && ns < 0.5) {
            return Err(self.wrong(
                format!("is {}", Shown(seconds)),
                format!(
                    "expected a whole number of nanoseconds, such as {:.9}",
                    ns.round().max(1.0) * 1e-9
                ),
            ));
        }
        Ok(ns.round() as u64)
    }

    /// A whole number, within the bounds of its row.
    pub fn whole(&self) -> Result<u64, Diagnostic> {
        let (least, most, or) = match self.row.value_type {
            ValueType::Whole(least, most) => (least, most, ""),
            ValueType::NamesOrCount => {
                (0, i64::MAX as u64, ", or names of robots: [\"r1\", \"r2\"]")
            }
            _ => panic!("`{}` is a whole number", self.key),
        };
        let expected = match or {
            "" => format!("expected a whole number from {least} to {most}"),
            or => format!("expected a whole number of robots{or}"),
        };
        let DeValue::Integer(integer) = self.value else {
            return match self.value {
                DeValue::Float(float) => Err(self.wrong(format!("is {float}"), expected)),
                _ => Err(self.wrong_type(&expected)),
            };
        };
        match u64::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(number) if (least..=most).contains(&number) => Ok(number),
            _ => Err(self.wrong(format!("is {integer}"), expected)),
        }
    }

    /// True or false.
    pub fn truth(&self) -> Result<bool, Diagnostic> {
        match self.value {
            DeValue::Boolean(truth) => Ok(*truth),
            _ => Err(self.wrong_type("expected true or false")),
        }
    }

    /// What it is, as it stands there.
    pub fn raw(&self) -> &'t DeValue<'t> {
        self.value
    }

    /// The same value, which messages name so.
    pub fn named(self, key: &str) -> Value<'t> {
        Value { key: key.to_owned(), ..self }
    }

    /// What a table has in it, whatever its keys are, in their order.
    pub fn entries(&self, expected: &str) -> Result<Vec<(String, Value<'t>)>, Diagnostic> {
        let DeValue::Table(table) = self.value else { return Err(self.wrong_type(expected)) };
        let entries = table.iter().map(|(key, value)| {
            let (key, span) = (key.get_ref().clone().into_owned(), value.span());
            let value = Value { key: key.clone(), value: value.get_ref(), span, ..self.clone() };
            (key, value)
        });
        Ok(entries.collect())
    }

    /// Whether it is a list.
    pub fn is_list(&self) -> bool {
        matches!(self.value, DeValue::Array(_))
    }

    /// The elements of a list; messages count them from 1.
    pub fn elements(&self, expected: &str) -> Result<Vec<Value<'t>>, Diagnostic> {
        let DeValue::Array(list) = self.value else { return Err(self.wrong_type(expected)) };
        let elements = list.iter().enumerate().map(|(index, element)| Value {
            key: format!("{} ({})", self.key, index + 1),
            value: element.get_ref(),
            span: element.span(),
            ..self.clone()
        });
        Ok(elements.collect())
    }

    /// Points, `[[x, y], ...]`, each with its place.
    pub fn points(&self) -> Result<Vec<(Value<'t>, [f64; 2])>, Diagnostic> {
        let points = self.elements("expected a list of points: [[0.0, 0.0], [1.0, 0.5]]")?;
        points.into_iter().map(|point| point.pair().map(|pair| (point, pair))).collect()
    }

    /// Two numbers, `[x, y]`, in the unit of its row.
    pub fn pair(&self) -> Result<[f64; 2], Diagnostic> {
        let expected = format!("expected two numbers{}: [x, y]", in_unit(self.row.unit()));
        let [x, y] = <[Value<'t>; 2]>::try_from(self.elements(&expected)?).map_err(|list| {
            let plural = if list.len() == 1 { "" } else { "s" };
            self.wrong(format!("has {} element{plural}", list.len()), &expected)
        })?;
        let component = |element: Value<'t>, name: &str| {
            Value { key: format!("{} ({name})", self.key), ..element }.finite()
        };
        Ok([component(x, "x")?, component(y, "y")?])
    }

    /// That this value is of another type than `expected`.
    pub fn wrong_type(&self, expected: &str) -> Diagnostic {
        self.wrong(format!("is {}", with_article(self.value)), expected)
    }
}

fn spaced(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

fn in_unit(unit: &str) -> String {
    match unit {
        "" => String::new(),
        "m" => " of meters".to_owned(),
        "s" => " of seconds".to_owned(),
        "rad" => " of radians".to_owned(),
        unit => format!(" in {unit}"),
    }
}

/// What a value is, as people say it.
fn with_article(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// A value in TOML, on one line.
pub(crate) fn spelled(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => toml::Value::String(text.clone().into_owned()).to_string(),
        DeValue::Integer(integer) => integer.to_string(),
        DeValue::Float(float) => float.to_string(),
        DeValue::Boolean(truth) => truth.to_string(),
        DeValue::Datetime(date) => date.to_string(),
        DeValue::Array(list) => {
            let list: Vec<String> = list.iter().map(|value| spelled(value.get_ref())).collect();
            format!("[{}]", list.join(", "))
        }
        DeValue::Table(table) if table.is_empty() => "{}".to_owned(),
        DeValue::Table(table) => {
            let entries = table.iter();
            let entries = entries
                .map(|(key, value)| format!("{} = {}", key.get_ref(), spelled(value.get_ref())));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use protocol::catalog::Catalog;

    use super::*;
    use crate::scenario::diagnostic::Severity;

    /// Reads the key `period_s`, once called `step_s`, of a text.
    fn period_of(text: &str) -> (Result<f64, Diagnostic>, Vec<Diagnostic>) {
        let mut format = Format::new(&Catalog { laws: Vec::new(), methods: Vec::new() });
        let keys = &mut format.sections[0].keys;
        keys.iter_mut().find(|key| key.name == "period_s").unwrap().old_names = &["step_s"];
        let document = Document::new(Source::new(Path::new("t.toml"), text, false), &format);
        let entries = DeTable::parse(text).unwrap();
        let root = Table::root(&document, entries.get_ref(), "the scenario");
        let period = root.only().and_then(|()| root.need("period_s")?.seconds());
        (period, document.warnings.take())
    }

    impl Value<'_> {
        fn seconds(&self) -> Result<f64, Diagnostic> {
            self.time_ns().map(|ns| ns as f64 / 1e9)
        }
    }

    #[test]
    fn an_old_name_of_a_key_is_read_with_a_warning_that_names_the_new_one() {
        assert_eq!(period_of("period_s = 0.5"), (Ok(0.5), Vec::new()));
        let (period, warnings) = period_of("name = \"a\"\nstep_s = 0.5");
        assert_eq!((period, warnings.len()), (Ok(0.5), 1));
        assert_eq!((warnings[0].severity, warnings[0].line), (Severity::Warning, 2));
        assert_eq!(warnings[0].message, "`step_s` is called `period_s` now");
        let (both, _) = period_of("step_s = 0.5\nperiod_s = 0.5");
        assert!(both.unwrap_err().message.contains("`period_s` and `step_s`, its old name"));
        assert!(period_of("step_s = -1").0.unwrap_err().message.contains("is -1"));
    }
}
