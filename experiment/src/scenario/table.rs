//! TOML values with their source locations, so that every diagnostic can point at its cause.
//!
//! [`TableReader`] and [`TypedValue`] take types, units, ranges and defaults from the rows of `keys`. A key is named by
//! its constant, so that a request for a key that its table does not have, or for a value of another type, does not
//! compile.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::ops::Range;

use serde::de::value::{Error, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer as _};
use toml::de::{DeTable, DeValue};

use super::diagnostic::{Diagnostic, DisplayedNumber, SourceText, most_similar_word};
use super::fields::{HasGroup, TableFormat, TypedKey, kinds};
use super::format::{FileFormat, IfMissing, KeySpec, NumberRange as Numbers, Section, ValueType};

/// Maximum magnitude of a number, in its unit. A larger one is assumed to be a typing error, and its square would
/// exceed the range of exact arithmetic.
pub const NUMBER_MAX: f64 = 1e9;
/// Maximum time, s (115 days). Sums and 100 times this value fit into 64 bits of nanoseconds.
pub const SECONDS_MAX: f64 = 1e7;
/// Maximum deviation of a time from a whole number of nanoseconds, ns.
const NANOSECOND_TOLERANCE: f64 = 1e-6;

/// Source location of each key, by its path: `avoidance.kind`, `robot.r1.pose`, `edge.0`.
pub type KeySpans = BTreeMap<String, Range<usize>>;

/// A text and the source locations found in it so far.
#[derive(Debug)]
pub struct Document<'f> {
    /// Text of the document.
    pub source: SourceText,
    /// Format that defines the allowed keys.
    format: &'f FileFormat,
    /// Source locations by path.
    pub key_locations: RefCell<KeySpans>,
    /// Warnings about former names of keys.
    pub warnings: RefCell<Vec<Diagnostic>>,
}

impl<'f> Document<'f> {
    /// Creates a document of which nothing has been parsed.
    pub fn new(source: SourceText, format: &'f FileFormat) -> Document<'f> {
        Document { source, format, key_locations: RefCell::default(), warnings: RefCell::default() }
    }
}

/// A table of the format `S`.
#[derive(Debug)]
pub struct TableReader<'t, S> {
    entries: TableEntries<'t>,
    marker: PhantomData<fn() -> S>,
}

impl<S> Clone for TableReader<'_, S> {
    fn clone(&self) -> Self {
        TableReader::from_entries(self.entries.clone())
    }
}

/// Entries of a table, with their path.
#[derive(Debug, Clone)]
struct TableEntries<'t> {
    document: &'t Document<'t>,
    path: String,
    /// Name in messages: `[avoidance]`, `robot r1`.
    title: String,
    section: &'t Section,
    /// Entries. `None` if the table is not given.
    table: Option<&'t DeTable<'t>>,
    /// Table that supplies keys which this one does not have.
    defaults: Option<Box<TableEntries<'t>>>,
    span: Range<usize>,
}

/// A point `[x, y]`, with its value.
pub type LocatedPoint<'t, T> = (TypedValue<'t, T>, [f64; 2]);

/// A value of the type `T`, one of [`kinds`], and its source location.
#[derive(Debug)]
pub struct TypedValue<'t, T> {
    document: &'t Document<'t>,
    /// Path of the key.
    path: String,
    /// Name of the key in messages.
    key: String,
    row: &'t KeySpec,
    value: &'t DeValue<'t>,
    span: Range<usize>,
    marker: PhantomData<fn() -> T>,
}

impl<T> Clone for TypedValue<'_, T> {
    fn clone(&self) -> Self {
        TypedValue {
            document: self.document,
            path: self.path.clone(),
            key: self.key.clone(),
            row: self.row,
            value: self.value,
            span: self.span.clone(),
            marker: PhantomData,
        }
    }
}

impl<'t> Document<'t> {
    /// Returns a table of the text without a path and a title.
    fn entries(
        &'t self,
        section: &str,
        table: Option<&'t DeTable<'t>>,
        span: Range<usize>,
    ) -> TableEntries<'t> {
        let (document, section) = (self, self.format.section(section));
        let (path, title) = (String::new(), String::new());
        TableEntries { document, path, title, section, table, defaults: None, span }
    }
}

