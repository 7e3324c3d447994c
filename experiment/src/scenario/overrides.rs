//! Command-line overrides of a scenario. They are applied to its text, with the comments kept, so that the effective
//! scenario can be saved and run again.

use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Key, TableLike, Value};

use super::diagnostic::Diagnostic;
use super::fault;

/// Overrides of a scenario.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Overrides {
    /// Assignments `key=value`, in order. Keys are dotted as in `avoidance.kind` or `robot.r1.law`. The value is TOML;
    /// other text is taken as a string.
    pub assignments: Vec<String>,
    /// Faults to add, in the syntax of [`fault::parse`].
    pub faults: Vec<String>,
    /// Seed in place of that of the file.
    pub seed: Option<u64>,
}

impl Overrides {
    /// Returns whether the overrides set the key `graph`.
    pub(crate) fn sets_graph(&self) -> bool {
        self.assignments.iter().any(|argument| is_graph_assignment(argument))
    }

    /// Returns whether the overrides change nothing except perhaps the key `graph`.
    pub(crate) fn sets_only_graph(&self) -> bool {
        let only_graph = self.assignments.iter().all(|argument| is_graph_assignment(argument));
        only_graph && self.faults.is_empty() && self.seed.is_none()
    }

    /// Applies the assignment of the key `graph`, which precedes all others.
    pub(crate) fn apply_graph(&self, document: &mut DocumentMut) -> Result<(), Diagnostic> {
        self.assignments
            .iter()
            .filter(|argument| is_graph_assignment(argument))
            .try_for_each(|a| apply_assignment(document, a))
    }

    /// Applies all overrides other than the key `graph`.
    pub(crate) fn apply(&self, document: &mut DocumentMut) -> Result<(), Diagnostic> {
        for argument in self.assignments.iter().filter(|argument| !is_graph_assignment(argument)) {
            apply_assignment(document, argument)?;
        }
        if let Some(seed) = self.seed {
            let seed = i64::try_from(seed).map_err(|_| {
                Diagnostic::without_location(
                    format!("`--seed {seed}` is too large"),
                    format!("expected at most {}", i64::MAX),
                )
            })?;
            replace_value(document.as_table_mut(), "seed", seed.into());
        }
        for argument in &self.faults {
            add_fault(document, argument)?;
        }
        Ok(())
    }
}

fn is_graph_assignment(argument: &str) -> bool {
    argument.split_once('=').is_some_and(|(key, _)| key.trim() == "graph")
}

/// Applies one assignment `key=value`.
fn apply_assignment(document: &mut DocumentMut, argument: &str) -> Result<(), Diagnostic> {
    let error = |reason: String| {
        Diagnostic::without_location(
            format!("`--set {argument}`: {reason}"),
            "expected key=value, such as avoidance.kind=focus",
        )
    };
    let (key, text) = argument.split_once('=').ok_or_else(|| error("there is no `=`".into()))?;
    let keys = Key::parse(&quote_edges(key))
        .map_err(|_| error(format!("`{}` is not a key", key.trim())))?;
    let text = text.trim();
    if text.is_empty() {
        return Err(error("there is no value".into()));
    }
    let mut value = text.parse::<Value>().unwrap_or_else(|_| Value::from(text));
    value.decor_mut().clear();

    let (last, parents) = keys.split_last().expect("a parsed key has a part");
    let mut table: &mut dyn TableLike = document.as_table_mut();
    // Within an inline value, a missing table is written inline, too.
    let mut is_inline = false;
    let mut names = parents.iter();
    while let Some(name) = names.next() {
        let name = name.get();
        let item = table.entry(name).or_insert_with(|| match is_inline {
            true => Item::Value(InlineTable::new().into()),
            false => toml_edit::table(),
        });
        is_inline |= item.is_value();
        table = if item.is_array() || item.is_array_of_tables() {
            let element_name = names.next().ok_or_else(|| {
                error(format!("`{name}` is a list: say which of them by its name"))
            })?;
            find_named_table(item, element_name.get()).ok_or_else(|| {
                error(format!("there is no {name} named `{}`", element_name.get()))
            })?
        } else {
            item.as_table_like_mut().ok_or_else(|| error(format!("`{name}` is not a table")))?
        };
    }
    if table.get(last.get()).is_some_and(is_list_of_tables) {
        if value.as_array().is_some_and(Array::is_empty) {
            table.remove(last.get());
            return Ok(());
        }
        let name = last.get();
        return Err(error(format!("`{name}` is a list of tables; {name}=[] removes them")));
    }
    replace_value(table, last.get(), value);
    Ok(())
}

/// Returns a dotted key in which each `FROM->TO` is quoted, as TOML requires.
fn quote_edges(key: &str) -> String {
    let quoted = |part: &str| match part.contains("->") && !part.contains(['"', '\'']) {
        true => format!("\"{}\"", part.trim()),
        false => part.to_owned(),
    };
    key.split('.').map(quoted).collect::<Vec<_>>().join(".")
}

/// Returns the table with this `name` in a list of tables or in an inline list. An edge, which has no name, is found by
/// `FROM->TO`.
fn find_named_table<'i>(list: &'i mut Item, name: &str) -> Option<&'i mut dyn TableLike> {
    fn is_named(table: &dyn TableLike, name: &str) -> bool {
        let text = |key: &str| table.get(key).and_then(Item::as_str);
        match name.split_once("->") {
            Some((from, to)) => text("from") == Some(from) && text("to") == Some(to),
            None => text("name") == Some(name),
        }
    }
    match list {
        Item::ArrayOfTables(tables) => {
            let table = tables.iter_mut().find(|table| is_named(*table, name))?;
            Some(table)
        }
        Item::Value(Value::Array(array)) => {
            let mut tables = array.iter_mut().filter_map(Value::as_inline_table_mut);
            let table = tables.find(|table| is_named(*table, name))?;
            Some(table)
        }
        _ => None,
    }
}

fn is_list_of_tables(item: &Item) -> bool {
    let has_only_tables =
        |array: &Array| !array.is_empty() && array.iter().all(Value::is_inline_table);
    item.is_array_of_tables() || item.as_array().is_some_and(has_only_tables)
}

/// Replaces a value and keeps the comment after it.
fn replace_value(table: &mut dyn TableLike, key: &str, mut value: Value) {
    match table.get_mut(key) {
        Some(Item::Value(old)) => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        Some(other) => *other = Item::Value(value),
        None => {
            table.insert(key, Item::Value(value));
        }
    }
}

/// Appends a `[[fault]]` table.
fn add_fault(document: &mut DocumentMut, argument: &str) -> Result<(), Diagnostic> {
    let table = fault::parse(argument).map_err(|error| {
        Diagnostic::without_location(
            format!("`--fault '{argument}'`: {error}"),
            error.remedy.clone(),
        )
    })?;
    let list = document.entry("fault").or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
    if let Some(tables) = list.as_array_of_tables_mut() {
        tables.push(table);
    } else if let Some(array) = list.as_array_mut() {
        array.push(table.into_inline_table());
    } else {
        return Err(Diagnostic::without_location(
            format!("`--fault '{argument}'`: the file's own `fault` is no list"),
            "expected tables headed `[[fault]]`",
        ));
    }
    Ok(())
}
