//! Values of a TOML text together with their places, so that every mistake can be pointed at.
//!
//! [`Table`] and [`Value`] know types, units and ranges; they know no scenario.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;

use toml::de::{DeTable, DeValue};

use super::diagnostic::{Diagnostic, Source, meant};

/// Largest magnitude of any number, in its unit: what is larger is a slip of the keyboard, and
/// squares of it would leave the range of exact arithmetic.
const NUMBER_MAX: f64 = 1e9;
/// Longest time, s: 115 days. Sums and hundredfolds of it still fit into 64 bits of nanoseconds.
const SECONDS_MAX: f64 = 1e7;
/// A time may miss a whole nanosecond by this much, ns.
const NANOSECOND_TOLERANCE: f64 = 1e-6;

/// Where each key was found, by its path: `avoidance.kind`, `robot.r1.pose`, `edge.0`.
pub(crate) type Places = BTreeMap<String, Range<usize>>;

/// The text, and the places found in it so far.
#[derive(Debug)]
pub(crate) struct Document {
    /// The text.
    pub(crate) source: Source,
    /// Where things are.
    pub(crate) places: RefCell<Places>,
}

/// A table, under the path by which people would name it.
#[derive(Debug, Clone)]
pub(crate) struct Table<'t> {
    document: &'t Document,
    path: String,
    /// What to call it: `[avoidance]`, `robot r1`.
    title: String,
    entries: &'t DeTable<'t>,
    span: Range<usize>,
}

/// A value and its place.
#[derive(Debug, Clone)]
pub(crate) struct Value<'t> {
    document: &'t Document,
    /// The key's path.
    path: String,
    /// The key as messages name it.
    key: String,
    value: &'t DeValue<'t>,
    span: Range<usize>,
}

impl<'t> Table<'t> {
    /// The whole document.
    pub(crate) fn root(document: &'t Document, entries: &'t DeTable<'t>) -> Table<'t> {
        let title = "the scenario".to_owned();
        Table { document, path: String::new(), title, entries, span: 0..0 }
    }

    /// The same table under another path and title: a list's element, once its name is known.
    pub(crate) fn named(mut self, path: &str, title: &str) -> Table<'t> {
        self.document.places.borrow_mut().insert(path.to_owned(), self.span.clone());
        self.path = path.to_owned();
        self.title = title.to_owned();
        self
    }

    /// Refuses keys that are not `known`.
    pub(crate) fn only(&self, known: &[&str]) -> Result<(), Diagnostic> {
        let mut unknown: Vec<_> = self
            .entries
            .iter()
            .filter(|(key, _)| !known.contains(&key.get_ref().as_ref()))
            .collect();
        unknown.sort_by_key(|(key, _)| key.span().start);
        let Some((key, _)) = unknown.first() else { return Ok(()) };
        let word = key.get_ref().as_ref();
        let expected = match meant(word, known.iter().copied()) {
            Some(close) => format!("did you mean `{close}`?"),
            None => format!("expected one of {}", known.join(", ")),
        };
        let message = format!("{} has no key `{word}`", self.title);
        Err(self.document.source.error(&key.span(), message, expected))
    }

    /// Where it stands; with a header, only that.
    pub(crate) fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// The keys that are there, with their places.
    pub(crate) fn keys(&self) -> impl Iterator<Item = (&'t str, Range<usize>)> {
        self.entries.iter().map(|(key, _)| (key.get_ref().as_ref(), key.span()))
    }

