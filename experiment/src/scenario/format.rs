//! Description of a file format: tables, their keys with type, unit, range, default and description, and remedies for
//! unknown keys. [`super::keys`] and the modules of campaign and fleet files fill it.

use std::borrow::Cow;

use toml::de::DeValue;

use super::diagnostic::most_similar_word;

/// A key of a table: one row of the format.
#[derive(Debug, Clone)]
pub struct KeySpec {
    /// Name of the key, with the unit as suffix.
    pub name: &'static str,
    /// Type and range of the value of the key.
    pub value_type: ValueType,
    /// Behavior if the key is missing.
    pub if_missing: IfMissing,
    /// Description of the key, in one line.
    pub description: Cow<'static, str>,
    /// Former names of the key. They are accepted with a warning.
    pub old_names: &'static [&'static str],
    /// Accepted range as text, if more is checked than the range of the type. Empty otherwise.
    pub range_text: &'static str,
    /// Words that users write for this key, in lower case and without unit, separated by spaces.
    pub synonyms: &'static str,
}

/// Type of a value. Numbers have the unit in which the name of the key ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ValueType {
    /// A string, not limited to certain words.
    Text,
    /// A string that is one of the given words, each with its description.
    Word(&'static [(&'static str, &'static str)]),
    /// Name of one of the kinds of the section.
    Kind,
    /// Name of a control law.
    Law,
    /// Name of an avoidance method.
    Method,
    /// A boolean, `true` or `false`.
    Boolean,
    /// A floating-point number within a range.
    Number(NumberRange),
    /// A time in seconds that is a whole number of nanoseconds.
    Time(NumberRange),
    /// A list of times in seconds, at least 0, that are whole numbers of nanoseconds.
    Times,
    /// An integer with its minimum and maximum.
    Integer(u64, u64),
    /// Two numbers, `[x, y]`.
    Pair,
    /// A list of points `[x, y]`.
    Points,
    /// A list of strings.
    Texts,
    /// A list of robot names.
    Names,
    /// A list of robot names, or a number of robots.
    NamesOrCount,
    /// A table with the keys of the named section.
    Table(&'static str),
    /// The path of a file, or a table with the keys of the named section.
    FileOrTable(&'static str),
    /// A list of tables with the keys of the named section.
    Tables(&'static str),
    /// A table of tables with the keys of the named section. The file chooses the name of each.
    NamedTables(&'static str),
    /// A value of any type, described by this text.
    Any(&'static str),
}

/// Range of a floating-point value. Every range excludes infinite values and magnitudes above
/// [`super::table::NUMBER_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberRange {
    /// Negative, zero or positive.
    Any,
    /// Zero or positive.
    NotNegative,
    /// Positive, not zero.
    Positive,
    /// Negative or positive, not zero.
    NotZero,
}

/// Behavior if a key is missing.
#[derive(Debug, Clone)]
pub enum IfMissing {
    /// Error: the key is required.
    Required,
    /// This value is used.
    Default(DeValue<'static>),
    /// A rule, described by this text, determines the value.
    Rule(Cow<'static, str>),
    /// The feature of the key is off.
    Absent,
}

/// A section of the format: the keys of one table.
#[derive(Debug)]
pub struct Section {
    /// Name of the section, in general the key of the table.
    pub name: &'static str,
    /// Description of the table, in one line.
    pub description: &'static str,
    /// Keys of the table, in the order of the reference page.
    pub keys: Vec<KeySpec>,
    /// Values of the key `kind`, if it determines which other keys are allowed. If empty, all keys are.
    pub kinds: Vec<KindSpec>,
    /// Keys of earlier versions that have no successor.
    pub withdrawn_keys: &'static [WithdrawnKeys],
}

/// Keys of earlier versions of the format that have no successor.
#[derive(Debug)]
pub struct WithdrawnKeys {
    /// Names of the keys.
    pub names: &'static [&'static str],
    /// Remedy: what holds now, and what to write instead.
    pub remedy: &'static str,
}

/// A value of the key `kind`, and the other keys that it requires and allows.
#[derive(Debug, Clone)]
pub struct KindSpec {
    /// Value of the key `kind`.
    pub name: &'static str,
    /// Description of the kind, in one line.
    pub description: &'static str,
    /// Required keys.
    pub required_keys: Vec<&'static str>,
    /// Optional keys.
    pub optional_keys: Vec<&'static str>,
}

/// File format: all sections, and the known control laws and avoidance methods.
#[derive(Debug)]
pub struct FileFormat {
    /// Sections. The first is the top-level table.
    pub sections: Vec<Section>,
    /// Names of the control laws.
    pub law_names: Vec<&'static str>,
    /// Names of the avoidance methods. The first is the default.
    pub method_names: Vec<&'static str>,
}

/// Returns the row of an optional key without a description.
pub fn key(name: &'static str, value_type: ValueType) -> KeySpec {
    KeySpec {
        name,
        value_type,
        if_missing: IfMissing::Absent,
        description: Cow::Borrowed(""),
        old_names: &[],
        range_text: "",
        synonyms: "",
    }
}

impl KeySpec {
    /// Makes the key required and sets its description.
    pub fn required(self, description: &'static str) -> KeySpec {
        KeySpec { if_missing: IfMissing::Required, description: description.into(), ..self }
    }

    /// Makes the key optional and sets its description. Without the key, its feature is off.
    pub fn optional(self, description: &'static str) -> KeySpec {
        KeySpec { if_missing: IfMissing::Absent, description: description.into(), ..self }
    }

    /// Sets the default value, written in TOML, and the description.
    ///
    /// # Panics
    ///
    /// If `value` is not TOML.
    pub fn default(self, value: &'static str, description: &'static str) -> KeySpec {
        let value = DeValue::parse(value).expect("a default is TOML").into_inner();
        KeySpec { if_missing: IfMissing::Default(value), description: description.into(), ..self }
    }

    /// Sets the rule, as text, that holds if the key is missing, and the description.
    pub fn rule(
        self,
        rule: impl Into<Cow<'static, str>>,
        description: impl Into<Cow<'static, str>>,
    ) -> KeySpec {
        KeySpec {
            if_missing: IfMissing::Rule(rule.into()),
            description: description.into(),
            ..self
        }
    }

    /// Sets the text of the accepted range, for a key with more checks than the range of its type.
    pub fn with_bounds(self, range_text: &'static str) -> KeySpec {
        KeySpec { range_text, ..self }
    }

    /// Sets the former names of the key, which are accepted with a warning.
    pub fn with_former_names(self, old_names: &'static [&'static str]) -> KeySpec {
        KeySpec { old_names, ..self }
    }

    /// Sets the words that users write for this key, in lower case, without unit, separated by spaces.
    pub fn with_synonyms(self, synonyms: &'static str) -> KeySpec {
        KeySpec { synonyms, ..self }
    }

    /// Returns the name of the key and its former names.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        [self.name].into_iter().chain(self.old_names.iter().copied())
    }

    /// Returns the unit of the value, or "" if it has none.
    pub(crate) fn unit(&self) -> &'static str {
        match self.value_type {
            ValueType::Number(_)
            | ValueType::Pair
            | ValueType::Points
            | ValueType::Time(_)
            | ValueType::Times => {
                let name = self.name.strip_suffix("_max").unwrap_or(self.name);
                UNIT_SUFFIXES
                    .iter()
                    .find(|(suffix, _)| name.ends_with(suffix))
                    .map_or("", |unit| unit.1)
            }
            _ => "",
        }
    }

    /// Returns whether a user probably means this key by `word`: it is the name without unit, or one of the `synonyms`.
    pub(crate) fn is_meant_by(&self, word: &str) -> bool {
        let guess = normalize_word(word);
        normalize_word(self.name) == guess || self.synonyms.split(' ').any(|known| known == guess)
    }
}

impl Section {
    /// Creates a section with these keys.
    pub fn new(name: &'static str, description: &'static str, keys: Vec<KeySpec>) -> Section {
        Section { name, description, keys, kinds: Vec::new(), withdrawn_keys: &[] }
    }

    /// Adds keys that the catalog of laws and methods names.
    pub(crate) fn with_keys(mut self, keys: Vec<KeySpec>) -> Section {
        self.keys.extend(keys);
        self
    }

    /// Adds the values of the key `kind`, which determine the allowed keys.
    pub(crate) fn with_kinds(self, kinds: impl IntoIterator<Item = KindSpec>) -> Section {
        Section { kinds: kinds.into_iter().collect(), ..self }
    }

    /// Adds the keys of earlier versions that have no successor.
    pub(crate) fn with_withdrawn_keys(self, withdrawn_keys: &'static [WithdrawnKeys]) -> Section {
        Section { withdrawn_keys, ..self }
    }

    /// Returns the remedy for the withdrawn key `word`, or `None` if it was never a key.
    pub(crate) fn withdrawn_key_remedy(&self, word: &str) -> Option<&'static str> {
        let withdrawn =
            self.withdrawn_keys.iter().find(|withdrawn| withdrawn.names.contains(&word));
        withdrawn.map(|withdrawn| withdrawn.remedy)
    }

    /// Returns the row of the key `name`, or `None` if the section has none.
    pub fn find_key(&self, name: &str) -> Option<&KeySpec> {
        self.keys.iter().find(|key| key.name == name)
    }

    /// Returns the values of the key `kind`, without repetitions.
    pub fn kind_names(&self) -> Vec<&'static str> {
        let mut names: Vec<&str> = self.kinds.iter().map(|kind| kind.name).collect();
        names.dedup();
        names
    }
}