impl<'t, S> TableReader<'t, S> {
    fn from_entries(entries: TableEntries<'t>) -> TableReader<'t, S> {
        TableReader { entries, marker: PhantomData }
    }

    /// Adds `defaults`, which supplies keys that the table does not have.
    pub fn with_defaults<D>(mut self, defaults: Option<TableReader<'t, D>>) -> TableReader<'t, S> {
        self.entries.defaults = defaults.map(|defaults| Box::new(defaults.entries));
        self
    }

    /// Sets the path and the title, for an element of a list once its name is known.
    pub fn with_title(self, path: &str, title: &str) -> TableReader<'t, S> {
        TableReader::from_entries(self.entries.with_title(path, title))
    }

    /// Checks that the table has only known keys, and warns about former names.
    pub fn check_keys(&self) -> Result<(), Diagnostic> {
        self.entries.check_keys()
    }

    /// Returns the value of `kind`. Returns an error if the table has a key that this kind does not allow.
    pub fn kind(&self) -> Result<&'static str, Diagnostic> {
        let word = self.kind_unchecked()?;
        let kinds = self.entries.section.kinds.iter().filter(|kind| kind.name == word);
        let kinds: Vec<_> = kinds.collect();
        let allows = |key: &KeySpec| kinds.iter().any(|kind| kind.allows_key(key.name));
        self.entries.check_allowed_keys(&allows, false)?;
        Ok(word)
    }