    /// The value of `key`, if it is there.
    pub(crate) fn get(&self, key: &str) -> Option<Value<'t>> {
        let found = self.entries.get(key)?;
        let path = self.path_of(key);
        self.document.places.borrow_mut().insert(path.clone(), found.span());
        Some(Value {
            document: self.document,
            path,
            key: key.to_owned(),
            value: found.get_ref(),
            span: found.span(),
        })
    }

    /// The value of `key`; without it, `expected` says what to add.
    pub(crate) fn need(&self, key: &str, expected: &str) -> Result<Value<'t>, Diagnostic> {
        self.get(key).ok_or_else(|| self.missing(key, expected))
    }

    /// The value of `key`, or else the one that `defaults` has.
    pub(crate) fn get_or(&self, defaults: Option<&Table<'t>>, key: &str) -> Option<Value<'t>> {
        self.get(key).or_else(|| {
            let value = defaults?.get(key)?;
            self.document.places.borrow_mut().insert(self.path_of(key), value.span.clone());
            Some(value)
        })
    }

    /// That `key` is not there.
    pub(crate) fn missing(&self, key: &str, expected: &str) -> Diagnostic {
        let message = format!("{} has no `{key}`", self.title);
        self.here(message, format!("expected `{key}`: {expected}"))
    }

    /// An error at this table.
    pub(crate) fn here(&self, message: String, expected: String) -> Diagnostic {
        self.document.source.error(&self.span, message, expected)
    }

    /// The tables of the list `key`; none if it is absent.
    pub(crate) fn tables(&self, key: &str) -> Result<Vec<Table<'t>>, Diagnostic> {
        let Some(list) = self.get(key) else { return Ok(Vec::new()) };
        let expected = format!(
            "expected a list of tables, each headed `[[{key}]]`, or {key} = [{{ ... }}, ...]"
        );
        let DeValue::Array(elements) = list.value else { return Err(list.wrong_type(&expected)) };
        let element = |(index, element): (usize, &'t toml::Spanned<DeValue<'t>>)| {
            let title = format!("{key} {}", index + 1);
            match element.get_ref() {
                DeValue::Table(entries) => Ok(Table {
                    document: self.document,
                    path: String::new(),
                    title: title.clone(),
                    entries,
                    span: element.span(),
                }
                .named(&format!("{key}.{index}"), &title)),
                other => {
                    let message = format!("{title} is {}", with_article(other));
                    Err(self.document.source.error(&element.span(), message, expected.clone()))
                }
            }
        };
        elements.iter().enumerate().map(element).collect()
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}

impl<'t> Value<'t> {
    /// An error at this value.
    pub(crate) fn here(&self, message: String, expected: String) -> Diagnostic {
        self.document.source.error(&self.span, message, expected)
    }

    /// An error at this value: `message` says what is wrong with the key named before it.
    pub(crate) fn wrong(
        &self,
        message: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.document.source.error(&self.span, format!("`{}` {message}", self.key), expected)
    }

    /// Where it stands.
    pub(crate) fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// What is found at `path` stands here; whoever looks for its parents finds them here too.
    pub(crate) fn is_at(&self, path: &str) {
        let mut places = self.document.places.borrow_mut();
        let mut path = path;
        places.insert(path.to_owned(), self.span.clone());
        while let Some((parent, _)) = path.rsplit_once('.') {
            path = parent;
            places.entry(path.to_owned()).or_insert_with(|| self.span.clone());
        }
    }