impl KindSpec {
    /// Creates a kind. `required_keys` and `optional_keys` are lists of keys, separated by spaces.
    pub(crate) fn new(
        name: &'static str,
        description: &'static str,
        required_keys: &'static str,
        optional_keys: &'static str,
    ) -> KindSpec {
        let split_keys = |keys: &'static str| keys.split_whitespace().collect();
        KindSpec {
            name,
            description,
            required_keys: split_keys(required_keys),
            optional_keys: split_keys(optional_keys),
        }
    }

    /// Returns whether the kind requires or allows `key`.
    pub(crate) fn allows_key(&self, key: &str) -> bool {
        self.required_keys.contains(&key) || self.optional_keys.contains(&key)
    }
}

impl FileFormat {
    /// Returns a format without control laws and avoidance methods.
    pub fn without_catalog(sections: Vec<Section>) -> FileFormat {
        FileFormat { sections, law_names: Vec::new(), method_names: Vec::new() }
    }

    /// Returns the section of the top-level table.
    pub fn root(&self) -> &Section {
        &self.sections[0]
    }

    /// Returns the section `name`.
    ///
    /// # Panics
    ///
    /// If there is no such section.
    pub fn section(&self, name: &str) -> &Section {
        let found = self.sections.iter().find(|section| section.name == name);
        found.unwrap_or_else(|| panic!("`{name}` is a section"))
    }

