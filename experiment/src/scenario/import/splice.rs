//! Insertion of an imported graph into the text of the scenario.
//!
//! The resulting text needs no other file and is a complete scenario. Its diagnostics point into the scenario file or
//! the graph file, where the cause is.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use toml::de::{DeTable, DeValue};

use super::encoding::decode;
use super::{
    Attribute, AttributeValue, ImportedEdge, ImportedGraph, ImportedNode, LocatedValue, NodeId,
    parse_network,
};
use crate::scenario::diagnostic::{Diagnostic, SourceText, TextOrigin};
use crate::scenario::fields::{TableFormat, TypedKey, kinds};
use crate::scenario::file::{FILE_BYTES_MAX, FileError, check_inside_folder, load_bytes};
use crate::scenario::format::{FileFormat, KeySpec};
use crate::scenario::keys;
use crate::scenario::table::{Document, TableReader};

/// Text of a scenario with its graph inserted.
pub(in crate::scenario) struct SplicedText {
    pub(in crate::scenario) text: String,
    pub(in crate::scenario) source: SourceText,
    pub(in crate::scenario) warnings: Vec<Diagnostic>,
}

/// Returns the text with the graph inserted that it names, if it names one.
pub(in crate::scenario) fn splice_graph(
    path: &Path,
    text: &str,
    source: SourceText,
    entries: &DeTable<'_>,
    format: &FileFormat,
) -> Result<SplicedText, Diagnostic> {
    let graph_entry = entries.get_key_value("graph");
    // A table is a graph that the scenario itself describes.
    let graph_entry =
        graph_entry.filter(|(_, value)| !matches!(value.get_ref(), DeValue::Table(_)));
    let Some((key, _)) = graph_entry else {
        return Ok(SplicedText { text: text.to_owned(), source, warnings: Vec::new() });
    };
    let document = Document::new(source, format);
    let root: TableReader<'_, keys::Root> = TableReader::root(&document, entries, "the scenario");
    let value = root.required_value(keys::Root::graph)?;
    let expected = "expected a file that ends in .json (node-link), .csv (matrix) or .graphml";
    let name = value.text(expected)?;
    let file = path.parent().unwrap_or(Path::new("")).join(name);
    let file_name = file.display();
    let folder = file.parent().unwrap_or(Path::new(""));
    let is_in_its_folder = match check_inside_folder(folder, &file) {
        Err(error) if file.exists() => Err(FileError {
            problem: format!("cannot be read: {error}"),
            remedy: "expected the file itself, because a symbolic link in an untrusted folder may point to any file",
        }),
        _ => Ok(()),
    };
    let graph_text = is_in_its_folder.and_then(|()| decode(load_bytes(&file, expected)?));
    let graph_text = graph_text.map_err(|error| {
        value.error_about_key(format!("names `{file_name}`, which {}", error.problem), error.remedy)
    })?;
    let graph_text = graph_text.strip_prefix('\u{feff}').unwrap_or(&graph_text);
    let graph = SourceText::new(&file, graph_text, false);
    let graph = graph.with_import_location(document.source.location(&value.span()));
    let robot_keys = format.section("robot").keys.iter().flat_map(KeySpec::names);
    let robot_keys: Vec<&str> = robot_keys.filter(|key| *key != "name").collect();
    let network = parse_network(&file, &graph, graph_text, &robot_keys)
        .unwrap_or_else(|| Err(value.error_about_key(format!("is \"{name}\""), expected)))?;
    let warnings = network.warnings(&graph);

    let robots = RobotsInText::read(&root, text)?;
    let names = robots.robot_names(&network, &graph)?;
    let mut edits = robots.robot_attribute_edits(&network, &names);
    let value_span = value.span();
    let mut lists = ComposedText::default();
    lists.push_generated(&format!("# {name:?}, written out:"), &EMPTY_SPAN);
    robots.list.add_tables(
        "robot",
        new_robot_tables(&network, &names, &robots),
        &mut lists,
        &mut edits,
        text,
    );
    let list = ListNotation::read(&root, keys::Root::edge, text)?;
    list.add_tables("edge", edge_tables(&network, &names), &mut lists, &mut edits, text);
    if lists.origins.len() == 1 {
        lists = ComposedText::default();
    }
    edits.push((key.span().start..value_span.end, lists));
    let ComposedText { text: spliced, origins } = apply_edits(text, edits);
    if spliced.len() as u64 > FILE_BYTES_MAX {
        return Err(value.error_about_key(
            format!("names `{file_name}`: written out, the scenario has {} bytes", spliced.len()),
            "expected a smaller graph",
        ));
    }
    let source = SourceText::from_parts(path, &spliced, origins, document.source, graph);
    Ok(SplicedText { text: spliced, source, warnings })
}

