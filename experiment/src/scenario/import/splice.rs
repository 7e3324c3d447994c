//! Insertion of an imported graph into the text of the scenario.
//!
//! The resulting text needs no other file and is a complete scenario. Its diagnostics point into the scenario file or
//! the graph file, where the cause is.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use toml::de::DeTable;

use super::encoding::decode;
use super::{Attribute, ImportedEdge, LocatedValue, Name, Network, Node, Tree, network};
use crate::scenario::diagnostic::{Diagnostic, Origin, Source};
use crate::scenario::fields::{TableFormat, TypedKey, kinds};
use crate::scenario::file::{FILE_BYTES_MAX, Trouble, check_inside_folder, load_bytes};
use crate::scenario::format::{Format, Key};
use crate::scenario::keys;
use crate::scenario::table::{Document, TableReader};

/// Text of a scenario with its graph inserted.
pub(in crate::scenario) struct Spliced {
    pub(in crate::scenario) text: String,
    pub(in crate::scenario) source: Source,
    pub(in crate::scenario) warnings: Vec<Diagnostic>,
}

/// Returns the text with the graph inserted that it names, if it names one.
pub(in crate::scenario) fn splice(
    path: &Path,
    text: &str,
    source: Source,
    entries: &DeTable<'_>,
    format: &Format,
) -> Result<Spliced, Diagnostic> {
    let Some((key, _)) = entries.get_key_value("graph") else {
        return Ok(Spliced { text: text.to_owned(), source, warnings: Vec::new() });
    };
    let document = Document::new(source, format);
    let root: TableReader<'_, keys::Root> = TableReader::root(&document, entries, "the scenario");
    let value = root.required(keys::Root::graph)?;
    let expected = "expected a file that ends in .json (node-link), .csv (matrix) or .graphml";
    let name = value.text(expected)?;
    let file = path.parent().unwrap_or(Path::new("")).join(name);
    let shown = file.display();
    let folder = file.parent().unwrap_or(Path::new(""));
    let is_in_its_folder = match check_inside_folder(folder, &file) {
        Err(error) if file.exists() => Err(Trouble {
            problem: format!("cannot be read: {error}"),
            expected: "expected the file itself, because a symbolic link in an untrusted folder may point to any file",
        }),
        _ => Ok(()),
    };
    let graph_text = is_in_its_folder.and_then(|()| decode(load_bytes(&file, expected)?));
    let graph_text = graph_text.map_err(|trouble| {
        value.error_about_key(
            format!("names `{shown}`, which {}", trouble.problem),
            trouble.expected,
        )
    })?;
    let graph_text = graph_text.strip_prefix('\u{feff}').unwrap_or(&graph_text);
    let graph = Source::new(&file, graph_text, false);
    let graph = graph.imported_by(document.source.location(&value.span()));
    let robot_keys = format.section("robot").keys.iter().flat_map(Key::names);
    let robot_keys: Vec<&str> = robot_keys.filter(|key| *key != "name").collect();
    let network = network(&file, &graph, graph_text, &robot_keys)
        .unwrap_or_else(|| Err(value.error_about_key(format!("is \"{name}\""), expected)))?;
    let warnings = network.warnings(&graph);

    let robots = RobotsInText::read(&root, text)?;
    let names = robots.robot_names(&network, &graph)?;
    let mut edits = robots.robot_attribute_edits(&network, &names);
    let here = value.span();
    let mut lists = Written::default();
    lists.push(&format!("# {name:?}, written out:"), &EMPTY_SPAN);
    robots.list.add("robot", new_robots(&network, &names, &robots), &mut lists, &mut edits, text);
    let list = List::read(&root, keys::Root::edge, text)?;
    list.add("edge", edges(&network, &names), &mut lists, &mut edits, text);
    if lists.origins.len() == 1 {
        lists = Written::default();
    }
    edits.push((key.span().start..here.end, lists));
    let Written { text: spliced, origins } = apply(text, edits);
    if spliced.len() as u64 > FILE_BYTES_MAX {
        return Err(value.error_about_key(
            format!("names `{shown}`: written out, the scenario has {} bytes", spliced.len()),
            "expected a smaller graph",
        ));
    }
    let source = Source::from_parts(path, &spliced, origins, document.source, graph);
    Ok(Spliced { text: spliced, source, warnings })
}

/// Warnings about the imported graph.
const EMPTY_SPAN: Range<usize> = 0..0;

/// An edit: a range of the text and its replacement.
type Edit = (Range<usize>, Written);

/// A composed text with the origins of its parts.
#[derive(Default)]
struct Written {
    text: String,
    origins: Vec<(usize, Origin)>,
}