    /// Returns the value of `kind` without checking the other keys.
    pub fn kind_unchecked(&self) -> Result<&'static str, Diagnostic> {
        let words = self.entries.section.kind_names().into_iter().map(|word| (word, word));
        let words: Vec<_> = words.collect();
        self.entries.required_value("kind")?.parse_word(&words)
    }

    /// Checks that the table has only `kind` and these keys.
    pub fn check_kind_and_keys(&self, keys: &[&str]) -> Result<(), Diagnostic> {
        self.entries.check_allowed_keys(&|key: &KeySpec| keys.contains(&key.name), false)
    }

    /// Records this table as the source location of `path`.
    pub fn record_location(&self, path: &str) {
        let mut locations = self.entries.document.key_locations.borrow_mut();
        locations.insert(path.to_owned(), self.entries.span.clone());
    }

    /// Returns the source range of the table: its header, if it has one.
    pub fn span(&self) -> Range<usize> {
        self.entries.span.clone()
    }

    /// Returns the given keys with their source ranges.
    pub fn keys(&self) -> impl Iterator<Item = (&'t str, Range<usize>)> + use<'t, S> {
        self.entries.keys()
    }

    /// Returns an error at this table.
    pub fn error_at_table(
        &self,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.entries.error_at_table(message, expected)
    }

    /// Returns the value of a key from the table or from its defaults, or `None`.
    pub fn get<G, T>(&self, field: TypedKey<G, T>) -> Option<TypedValue<'t, T>>
    where
        S: HasGroup<G>,
    {
        self.entries.get(field.name()).map(TypedValue::cast)
    }

    /// Returns the value of a key, or the default of its row. Returns an error if there is neither.
    pub fn required_value<G, T>(
        &self,
        field: TypedKey<G, T>,
    ) -> Result<TypedValue<'t, T>, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.entries.required_value(field.name()).map(TypedValue::cast)
    }

    /// Returns the number of a key, or its default.
    pub fn number<G>(&self, field: TypedKey<G, kinds::Number>) -> Result<f64, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.required_value(field)?.number()
    }

    /// Returns the number of a key, or `None` if it is not given.
    pub fn optional_number<G>(
        &self,
        field: TypedKey<G, kinds::Number>,
    ) -> Result<Option<f64>, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.get(field).map(|value| value.number()).transpose()
    }

    /// Returns the time of a key, or its default, ns.
    pub fn time_ns<G>(&self, field: TypedKey<G, kinds::Time>) -> Result<u64, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.required_value(field)?.time_ns()
    }

    /// Returns the time of a key, ns, or `None` if it is not given.
    pub fn optional_time_ns<G>(
        &self,
        field: TypedKey<G, kinds::Time>,
    ) -> Result<Option<u64>, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.get(field).map(|value| value.time_ns()).transpose()
    }

    /// Returns the integer of a key, or its default.
    pub fn integer<G>(&self, field: TypedKey<G, kinds::Integer>) -> Result<u64, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.required_value(field)?.integer()
    }

    /// Returns the boolean of a key, or its default.
    pub fn boolean<G>(&self, field: TypedKey<G, kinds::Boolean>) -> Result<bool, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.required_value(field)?.boolean()
    }

    /// Returns the meaning of the word of a key, or of its default.
    pub fn read_word<G, W: DeserializeOwned>(
        &self,
        field: TypedKey<G, kinds::Word<W>>,
    ) -> Result<W, Diagnostic>
    where
        S: HasGroup<G>,
    {
        self.required_value(field)?.read_word()
    }

    /// Returns the value of the gain `key` of a law or a method, or `None` if it is not given. The catalog of laws and
    /// methods names the gains, and they have rows in the format. `range`: lowest and highest value; `None` for any
    /// above 0.
    pub fn gain(&self, key: &str, range: Option<[f64; 2]>) -> Result<Option<f64>, Diagnostic> {
        let Some(value) = self.entries.get(key) else { return Ok(None) };
        let gain = match value.row.value_type {
            ValueType::Integer(..) => value.clone().cast::<kinds::Integer>().integer()? as f64,
            _ => value.clone().cast::<kinds::Number>().number()?,
        };
        let (is_within, expected) = match range {
            None => (gain > 0.0, "expected a number above 0".to_owned()),
            Some([lowest, highest]) => (
                (lowest..=highest).contains(&gain),
                format!(
                    "expected a number from {} to {}",
                    DisplayedNumber(lowest),
                    DisplayedNumber(highest)
                ),
            ),
        };
        match is_within {
            true => Ok(Some(gain)),
            false => Err(value.error_about_key(format!("is {}", DisplayedNumber(gain)), expected)),
        }
    }

    /// Returns the table of a key, or an empty one if it is not given.
    pub fn table<G, I: TableFormat>(
        &self,
        field: TypedKey<G, kinds::Table<I>>,
    ) -> Result<TableReader<'t, I>, Diagnostic>
    where
        S: HasGroup<G>,
    {
        if let Some(value) = self.get(field) {
            return value.table();
        }
        let (parent, key) = (&self.entries, field.name());
        let table = parent.document.entries(I::NAME, None, self.span());
        Ok(TableReader::from_entries(TableEntries {
            path: parent.path_of(key),
            title: format!("[{key}]"),
            ..table
        }))
    }

    /// Returns the tables of a list. Empty if it is not given.
    pub fn tables<G, I: TableFormat>(
        &self,
        field: TypedKey<G, kinds::Tables<I>>,
    ) -> Result<Vec<TableReader<'t, I>>, Diagnostic>
    where
        S: HasGroup<G>,
    {
        let (document, key) = (self.entries.document, field.name());
        let Some(list) = self.get(field) else { return Ok(Vec::new()) };
        let expected = format!(
            "expected a list of tables, each headed `[[{key}]]`, or {key} = [{{ ... }}, ...]"
        );
        let DeValue::Array(elements) = list.value else {
            return Err(list.wrong_type_error(&expected));
        };
        let element = |(index, element): (usize, &'t toml::Spanned<DeValue<'t>>)| {
            let title = format!("{key} {}", index + 1);
            let DeValue::Table(entries) = element.get_ref() else {
                let message = format!("{title} is {}", type_with_article(element.get_ref()));
                return Err(document.source.error_at(&element.span(), message, &expected));
            };
            let table = document.entries(I::NAME, Some(entries), element.span());
            Ok(TableReader::from_entries(table.with_title(&format!("{key}.{index}"), &title)))
        };
        elements.iter().enumerate().map(element).collect()
    }

    /// Returns the named tables in the table of a key. Empty if it is not given.
    pub fn named_tables<G, I: TableFormat>(
        &self,
        field: TypedKey<G, kinds::NamedTables<I>>,
    ) -> Result<Vec<(&'t str, TableReader<'t, I>)>, Diagnostic>
    where
        S: HasGroup<G>,
    {
        let (document, key) = (self.entries.document, field.name());
        let Some(named) = self.get(field) else { return Ok(Vec::new()) };
        let expected = format!("expected a table with a name of its own, headed `[{key}.NAME]`");
        let DeValue::Table(tables) = named.value else {
            return Err(named.wrong_type_error(&expected));
        };
        let mut found = Vec::new();
        for (name, value) in tables {
            let path = format!("{}.{}", self.entries.path_of(key), name.get_ref());
            let DeValue::Table(entries) = value.get_ref() else {
                let message = format!("`{path}` is {}", type_with_article(value.get_ref()));
                return Err(document.source.error_at(&value.span(), message, expected));
            };
            let table = document.entries(I::NAME, Some(entries), value.span());
            let table = table.with_title(&path, &format!("[{path}]"));
            table.check_keys()?;
            found.push((name.get_ref().as_ref(), TableReader::from_entries(table)));
        }
        Ok(found)
    }

    /// Returns the error that a key is missing or misspelled. `expected` describes the value to add.
    pub fn missing_key_error<G, T>(&self, field: TypedKey<G, T>, expected: &str) -> Diagnostic
    where
        S: HasGroup<G>,
    {
        self.entries.missing_key_error(field.name(), expected)
    }

    /// Returns the error that the gain `key` of a law or a method is missing or misspelled.
    pub fn missing_gain_error(&self, key: &str, expected: &str) -> Diagnostic {
        self.entries.missing_key_error(key, expected)
    }
}

impl<'t, S: TableFormat> TableReader<'t, S> {
    /// Returns the top-level table. `title` is its name in messages.
    pub fn root(
        document: &'t Document<'t>,
        entries: &'t DeTable<'t>,
        title: &'static str,
    ) -> TableReader<'t, S> {
        let root = document.entries(S::NAME, Some(entries), 0..0);
        TableReader::from_entries(TableEntries { title: title.to_owned(), ..root })
    }
}