/// Origin of generated text that has no location in the graph file.
const EMPTY_SPAN: Range<usize> = 0..0;

/// An edit: a range of the text and its replacement.
type TextEdit = (Range<usize>, ComposedText);

/// A composed text with the origins of its parts.
#[derive(Default)]
struct ComposedText {
    text: String,
    origins: Vec<(usize, TextOrigin)>,
}

impl ComposedText {
    /// Appends generated text whose origin is `span` in the graph file.
    fn push_generated(&mut self, text: &str, span: &Range<usize>) {
        self.origins.push((self.text.len(), TextOrigin::Graph(span.clone())));
        self.text += text;
    }

    fn push_value(&mut self, LocatedValue { value, span }: &LocatedValue) {
        match value {
            AttributeValue::Plain(text) => self.push_generated(text, span),
            AttributeValue::Unreadable { .. } => unreachable!("it was refused or ignored"),
            AttributeValue::List(list) => {
                self.push_generated("[", span);
                for (at, element) in list.iter().enumerate() {
                    self.push_generated(if at > 0 { ", " } else { "" }, &element.span);
                    self.push_value(element);
                }
                self.push_generated("]", span);
            }
            AttributeValue::Table(entries) => {
                for (at, (key, value)) in entries.iter().enumerate() {
                    self.push_entry(if at > 0 { ", " } else { "{ " }, key, value);
                }
                self.push_generated(if entries.is_empty() { "{ }" } else { " }" }, span);
            }
        }
    }

    fn push_entry(&mut self, prefix: &str, key: &str, value: &LocatedValue) {
        self.push_generated(&format!("{prefix}{} = ", toml_edit::Key::new(key)), &value.span);
        self.push_value(value);
    }

    /// Appends a copy of the scenario's text from `at` on.
    fn push_copy(&mut self, text: &str, at: usize) {
        self.origins.push((self.text.len(), TextOrigin::Scenario(at)));
        self.text += text;
    }
}

/// Returns the text after all edits.
fn apply_edits(text: &str, mut edits: Vec<TextEdit>) -> ComposedText {
    edits.sort_by_key(|(range, _)| range.start);
    let mut result = ComposedText::default();
    let mut copied = 0;
    for (range, replacement) in edits {
        result.push_copy(&text[copied..range.start], copied);
        copied = range.end;
        let start = result.text.len();
        result.text += &replacement.text;
        result.origins.extend(replacement.origins.into_iter().map(|(at, from)| (start + at, from)));
    }
    result.push_copy(&text[copied..], copied);
    result
}

/// Notation of a list of tables.
enum ListNotation {
    /// The scenario has no such list.
    Absent,
    /// Headed tables, `[[robot]]`.
    TableHeaders,
    /// An inline list, `robot = [...]`, with the position after its last element or after its bracket, where more can
    /// be added.
    Inline { end: usize, is_empty: bool },
}