impl Written {
    /// Appends generated text whose origin is `span` in the graph file.
    fn push(&mut self, words: &str, span: &Range<usize>) {
        self.origins.push((self.text.len(), Origin::Graph(span.clone())));
        self.text += words;
    }

    fn value(&mut self, LocatedValue { value, span }: &LocatedValue) {
        match value {
            Tree::Plain(text) => self.push(text, span),
            Tree::Unreadable { .. } => unreachable!("it was refused or ignored"),
            Tree::List(list) => {
                self.push("[", span);
                for (at, element) in list.iter().enumerate() {
                    self.push(if at > 0 { ", " } else { "" }, &element.span);
                    self.value(element);
                }
                self.push("]", span);
            }
            Tree::Table(entries) => {
                for (at, (key, value)) in entries.iter().enumerate() {
                    self.entry(if at > 0 { ", " } else { "{ " }, key, value);
                }
                self.push(if entries.is_empty() { "{ }" } else { " }" }, span);
            }
        }
    }

    fn entry(&mut self, before: &str, key: &str, value: &LocatedValue) {
        self.push(&format!("{before}{} = ", toml_edit::Key::new(key)), &value.span);
        self.value(value);
    }

    /// Appends a copy of the scenario's text from `at` on.
    fn copy(&mut self, text: &str, at: usize) {
        self.origins.push((self.text.len(), Origin::Scenario(at)));
        self.text += text;
    }
}

/// Returns the text after all edits.
fn apply(text: &str, mut edits: Vec<Edit>) -> Written {
    edits.sort_by_key(|(at, _)| at.start);
    let mut result = Written::default();
    let mut copied = 0;
    for (at, written) in edits {
        result.copy(&text[copied..at.start], copied);
        copied = at.end;
        let start = result.text.len();
        result.text += &written.text;
        result.origins.extend(written.origins.into_iter().map(|(at, from)| (start + at, from)));
    }
    result.copy(&text[copied..], copied);
    result
}

/// Notation of a list of tables.
enum List {
    /// The scenario has no such list.
    Absent,
    /// Headed tables, `[[robot]]`.
    Headed,
    /// An inline list, `robot = [...]`, with the position after its last element or after its bracket, where more can
    /// be added.
    Inline { end: usize, empty: bool },
}

impl List {
    fn read<S: TableFormat>(
        root: &TableReader<'_, keys::Root>,
        key: TypedKey<keys::Root, kinds::Tables<S>>,
        text: &str,
    ) -> Result<List, Diagnostic> {
        let Some(list) = root.get(key) else { return Ok(List::Absent) };
        Ok(match root.tables(key)?.last() {
            None => List::Inline { end: list.span().start + 1, empty: true },
            Some(last) if text[last.span().start..].starts_with('{') => {
                List::Inline { end: last.span().end, empty: false }
            }
            Some(_) => List::Headed,
        })
    }

    /// Adds tables to the list, or at `here`, where the graph is named, if there is no list yet.
    fn add(
        &self,
        key: &str,
        tables: Vec<LocatedValue>,
        here: &mut Written,
        edits: &mut Vec<Edit>,
        text: &str,
    ) {
        if tables.is_empty() {
            return;
        }
        let mut added = Written::default();
        match self {
            List::Absent => {
                here.push(&format!("\n{key} = ["), &EMPTY_SPAN);
                for table in tables {
                    here.push("\n    ", &table.span);
                    here.value(&table);
                    here.push(",", &EMPTY_SPAN);
                }
                here.push("\n]", &EMPTY_SPAN);
            }
            List::Headed => {
                added.push(if text.ends_with('\n') { "" } else { "\n" }, &EMPTY_SPAN);
                for table in tables {
                    added.push(&format!("\n[[{key}]]"), &table.span);
                    let Tree::Table(entries) = &table.value else { unreachable!("it is a table") };
                    entries.iter().for_each(|(key, value)| added.entry("\n", key, value));
                    added.push("\n", &EMPTY_SPAN);
                }
                edits.push((text.len()..text.len(), added));
            }
            List::Inline { end, empty } => {
                for (at, table) in tables.iter().enumerate() {
                    let comma = if *empty && at == 0 { "" } else { "," };
                    added.push(&format!("{comma}\n    "), &table.span);
                    added.value(table);
                }
                edits.push((*end..*end, added));
            }
        }
    }
}

/// Creates a table that starts with this text.
fn table(words: &[(&str, &str)], span: &Range<usize>, attributes: &[Attribute]) -> LocatedValue {
    let text =
        |&(key, word): &(&str, &str)| (key.to_owned(), LocatedValue::text(word, span.clone()));
    let entries = words.iter().map(text).chain(attributes.iter().cloned());
    LocatedValue { value: Tree::Table(entries.collect()), span: span.clone() }
}