impl<'t> TableEntries<'t> {
    fn with_title(self, path: &str, title: &str) -> TableEntries<'t> {
        self.document.key_locations.borrow_mut().insert(path.to_owned(), self.span.clone());
        TableEntries { path: path.to_owned(), title: title.to_owned(), ..self }
    }

    fn check_keys(&self) -> Result<(), Diagnostic> {
        self.check_allowed_keys(&|_| true, true)
    }

    fn check_allowed_keys(
        &self,
        is_allowed: &dyn Fn(&KeySpec) -> bool,
        suggests_other_tables: bool,
    ) -> Result<(), Diagnostic> {
        let rows = self.section.keys.iter().filter(|key| key.name == "kind" || is_allowed(key));
        let rows: Vec<&KeySpec> = rows.collect();
        let mut keys: Vec<_> = self.keys().collect();
        keys.sort_by_key(|(_, span)| span.start);
        let error =
            |span, message, expected| self.document.source.error_at(span, message, expected);
        for (word, span) in &keys {
            if rows.iter().any(|row| row.name == *word) {
                continue;
            }
            if let Some(remedy) = self.section.withdrawn_key_remedy(word) {
                let message =
                    format!("{} has no key `{word}` anymore: it was withdrawn", self.title);
                return Err(error(span, message, remedy.to_owned()));
            }
            let Some(row) = rows.iter().find(|row| row.old_names.contains(word)) else {
                let expected = self.document.format.unknown_key_remedy(
                    self.section,
                    &rows,
                    word,
                    suggests_other_tables,
                );
                return Err(error(span, format!("{} has no key `{word}`", self.title), expected));
            };
            let new = row.name;
            if keys.iter().any(|(other, _)| *other == new) {
                let message = format!("{} has `{new}` and `{word}`, its old name", self.title);
                return Err(error(span, message, format!("expected `{new}` alone")));
            }
            let message = format!("`{word}` is called `{new}` now");
            let expected = format!("expected `{new}`; the old name still works");
            let warning = error(span, message, expected).into_warning();
            self.document.warnings.borrow_mut().push(warning);
        }
        Ok(())
    }

    fn keys(&self) -> impl Iterator<Item = (&'t str, Range<usize>)> + use<'t> {
        let entries = self.table.into_iter().flat_map(|entries| entries.iter());
        entries.map(|(key, _)| (key.get_ref().as_ref(), key.span()))
    }

    /// Returns the row of a key. Constants of keys and their rows come from one declaration.
    fn row(&self, key: &str) -> &'t KeySpec {
        let row = self.section.find_key(key);
        row.unwrap_or_else(|| panic!("`{key}` is a key of {}", self.section.name))
    }

    fn get(&self, key: &str) -> Option<TypedValue<'t, ()>> {
        let row = self.row(key);
        let entry = self.table.and_then(|entries| {
            let by_old_name = || row.old_names.iter().find_map(|old| entries.get(*old));
            entries.get(key).or_else(by_old_name)
        });
        let path = self.path_of(key);
        let Some(found) = entry else {
            let defaults = self.defaults.as_ref().filter(|d| d.section.find_key(key).is_some())?;
            let value = defaults.get(key)?;
            self.document.key_locations.borrow_mut().insert(path, value.span.clone());
            return Some(value);
        };
        self.document.key_locations.borrow_mut().insert(path, found.span());
        Some(self.value(row, found.get_ref(), found.span()))
    }

    fn value(
        &self,
        row: &'t KeySpec,
        value: &'t DeValue<'t>,
        span: Range<usize>,
    ) -> TypedValue<'t, ()> {
        let (path, key) = (self.path_of(row.name), row.name.to_owned());
        TypedValue { document: self.document, path, key, row, value, span, marker: PhantomData }
    }

    fn required_value(&self, key: &str) -> Result<TypedValue<'t, ()>, Diagnostic> {
        let row = self.row(key);
        match (self.get(key), &row.if_missing) {
            (Some(given), _) => Ok(given),
            (None, IfMissing::Default(default)) => Ok(self.value(row, default, self.span.clone())),
            (None, _) => Err(self.missing_key_error(key, &row.description)),
        }
    }

    fn missing_key_error(&self, key: &str, expected: &str) -> Diagnostic {
        let is_misspelled_key = |(word, _): &(&str, Range<usize>)| {
            let row = self.section.find_key(key).filter(|_| self.section.find_key(word).is_none());
            row.is_some_and(|row| row.is_meant_by(word) || most_similar_word(word, [key]).is_some())
        };
        if let Some((word, span)) = self.keys().find(is_misspelled_key) {
            let message = format!("{} has no key `{word}`", self.title);
            return self.document.source.error_at(&span, message, format!("did you mean `{key}`?"));
        }
        let message = format!("{} has no `{key}`", self.title);
        self.error_at_table(message, format!("expected `{key}`: {expected}"))
    }

    fn error_at_table(
        &self,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.document.source.error_at(&self.span, message, expected)
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}