impl ListNotation {
    fn read<S: TableFormat>(
        root: &TableReader<'_, keys::Root>,
        key: TypedKey<keys::Root, kinds::Tables<S>>,
        text: &str,
    ) -> Result<ListNotation, Diagnostic> {
        let Some(list) = root.get(key) else { return Ok(ListNotation::Absent) };
        Ok(match root.tables(key)?.last() {
            None => ListNotation::Inline { end: list.span().start + 1, is_empty: true },
            Some(last) if text[last.span().start..].starts_with('{') => {
                ListNotation::Inline { end: last.span().end, is_empty: false }
            }
            Some(_) => ListNotation::TableHeaders,
        })
    }

    /// Adds tables to the list, or to `insertion`, which replaces the key `graph`, if there is no list yet.
    fn add_tables(
        &self,
        key: &str,
        tables: Vec<LocatedValue>,
        insertion: &mut ComposedText,
        edits: &mut Vec<TextEdit>,
        text: &str,
    ) {
        if tables.is_empty() {
            return;
        }
        let mut added = ComposedText::default();
        match self {
            ListNotation::Absent => {
                insertion.push_generated(&format!("\n{key} = ["), &EMPTY_SPAN);
                for table in tables {
                    insertion.push_generated("\n    ", &table.span);
                    insertion.push_value(&table);
                    insertion.push_generated(",", &EMPTY_SPAN);
                }
                insertion.push_generated("\n]", &EMPTY_SPAN);
            }
            ListNotation::TableHeaders => {
                added.push_generated(if text.ends_with('\n') { "" } else { "\n" }, &EMPTY_SPAN);
                for table in tables {
                    added.push_generated(&format!("\n[[{key}]]"), &table.span);
                    let AttributeValue::Table(entries) = &table.value else {
                        unreachable!("it is a table")
                    };
                    entries.iter().for_each(|(key, value)| added.push_entry("\n", key, value));
                    added.push_generated("\n", &EMPTY_SPAN);
                }
                edits.push((text.len()..text.len(), added));
            }
            ListNotation::Inline { end, is_empty } => {
                for (index, table) in tables.iter().enumerate() {
                    let comma = if *is_empty && index == 0 { "" } else { "," };
                    added.push_generated(&format!("{comma}\n    "), &table.span);
                    added.push_value(table);
                }
                edits.push((*end..*end, added));
            }
        }
    }
}

/// Creates a table that starts with these entries.
fn table_value(
    texts: &[(&str, &str)],
    span: &Range<usize>,
    attributes: &[Attribute],
) -> LocatedValue {
    let text =
        |&(key, text): &(&str, &str)| (key.to_owned(), LocatedValue::from_text(text, span.clone()));
    let entries = texts.iter().map(text).chain(attributes.iter().cloned());
    LocatedValue { value: AttributeValue::Table(entries.collect()), span: span.clone() }
}

/// Returns tables of the nodes that are not yet robots of the scenario.
fn new_robot_tables(
    network: &ImportedGraph,
    names: &[String],
    robots: &RobotsInText<'_>,
) -> Vec<LocatedValue> {
    let new = network.nodes.iter().zip(names).filter(|(_, name)| robots.find_robot(name).is_none());
    new.map(|(node, name)| table_value(&[("name", name)], &node.span, &node.attributes)).collect()
}

fn edge_tables(network: &ImportedGraph, names: &[String]) -> Vec<LocatedValue> {
    let edge = |ImportedEdge { from, to, span, attributes }: &ImportedEdge| {
        table_value(&[("from", &names[*from]), ("to", &names[*to])], span, attributes)
    };
    network.links.iter().map(edge).collect()
}

/// Robots in the text of the scenario.
struct RobotsInText<'t> {
    list: ListNotation,
    robots: Vec<RobotText<'t>>,
}

/// A robot in the text of the scenario.
struct RobotText<'t> {
    name: &'t str,
    keys: BTreeSet<&'t str>,
    /// Byte position after the robot's name, where more keys can be inserted.
    insert_position: usize,
    is_inline: bool,
}