/// Adds the nodes that are not yet robots of the scenario.
fn new_robots(network: &Network, names: &[String], robots: &RobotsInText<'_>) -> Vec<LocatedValue> {
    let new = network.nodes.iter().zip(names).filter(|(_, name)| robots.find(name).is_none());
    new.map(|(node, name)| table(&[("name", name)], &node.span, &node.attributes)).collect()
}

fn edges(network: &Network, names: &[String]) -> Vec<LocatedValue> {
    let edge = |ImportedEdge { from, to, span, attributes }: &ImportedEdge| {
        table(&[("from", &names[*from]), ("to", &names[*to])], span, attributes)
    };
    network.links.iter().map(edge).collect()
}

/// Returns the robots in the text of the scenario.
struct RobotsInText<'t> {
    list: List,
    robots: Vec<RobotText<'t>>,
}

/// A robot in the text of the scenario.
struct RobotText<'t> {
    name: &'t str,
    keys: BTreeSet<&'t str>,
    /// Byte position after the robot's name, where more keys can be inserted.
    end: usize,
    inline: bool,
}

impl<'t> RobotsInText<'t> {
    fn read(
        root: &TableReader<'t, keys::Root>,
        text: &str,
    ) -> Result<RobotsInText<'t>, Diagnostic> {
        let list = List::read(root, keys::Root::robot, text)?;
        let inline = matches!(list, List::Inline { .. });
        let known = |table: &TableReader<'t, keys::Robot>| {
            let name = table.required(keys::Robot::name)?;
            let behind = &text[name.span().end..];
            // After the line of the name, including its comment.
            let rest = if inline { 0 } else { behind.find(['\r', '\n']).unwrap_or(behind.len()) };
            Ok(RobotText {
                name: name.text("expected a string")?,
                keys: table.keys().map(|(key, _)| key).collect(),
                end: name.span().end + rest,
                inline,
            })
        };
        let robots =
            root.tables(keys::Root::robot)?.iter().map(known).collect::<Result<_, Diagnostic>>()?;
        Ok(RobotsInText { list, robots })
    }

    fn find(&self, name: &str) -> Option<&RobotText<'t>> {
        self.robots.iter().find(|robot| robot.name == name)
    }

    /// Returns the robot name of each node. Numbers count the robots, from 0 or from 1.
    fn robot_names(&self, network: &Network, graph: &Source) -> Result<Vec<String>, Diagnostic> {
        let nodes = &network.nodes;
        let number = |node: &Node| match node.name {
            Name::Number(number) => Some(number),
            Name::Text(_) => None,
        };
        let numbers: BTreeSet<i64> = nodes.iter().filter_map(number).collect();
        let Some(&first) = numbers.first() else {
            let text = |node: &Node| match &node.name {
                Name::Text(text) => text.clone(),
                Name::Number(_) => unreachable!("none has a number"),
            };
            return Ok(nodes.iter().map(text).collect());
        };
        if let Some(node) = nodes.iter().find(|node| number(node).is_none()) {
            return Err(graph.error(
                &node.span,
                format!("node {} has a name, but others have numbers", node.name),
                "expected names of robots, or numbers for all",
            ));
        }
        let count = nodes.len();
        if let Some(node) = nodes.iter().find(|node| {
            !(0..count as i64).contains(&(number(node).unwrap_or(-1) - first.clamp(0, 1)))
        }) {
            return Err(graph.error(
                &node.span,
                format!("node {} is out of range: the graph has {count} nodes", node.name),
                format!(
                    "expected numbers from 0 to {}, or from 1 to {count}: they count the robots",
                    count - 1
                ),
            ));
        }
        let own = self.robots.len();
        if own != 0 && own != count {
            return Err(graph.error(
                &nodes[count - 1].span,
                format!(
                    "the graph has {count} nodes with numbers, but the scenario has {own} robots"
                ),
                "expected as many nodes as robots, or nodes with names",
            ));
        }
        let name = |node: &Node| {
            let at = (number(node).unwrap_or(first) - first) as usize;
            self.robots.get(at).map_or(format!("r{}", at + 1), |robot| robot.name.to_owned())
        };
        Ok(nodes.iter().map(name).collect())
    }

    /// Adds attributes of nodes to robots of the scenario that do not set these keys.
    fn robot_attribute_edits(&self, network: &Network, names: &[String]) -> Vec<Edit> {
        let mut edits = Vec::new();
        for (node, name) in network.nodes.iter().zip(names) {
            let Some(robot) = self.find(name) else { continue };
            let mut added = Written::default();
            let new = node.attributes.iter().filter(|(key, _)| !robot.keys.contains(key.as_str()));
            let before = if robot.inline { ", " } else { "\n" };
            new.for_each(|(key, value)| added.entry(before, key, value));
            edits.push((robot.end..robot.end, added));
        }
        edits
    }
}