impl<'t, T> TypedValue<'t, T> {
    /// Returns the value as one of another type. The caller ensures that its row has that type.
    fn cast<U>(self) -> TypedValue<'t, U> {
        let TypedValue { document, path, key, row, value, span, .. } = self;
        TypedValue { document, path, key, row, value, span, marker: PhantomData }
    }

    /// Returns an error at this value.
    pub fn error_at_value(
        &self,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.document.source.error_at(&self.span, message, expected)
    }

    /// Returns an error at this value. `message` follows the name of the key.
    pub fn error_about_key(
        &self,
        message: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.document.source.error_at(&self.span, format!("`{}` {message}", self.key), expected)
    }

    /// Returns the source range of the value.
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// Returns the file, line and column of another value of the same text.
    pub fn location(&self, span: &Range<usize>) -> String {
        self.document.source.original_location(span)
    }

    /// Records this value as the source location of `path`, also for paths below it.
    pub fn record_location(&self, path: &str) {
        let mut locations = self.document.key_locations.borrow_mut();
        let mut path = path;
        locations.insert(path.to_owned(), self.span.clone());
        while let Some((parent, _)) = path.rsplit_once('.') {
            path = parent;
            locations.entry(path.to_owned()).or_insert_with(|| self.span.clone());
        }
    }

    /// Returns the string.
    pub fn text(&self, expected: &str) -> Result<&'t str, Diagnostic> {
        match self.value {
            DeValue::String(text) => Ok(text.as_ref()),
            _ => Err(self.wrong_type_error(expected)),
        }
    }

    /// Returns the list of strings.
    pub fn texts(&self, expected: &str) -> Result<Vec<String>, Diagnostic> {
        let elements = self.elements(expected)?.into_iter();
        elements.map(|element| Ok(element.text(expected)?.to_owned())).collect()
    }

    /// Returns the meaning of the word among `words`.
    pub fn parse_word<W: Copy>(&self, words: &[(&str, W)]) -> Result<W, Diagnostic> {
        let list: Vec<String> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        let expected = match &list[..] {
            [only] => format!("expected {only}"),
            list => format!("expected one of {}", list.join(", ")),
        };
        let text = self.text(&expected)?;
        match words.iter().find(|(word, _)| *word == text) {
            Some((_, meaning)) => Ok(*meaning),
            None => {
                let close = most_similar_word(text, words.iter().map(|&(word, _)| word));
                let close = close.map(|close| format!("did you mean \"{close}\"?"));
                Err(self.error_about_key(format!("is \"{text}\""), close.unwrap_or(expected)))
            }
        }
    }

    fn number_within(&self, range: Numbers) -> Result<f64, Diagnostic> {
        let (number, unit) = (self.finite_number()?, self.row.unit());
        let expected = match range {
            Numbers::Positive if number <= 0.0 => {
                format!("expected a number{} above 0", format_in_unit(unit))
            }
            Numbers::NotZero if number == 0.0 => {
                format!("expected a number{} other than 0", format_in_unit(unit))
            }
            Numbers::NotNegative if number < 0.0 => {
                format!("expected 0{} or more", unit_with_space(unit))
            }
            _ => return Ok(number),
        };
        Err(self.error_about_key(format!("is {}", DisplayedNumber(number)), expected))
    }

    /// Returns the number if it is finite and within [`NUMBER_MAX`].
    fn finite_number(&self) -> Result<f64, Diagnostic> {
        let unit = self.row.unit();
        let expected = format!("expected a number{}", format_in_unit(unit));
        let (number, text) = match self.value {
            DeValue::Float(float) => (float.as_str().parse::<f64>().ok(), float.to_string()),
            DeValue::Integer(integer) => (
                i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|n| n as f64),
                integer.to_string(),
            ),
            _ => return Err(self.wrong_type_error(&expected)),
        };
        match number {
            Some(number) if number.abs() <= NUMBER_MAX => Ok(number),
            Some(number) if !number.is_finite() => Err(self.error_about_key(
                format!("is {text}"),
                format!("expected a finite number{}", format_in_unit(unit)),
            )),
            _ => Err(self.error_about_key(
                format!("is {text}"),
                format!("expected a number{} of at most 1e9 in size", format_in_unit(unit)),
            )),
        }
    }

    fn whole_nanoseconds(&self, seconds: f64) -> Result<u64, Diagnostic> {
        if seconds > SECONDS_MAX {
            return Err(self.error_about_key(
                format!("is {}", DisplayedNumber(seconds)),
                "expected at most 1e7 s (115 days)",
            ));
        }
        let ns = seconds * 1e9;
        // For long times the spacing of floating-point numbers is the coarser bound.
        let tolerance = NANOSECOND_TOLERANCE.max(2.0 * ns * f64::EPSILON);
        if (ns - ns.round()).abs() > tolerance || (seconds > 0.0 && ns < 0.5) {
            return Err(self.error_about_key(
                format!("is {}", DisplayedNumber(seconds)),
                format!(
                    "expected a whole number of nanoseconds, such as {:.9}",
                    ns.round().max(1.0) * 1e-9
                ),
            ));
        }
        Ok(ns.round() as u64)
    }

    /// Returns the TOML value.
    pub fn toml_value(&self) -> &'t DeValue<'t> {
        self.value
    }

    /// Returns the table with any content.
    pub fn any_table(&self) -> Result<toml::Table, Diagnostic> {
        let expected = "expected a table, such as { weight = 0.5, goals_m = [[0.0, 1.0]] }";
        let DeValue::Table(_) = self.value else { return Err(self.wrong_type_error(expected)) };
        let text = format!("value = {}", format_as_toml(self.value));
        let parsed = text.parse::<toml::Table>().ok();
        match parsed.and_then(|mut table| table.remove("value")) {
            Some(toml::Value::Table(table)) => Ok(table),
            _ => Err(self.wrong_type_error(expected)),
        }
    }

    /// Sets the name of the value in messages.
    pub fn with_name(self, key: &str) -> TypedValue<'t, T> {
        TypedValue { key: key.to_owned(), ..self }
    }

    /// Returns the entries of a table with any keys, in file order.
    pub fn entries(&self, expected: &str) -> Result<Vec<(String, TypedValue<'t, T>)>, Diagnostic> {
        let DeValue::Table(table) = self.value else { return Err(self.wrong_type_error(expected)) };
        let entries = table.iter().map(|(key, value)| {
            let (key, span) = (key.get_ref().clone().into_owned(), value.span());
            let value =
                TypedValue { key: key.clone(), value: value.get_ref(), span, ..self.clone() };
            (key, value)
        });
        Ok(entries.collect())
    }

    /// Returns whether the value is a list.
    pub fn is_list(&self) -> bool {
        matches!(self.value, DeValue::Array(_))
    }

    /// Returns the elements of a list. Messages count them from 1.
    pub fn elements(&self, expected: &str) -> Result<Vec<TypedValue<'t, T>>, Diagnostic> {
        let DeValue::Array(list) = self.value else { return Err(self.wrong_type_error(expected)) };
        let elements = list.iter().enumerate().map(|(index, element)| TypedValue {
            key: format!("{} ({})", self.key, index + 1),
            value: element.get_ref(),
            span: element.span(),
            ..self.clone()
        });
        Ok(elements.collect())
    }

    /// Returns the points `[[x, y], ...]`, each with its value.
    pub fn points(&self) -> Result<Vec<LocatedPoint<'t, T>>, Diagnostic> {
        let points = self.elements("expected a list of points: [[0.0, 0.0], [1.0, 0.5]]")?;
        points.into_iter().map(|point| point.pair().map(|pair| (point, pair))).collect()
    }

    /// Returns the two numbers `[x, y]`.
    pub fn pair(&self) -> Result<[f64; 2], Diagnostic> {
        let expected = format!("expected two numbers{}: [x, y]", format_in_unit(self.row.unit()));
        let [x, y] =
            <[TypedValue<'t, T>; 2]>::try_from(self.elements(&expected)?).map_err(|list| {
                let plural = if list.len() == 1 { "" } else { "s" };
                self.error_about_key(format!("has {} element{plural}", list.len()), &expected)
            })?;
        let component = |element: TypedValue<'t, T>, name: &str| {
            TypedValue { key: format!("{} ({name})", self.key), ..element }.finite_number()
        };
        Ok([component(x, "x")?, component(y, "y")?])
    }

    /// Returns the error that this value has another type than `expected`.
    pub fn wrong_type_error(&self, expected: &str) -> Diagnostic {
        self.error_about_key(format!("is {}", type_with_article(self.value)), expected)
    }

    fn integer_within(
        &self,
        minimum: u64,
        maximum: u64,
        expected: String,
    ) -> Result<u64, Diagnostic> {
        let DeValue::Integer(integer) = self.value else {
            return match self.value {
                DeValue::Float(float) => Err(self.error_about_key(format!("is {float}"), expected)),
                _ => Err(self.wrong_type_error(&expected)),
            };
        };
        match u64::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(number) if (minimum..=maximum).contains(&number) => Ok(number),
            _ => Err(self.error_about_key(format!("is {integer}"), expected)),
        }
    }
}