impl<'t> RobotsInText<'t> {
    fn read(
        root: &TableReader<'t, keys::Root>,
        text: &str,
    ) -> Result<RobotsInText<'t>, Diagnostic> {
        let list = ListNotation::read(root, keys::Root::robot, text)?;
        let is_inline = matches!(list, ListNotation::Inline { .. });
        let robot_text = |table: &TableReader<'t, keys::Robot>| {
            let name = table.required_value(keys::Robot::name)?;
            let after_name = &text[name.span().end..];
            // After the line of the name, including its comment.
            let offset = if is_inline {
                0
            } else {
                after_name.find(['\r', '\n']).unwrap_or(after_name.len())
            };
            Ok(RobotText {
                name: name.text("expected a string")?,
                keys: table.keys().map(|(key, _)| key).collect(),
                insert_position: name.span().end + offset,
                is_inline,
            })
        };
        let robots = root
            .tables(keys::Root::robot)?
            .iter()
            .map(robot_text)
            .collect::<Result<_, Diagnostic>>()?;
        Ok(RobotsInText { list, robots })
    }

    fn find_robot(&self, name: &str) -> Option<&RobotText<'t>> {
        self.robots.iter().find(|robot| robot.name == name)
    }

    /// Returns the robot name of each node. Numbers count the robots, from 0 or from 1.
    fn robot_names(
        &self,
        network: &ImportedGraph,
        graph: &SourceText,
    ) -> Result<Vec<String>, Diagnostic> {
        let nodes = &network.nodes;
        let number = |node: &ImportedNode| match node.name {
            NodeId::Number(number) => Some(number),
            NodeId::Text(_) => None,
        };
        let numbers: BTreeSet<i64> = nodes.iter().filter_map(number).collect();
        let Some(&first) = numbers.first() else {
            let text = |node: &ImportedNode| match &node.name {
                NodeId::Text(text) => text.clone(),
                NodeId::Number(_) => unreachable!("none has a number"),
            };
            return Ok(nodes.iter().map(text).collect());
        };
        if let Some(node) = nodes.iter().find(|node| number(node).is_none()) {
            return Err(graph.error_at(
                &node.span,
                format!("node {} has a name, but others have numbers", node.name),
                "expected names of robots, or numbers for all",
            ));
        }
        let count = nodes.len();
        if let Some(node) = nodes.iter().find(|node| {
            !(0..count as i64).contains(&(number(node).unwrap_or(-1) - first.clamp(0, 1)))
        }) {
            return Err(graph.error_at(
                &node.span,
                format!("node {} is out of range: the graph has {count} nodes", node.name),
                format!(
                    "expected numbers from 0 to {}, or from 1 to {count}: they count the robots",
                    count - 1
                ),
            ));
        }
        let robot_count = self.robots.len();
        if robot_count != 0 && robot_count != count {
            return Err(graph.error_at(
                &nodes[count - 1].span,
                format!(
                    "the graph has {count} nodes with numbers, but the scenario has {robot_count} robots"
                ),
                "expected as many nodes as robots, or nodes with names",
            ));
        }
        let name = |node: &ImportedNode| {
            let index = (number(node).unwrap_or(first) - first) as usize;
            self.robots.get(index).map_or(format!("r{}", index + 1), |robot| robot.name.to_owned())
        };
        Ok(nodes.iter().map(name).collect())
    }

    /// Adds attributes of nodes to robots of the scenario that do not set these keys.
    fn robot_attribute_edits(&self, network: &ImportedGraph, names: &[String]) -> Vec<TextEdit> {
        let mut edits = Vec::new();
        for (node, name) in network.nodes.iter().zip(names) {
            let Some(robot) = self.find_robot(name) else { continue };
            let mut added = ComposedText::default();
            let new = node.attributes.iter().filter(|(key, _)| !robot.keys.contains(key.as_str()));
            let separator = if robot.is_inline { ", " } else { "\n" };
            new.for_each(|(key, value)| added.push_entry(separator, key, value));
            edits.push((robot.insert_position..robot.insert_position, added));
        }
        edits
    }
}