    /// Returns the key that a user probably means by `word`, as a path for `--set`, or `None`. Searches the top level
    /// and the tables that occur once.
    pub fn key_meant_by(&self, word: &str) -> Option<String> {
        let key = |section: &Section| {
            section.keys.iter().find(|key| key.is_meant_by(word)).map(|key| key.name)
        };
        let tables = ["avoidance", "realtime", "silence", "expect"];
        let key_in_table = |table: &&str| Some(format!("{table}.{}", key(self.section(table))?));
        key(self.root()).map(str::to_owned).or_else(|| tables.iter().find_map(key_in_table))
    }

    /// Returns the remedy for the unknown key `word`: the most similar key, or the list of allowed keys. `rows` are the
    /// allowed keys of the section. If `suggests_other_tables` is set, keys of other sections are suggested, too.
    pub(crate) fn unknown_key_remedy(
        &self,
        section: &Section,
        rows: &[&KeySpec],
        word: &str,
        suggests_other_tables: bool,
    ) -> String {
        let names = || rows.iter().map(|key| key.name);
        let guessed = rows.iter().find(|key| key.is_meant_by(word)).map(|key| key.name);
        if let Some(close) = guessed.or_else(|| most_similar_word(word, names())) {
            return format!("did you mean `{close}`?");
        }
        let others = self
            .sections
            .iter()
            .filter(|other| suggests_other_tables && other.name != section.name);
        let mut keys = others.flat_map(|other| other.keys.iter().map(move |key| (other, key)));
        match keys.find(|(_, key)| key.is_meant_by(word)) {
            Some((other, key)) if std::ptr::eq(other, self.root()) => {
                format!("did you mean `{}`, outside of all tables?", key.name)
            }
            Some((other, key)) => format!("did you mean `{}` in `{}`?", key.name, other.name),
            None => format!("expected one of {}", names().collect::<Vec<_>>().join(", ")),
        }
    }
}

/// Suffixes of key names and their units, longer suffixes first.
const UNIT_SUFFIXES: &[(&str, &str)] = &[
    ("cycles", "cycles per period"),
    ("_rad_s2", "rad/s^2"),
    ("_m_s2", "m/s^2"),
    ("_per_s", "1/s"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_ms", "ms"),
    ("_m", "m"),
    ("_s", "s"),
];

/// Returns `word` as in `synonyms`: in lower case, without unit.
fn normalize_word(word: &str) -> String {
    let word = word.to_lowercase().replace('-', "_");
    let suffix = UNIT_SUFFIXES.iter().find_map(|(suffix, _)| word.strip_suffix(suffix));
    suffix.filter(|stem| !stem.is_empty()).unwrap_or(&word).to_owned()
}