impl<'t, S: TableFormat> TypedValue<'t, kinds::Table<S>> {
    /// Returns the table that this value is.
    pub fn table(&self) -> Result<TableReader<'t, S>, Diagnostic> {
        self.table_of_section()
    }
}

impl<'t, S: TableFormat> TypedValue<'t, kinds::FileOrTable<S>> {
    /// Returns the table that this value is, in place of the path of a file.
    pub fn table(&self) -> Result<TableReader<'t, S>, Diagnostic> {
        self.table_of_section()
    }
}

impl<'t, T> TypedValue<'t, T> {
    /// Returns the table with the keys of a section that this value is.
    fn table_of_section<S: TableFormat>(&self) -> Result<TableReader<'t, S>, Diagnostic> {
        let DeValue::Table(entries) = self.value else {
            let keys = &self.document.format.section(S::NAME).keys;
            let names: Vec<&str> = keys.iter().map(|key| key.name).collect();
            return Err(self.wrong_type_error(&format!("expected a table of {}", names.join(", "))));
        };
        let title = match self.path == self.key {
            true => format!("[{}]", self.key),
            false => format!("`{}`", self.key),
        };
        let table = self.document.entries(S::NAME, Some(entries), self.span());
        let table = TableEntries { path: self.path.clone(), title, ..table };
        table.check_keys()?;
        Ok(TableReader::from_entries(table))
    }
}