    /// The table that this value is.
    pub(crate) fn table(&self, known: &[&str]) -> Result<Table<'t>, Diagnostic> {
        let DeValue::Table(entries) = self.value else {
            return Err(self.wrong_type(&format!("expected a table of {}", known.join(", "))));
        };
        let table = Table {
            document: self.document,
            path: self.path.clone(),
            title: if self.path == self.key {
                format!("[{}]", self.key)
            } else {
                format!("`{}`", self.key)
            },
            entries,
            span: self.span.clone(),
        };
        table.only(known)?;
        Ok(table)
    }

    /// A string.
    pub(crate) fn text(&self, expected: &str) -> Result<&'t str, Diagnostic> {
        match self.value {
            DeValue::String(text) => Ok(text.as_ref()),
            _ => Err(self.wrong_type(expected)),
        }
    }

    /// True or false.
    pub(crate) fn boolean(&self) -> Result<bool, Diagnostic> {
        match self.value {
            DeValue::Boolean(boolean) => Ok(*boolean),
            _ => Err(self.wrong_type("expected true or false")),
        }
    }

    /// One of the `words`.
    pub(crate) fn word<T: Copy>(&self, words: &[(&str, T)]) -> Result<T, Diagnostic> {
        let list: Vec<String> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        let expected = match &list[..] {
            [only] => format!("expected {only}"),
            list => format!("expected one of {}", list.join(", ")),
        };
        let text = self.text(&expected)?;
        match words.iter().find(|(word, _)| *word == text) {
            Some((_, meaning)) => Ok(*meaning),
            None => Err(self.wrong(format!("is \"{text}\""), expected)),
        }
    }

    /// A finite number of sane size; `unit` for the message.
    pub(crate) fn number(&self, unit: &str) -> Result<f64, Diagnostic> {
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

    /// A number above 0.
    pub(crate) fn positive(&self, unit: &str) -> Result<f64, Diagnostic> {
        let number = self.number(unit)?;
        if number > 0.0 {
            return Ok(number);
        }
        Err(self
            .wrong(format!("is {number}"), format!("expected a number{} above 0", in_unit(unit))))
    }

    /// A number from 0 on.
    pub(crate) fn not_negative(&self, unit: &str) -> Result<f64, Diagnostic> {
        let number = self.number(unit)?;
        if number >= 0.0 {
            return Ok(number);
        }
        Err(self.wrong(
            format!("is {number}"),
            format!("expected 0{unit_space} or more", unit_space = spaced(unit)),
        ))
    }

    /// A time in seconds, above 0, as whole nanoseconds.
    pub(crate) fn duration_ns(&self) -> Result<u64, Diagnostic> {
        let seconds = self.positive("s")?;
        self.whole_nanoseconds(seconds)
    }

    /// A time in seconds, from 0 on, as whole nanoseconds.
    pub(crate) fn instant_ns(&self) -> Result<u64, Diagnostic> {
        let seconds = self.not_negative("s")?;
        self.whole_nanoseconds(seconds)
    }

    fn whole_nanoseconds(&self, seconds: f64) -> Result<u64, Diagnostic> {
        if seconds > SECONDS_MAX {
            return Err(self.wrong(format!("is {seconds}"), "expected at most 1e7 s (115 days)"));
        }
        let ns = seconds * 1e9;
        // Beyond some seconds, the spacing of floating-point numbers is the coarser bound.
        let tolerance = NANOSECOND_TOLERANCE.max(2.0 * ns * f64::EPSILON);
        if (ns - ns.round()).abs() > tolerance {
            return Err(self.wrong(
                format!("is {seconds}"),
                format!(
                    "expected a whole number of nanoseconds, such as {:.9}",
                    ns.round().max(1.0) * 1e-9
                ),
            ));
        }
        Ok(ns.round() as u64)
    }

    /// A whole number within bounds.
    pub(crate) fn integer(&self, least: u64, most: u64) -> Result<u64, Diagnostic> {
        let expected = format!("expected a whole number from {least} to {most}");
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
    pub(crate) fn truth(&self) -> Result<bool, Diagnostic> {
        match self.value {
            DeValue::Boolean(truth) => Ok(*truth),
            _ => Err(self.wrong_type("expected true or false")),
        }
    }

    /// The elements of a list; messages count them from 1.
    pub(crate) fn elements(&self, expected: &str) -> Result<Vec<Value<'t>>, Diagnostic> {
        let DeValue::Array(list) = self.value else { return Err(self.wrong_type(expected)) };
        let element = |(index, element): (usize, &'t toml::Spanned<DeValue<'t>>)| Value {
            document: self.document,
            path: self.path.clone(),
            key: format!("{} ({})", self.key, index + 1),
            value: element.get_ref(),
            span: element.span(),
        };
        Ok(list.iter().enumerate().map(element).collect())
    }

    /// Two numbers, `[x, y]`.
    pub(crate) fn pair(&self, unit: &str) -> Result<[f64; 2], Diagnostic> {
        let expected = format!("expected two numbers{}: [x, y]", in_unit(unit));
        let [x, y] = <[Value<'t>; 2]>::try_from(self.elements(&expected)?).map_err(|list| {
            let plural = if list.len() == 1 { "" } else { "s" };
            self.wrong(format!("has {} element{plural}", list.len()), &expected)
        })?;
        let component = |element: Value<'t>, name: &str| {
            Value { key: format!("{} ({name})", self.key), ..element }.number(unit)
        };
        Ok([component(x, "x")?, component(y, "y")?])
    }

    /// That this value is of another type than `expected`.
    pub(crate) fn wrong_type(&self, expected: &str) -> Diagnostic {
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