impl<W: DeserializeOwned> TypedValue<'_, kinds::Word<W>> {
    /// Returns the meaning of the word.
    ///
    /// # Panics
    ///
    /// If `W` lacks a variant for a word of the row.
    pub fn read_word(&self) -> Result<W, Diagnostic> {
        let ValueType::Word(words) = self.row.value_type else { unreachable!("by its type") };
        let words: Vec<_> = words.iter().map(|&(word, _)| (word, word)).collect();
        let word: StrDeserializer<'_, Error> = self.parse_word(&words)?.into_deserializer();
        Ok(W::deserialize(word).expect("every word of a row means something"))
    }
}

impl TypedValue<'_, kinds::Number> {
    /// Returns the number, checked against the range of its row.
    pub fn number(&self) -> Result<f64, Diagnostic> {
        let ValueType::Number(range) = self.row.value_type else { unreachable!("by its type") };
        self.number_within(range)
    }
}

impl TypedValue<'_, kinds::Time> {
    /// Returns the time, checked against the range of its row, ns.
    pub fn time_ns(&self) -> Result<u64, Diagnostic> {
        let ValueType::Time(range) = self.row.value_type else { unreachable!("by its type") };
        self.whole_nanoseconds(self.number_within(range)?)
    }
}

impl<'t> TypedValue<'t, kinds::Times> {
    /// Returns the list of times, each with its value and checked to be at least 0, ns.
    pub fn times_ns(&self) -> Result<Vec<(TypedValue<'t, kinds::Times>, u64)>, Diagnostic> {
        let times = self.elements("expected a list of times in seconds: [120.0, 300.0]")?;
        let read = |time: TypedValue<'t, kinds::Times>| {
            let at_ns = time.whole_nanoseconds(time.number_within(Numbers::NotNegative)?)?;
            Ok((time, at_ns))
        };
        times.into_iter().map(read).collect()
    }
}

impl TypedValue<'_, kinds::Integer> {
    /// Returns the integer, checked against the range of its row.
    pub fn integer(&self) -> Result<u64, Diagnostic> {
        let ValueType::Integer(minimum, maximum) = self.row.value_type else {
            unreachable!("by its type")
        };
        self.integer_within(
            minimum,
            maximum,
            format!("expected a whole number from {minimum} to {maximum}"),
        )
    }
}

impl TypedValue<'_, kinds::NamesOrCount> {
    /// Returns the number of robots.
    pub fn count(&self) -> Result<u64, Diagnostic> {
        let expected = "expected a whole number of robots, or names of robots: [\"r1\", \"r2\"]";
        self.integer_within(0, i64::MAX as u64, expected.to_owned())
    }
}

impl TypedValue<'_, kinds::Boolean> {
    /// Returns the boolean.
    pub fn boolean(&self) -> Result<bool, Diagnostic> {
        match self.value {
            DeValue::Boolean(boolean) => Ok(*boolean),
            _ => Err(self.wrong_type_error("expected true or false")),
        }
    }
}

/// Type of a value that needs no context to be read.
pub trait PlainValue: Sized {
    /// Type of the value in Rust.
    type Stored;

    /// Reads a value. Returns an error if it has another type or is out of range.
    fn read(value: &TypedValue<'_, Self>) -> Result<Self::Stored, Diagnostic>;
}

/// Implements [`PlainValue`] by a method of [`TypedValue`].
macro_rules! plain {
    ($($kind:ident $stored:ty, $method:ident;)*) => {
        $(impl PlainValue for kinds::$kind {
            type Stored = $stored;

            fn read(value: &TypedValue<'_, kinds::$kind>) -> Result<$stored, Diagnostic> {
                value.$method()
            }
        })*
    };
}

plain! {
    Boolean bool, boolean;
    Number f64, number;
    Time u64, time_ns;
    Integer u64, integer;
    Pair [f64; 2], pair;
}

impl<W: DeserializeOwned> PlainValue for kinds::Word<W> {
    type Stored = W;

    fn read(value: &TypedValue<'_, kinds::Word<W>>) -> Result<W, Diagnostic> {
        value.read_word()
    }
}

/// Reads a required key, or its default.
pub fn read_required<S: HasGroup<G>, G, T: PlainValue>(
    table: &TableReader<'_, S>,
    field: TypedKey<G, T>,
) -> Result<T::Stored, Diagnostic> {
    T::read(&table.required_value(field)?)
}

/// Reads an optional key.
pub fn read_optional<S: HasGroup<G>, G, T: PlainValue>(
    table: &TableReader<'_, S>,
    field: TypedKey<G, T>,
) -> Result<Option<T::Stored>, Diagnostic> {
    table.get(field).map(|value| T::read(&value)).transpose()
}

fn unit_with_space(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

fn format_in_unit(unit: &str) -> String {
    match unit {
        "" => String::new(),
        "m" => " of meters".to_owned(),
        "s" => " of seconds".to_owned(),
        "rad" => " of radians".to_owned(),
        unit => format!(" in {unit}"),
    }
}

/// Returns the type of a value with an article, for messages.
fn type_with_article(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// Returns a value as TOML on one line.
pub(crate) fn format_as_toml(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => toml::Value::String(text.clone().into_owned()).to_string(),
        DeValue::Integer(integer) => integer.to_string(),
        DeValue::Float(float) => float.to_string(),
        DeValue::Boolean(boolean) => boolean.to_string(),
        DeValue::Datetime(date) => date.to_string(),
        DeValue::Array(list) => {
            let list: Vec<String> =
                list.iter().map(|value| format_as_toml(value.get_ref())).collect();
            format!("[{}]", list.join(", "))
        }
        DeValue::Table(table) if table.is_empty() => "{}".to_owned(),
        DeValue::Table(table) => {
            let entries = table.iter();
            let entries = entries.map(|(key, value)| {
                format!("{} = {}", format_key(key.get_ref()), format_as_toml(value.get_ref()))
            });
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
    }
}

fn format_key(key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let is_plain = !key.is_empty() && key.chars().all(is_bare);
    if is_plain { key.to_owned() } else { toml::Value::String(key.to_owned()).to_string() }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use protocol::catalog::Catalog;

    use super::*;
    use crate::scenario::diagnostic::Severity;
    use crate::scenario::keys::Root;

    /// Parses the key `period_s`, with the former name `step_s`.
    fn parse_period(text: &str) -> (Result<f64, Diagnostic>, Vec<Diagnostic>) {
        let mut format = FileFormat::new(&Catalog { laws: Vec::new(), methods: Vec::new() });
        let keys = &mut format.sections[0].keys;
        keys.iter_mut().find(|key| key.name == "period_s").unwrap().old_names = &["step_s"];
        let document = Document::new(SourceText::new(Path::new("t.toml"), text, false), &format);
        let entries = DeTable::parse(text).unwrap();
        let root: TableReader<'_, Root> =
            TableReader::root(&document, entries.get_ref(), "the scenario");
        let period =
            root.check_keys().and_then(|()| root.required_value(Root::period_s)?.seconds());
        (period, document.warnings.take())
    }

    impl TypedValue<'_, kinds::Time> {
        fn seconds(&self) -> Result<f64, Diagnostic> {
            self.time_ns().map(|ns| ns as f64 / 1e9)
        }
    }

    #[test]
    fn old_key_name_is_accepted_with_a_warning_naming_the_new_one() {
        assert_eq!(parse_period("period_s = 0.5"), (Ok(0.5), Vec::new()));
        let (period, warnings) = parse_period("name = \"a\"\nstep_s = 0.5");
        assert_eq!((period, warnings.len()), (Ok(0.5), 1));
        assert_eq!((warnings[0].severity, warnings[0].line), (Severity::Warning, 2));
        assert_eq!(warnings[0].message, "`step_s` is called `period_s` now");
        let (both, _) = parse_period("step_s = 0.5\nperiod_s = 0.5");
        assert!(both.unwrap_err().message.contains("`period_s` and `step_s`, its old name"));
        assert!(parse_period("step_s = -1").0.unwrap_err().message.contains("is -1"));
    }
}
