//! An imported graph written out into the scenario's own text.
//!
//! The text that comes out needs no other file and is a scenario that can be run again. Mistakes
//! found in it are shown where they were made: in the scenario's file, or in the graph's.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use toml::de::DeTable;

use super::{Attribute, Chunk, Link, Name, Network, Node, chunk, network, quoted};
use crate::scenario::diagnostic::{Diagnostic, Origin, Source};
use crate::scenario::file::{FILE_BYTES_MAX, load};
use crate::scenario::keys::{Format, Key};
use crate::scenario::table::{Document, Table, Value};

/// A scenario's text with its graph in it.
pub(in crate::scenario) struct Spliced {
    pub(in crate::scenario) text: String,
    pub(in crate::scenario) source: Source,
    pub(in crate::scenario) warnings: Vec<Diagnostic>,
}

/// The text with the graph that it names, if it names one.
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
    let root = Table::root(&document, entries);
    let value = root.need("graph")?;
    let expected = "expected a file that ends in .json (node-link), .csv (matrix) or .graphml";
    let name = value.text(expected)?;
    let file = path.parent().unwrap_or(Path::new("")).join(name);
    let shown = file.display();
    let graph_text = load(&file, expected).map_err(|trouble| {
        value.wrong(format!("names `{shown}`, which {}", trouble.what), trouble.expected)
    })?;
    let graph_text = graph_text.strip_prefix('\u{feff}').unwrap_or(&graph_text);
    let graph = Source::new(&file, graph_text, false);
    let graph = graph.imported_by(document.source.spot(&value.span()));
    let robot_keys = format.section("robot").keys.iter().flat_map(Key::names);
    let robot_keys: Vec<&str> = robot_keys.filter(|key| *key != "name").collect();
    let network = network(&file, &graph, graph_text, &robot_keys)
        .unwrap_or_else(|| Err(value.wrong(format!("is \"{name}\""), expected)))?;
    let warnings = network.warnings(&graph);

    let robots = Robots::read(&root, text)?;
    let names = robots.named(&network, &graph)?;
    let mut edits = robots.edits(&network, &names);
    let here = value.span();
    let mut lists: Vec<Chunk> = vec![chunk(format!("# {name:?}, written out:"), &(0..0))];
    for (key, items, list) in [
        ("robot", new_robots(&network, &names, &robots), &robots.list),
        ("edge", edges(&network, &names), &List::read(&root, "edge", text)?),
    ] {
        list.add(key, items, &mut lists, &mut edits, text);
    }
    if lists.len() == 1 {
        lists.clear();
    }
    edits.push(Edit { at: key.span().start..here.end, chunks: lists });
    let (spliced, origins) = apply(text, edits);
    if spliced.len() as u64 > FILE_BYTES_MAX {
        return Err(value.wrong(
            format!("names `{shown}`: written out, the scenario has {} bytes", spliced.len()),
            "expected a smaller graph",
        ));
    }
    let source = Source::spliced(path, &spliced, origins, document.source, graph);
    Ok(Spliced { text: spliced, source, warnings })
}

/// A stretch of the scenario's text and what takes its place.
struct Edit {
    at: Range<usize>,
    chunks: Vec<Chunk>,
}

/// The text after all edits, and from where on which part of it comes from where.
fn apply(text: &str, mut edits: Vec<Edit>) -> (String, Vec<(usize, Origin)>) {
    edits.sort_by_key(|edit| edit.at.start);
    let mut result = String::new();
    let mut origins = Vec::new();
    let mut copied = 0;
    for edit in edits {
        origins.push((result.len(), Origin::Scenario(copied)));
        result += &text[copied..edit.at.start];
        copied = edit.at.end;
        for chunk in edit.chunks {
            origins.push((result.len(), Origin::Graph(chunk.origin)));
            result += &chunk.text;
        }
    }
    origins.push((result.len(), Origin::Scenario(copied)));
    result += &text[copied..];
    (result, origins)
}

/// How a list of tables is written.
enum List {
    /// Not at all.
    Absent,
    /// `[[robot]]`
    Headed,
    /// `robot = [...]`; behind its last element, or behind its bracket, more can be added.
    Inline { end: usize, empty: bool },
}

impl List {
    fn read(root: &Table<'_>, key: &str, text: &str) -> Result<List, Diagnostic> {
        let Some(list) = root.get(key) else { return Ok(List::Absent) };
        Ok(match root.tables(key)?.last() {
            None => List::Inline { end: list.span().start + 1, empty: true },
            Some(last) if text[last.span().start..].starts_with('{') => {
                List::Inline { end: last.span().end, empty: false }
            }
            Some(_) => List::Headed,
        })
    }

    /// Adds tables: to `here`, where the graph was named, if there is no such list yet.
    fn add(
        &self,
        key: &str,
        tables: Vec<Item>,
        here: &mut Vec<Chunk>,
        edits: &mut Vec<Edit>,
        text: &str,
    ) {
        if tables.is_empty() {
            return;
        }
        let nowhere = 0..0;
        let mut chunks = Vec::new();
        match self {
            List::Absent => {
                here.push(chunk(format!("\n{key} = ["), &nowhere));
                for table in tables {
                    here.push(chunk("\n    ", &table.span));
                    table.write_inline(here);
                    here.push(chunk(",", &nowhere));
                }
                here.push(chunk("\n]", &nowhere));
            }
            List::Headed => {
                for table in tables {
                    chunks.push(chunk(format!("\n[[{key}]]"), &table.span));
                    for attribute in table.keys {
                        chunks.push(chunk(format!("\n{} = ", attribute.key), &attribute.span));
                        chunks.extend(attribute.value);
                    }
                    chunks.push(chunk("\n", &nowhere));
                }
                if !text.ends_with('\n') {
                    chunks.insert(0, chunk("\n", &nowhere));
                }
                edits.push(Edit { at: text.len()..text.len(), chunks });
            }
            List::Inline { end, empty } => {
                for (at, table) in tables.into_iter().enumerate() {
                    let comma = if *empty && at == 0 { "" } else { "," };
                    chunks.push(chunk(format!("{comma}\n    "), &table.span));
                    table.write_inline(&mut chunks);
                }
                edits.push(Edit { at: *end..*end, chunks });
            }
        }
    }
}

/// A table to be written.
struct Item {
    keys: Vec<Attribute>,
    span: Range<usize>,
}

impl Item {
    fn write_inline(self, chunks: &mut Vec<Chunk>) {
        chunks.push(chunk("{ ", &self.span));
        for (at, attribute) in self.keys.into_iter().enumerate() {
            let comma = if at > 0 { ", " } else { "" };
            chunks.push(chunk(format!("{comma}{} = ", attribute.key), &attribute.span));
            chunks.extend(attribute.value);
        }
        chunks.push(chunk(" }", &self.span));
    }
}

fn text_key(key: &str, value: &str, span: &Range<usize>) -> Attribute {
    Attribute { key: key.to_owned(), value: vec![chunk(quoted(value), span)], span: span.clone() }
}

/// The nodes that are no robots of the scenario yet.
fn new_robots(network: &Network, names: &[String], robots: &Robots<'_>) -> Vec<Item> {
    let item = |(node, name): (&Node, &String)| {
        let mut keys = vec![text_key("name", name, &node.span)];
        keys.extend(node.attributes.iter().cloned());
        Item { keys, span: node.span.clone() }
    };
    let nodes = network.nodes.iter().zip(names);
    nodes.filter(|(_, name)| robots.find(name).is_none()).map(item).collect()
}

fn edges(network: &Network, names: &[String]) -> Vec<Item> {
    let item = |link: &Link| {
        let mut keys = vec![
            text_key("from", &names[link.from], &link.span),
            text_key("to", &names[link.to], &link.span),
        ];
        keys.extend(link.attributes.iter().cloned());
        Item { keys, span: link.span.clone() }
    };
    network.links.iter().map(item).collect()
}

/// The robots that the scenario's own text has.
struct Robots<'t> {
    list: List,
    robots: Vec<Known<'t>>,
}

/// A robot that the scenario's own text has.
struct Known<'t> {
    name: &'t str,
    keys: BTreeSet<&'t str>,
    /// Behind its name: where more keys can be written.
    end: usize,
    inline: bool,
}

impl<'t> Robots<'t> {
    fn read(root: &Table<'t>, text: &str) -> Result<Robots<'t>, Diagnostic> {
        let list = List::read(root, "robot", text)?;
        let inline = matches!(list, List::Inline { .. });
        let known = |table: &Table<'t>| {
            let name: Value<'t> = table.need("name")?;
            let behind = &text[name.span().end..];
            // Behind the name's line, and whatever comment is on it.
            let rest = if inline { 0 } else { behind.find(['\r', '\n']).unwrap_or(behind.len()) };
            Ok(Known {
                name: name.text("expected a string")?,
                keys: table.keys().map(|(key, _)| key).collect(),
                end: name.span().end + rest,
                inline,
            })
        };
        let robots = root.tables("robot")?.iter().map(known).collect::<Result<_, Diagnostic>>()?;
        Ok(Robots { list, robots })
    }

    fn find(&self, name: &str) -> Option<&Known<'t>> {
        self.robots.iter().find(|robot| robot.name == name)
    }

    /// The name of each node's robot. Numbers count the robots, from 0 or from 1.
    fn named(&self, network: &Network, graph: &Source) -> Result<Vec<String>, Diagnostic> {
        let nodes = &network.nodes;
        let number = |node: &Node| match node.name {
            Name::Number(number) => Some(number),
            Name::Text(_) => None,
        };
        let numbers: BTreeSet<i64> = nodes.iter().filter_map(number).collect();
        let Some(&first) = numbers.first() else {
            return Ok(nodes.iter().map(|node| node.name.to_text()).collect());
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
                format!("node {} is one of {count}", node.name),
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

    /// What nodes say of robots that the scenario has already, where it does not say so itself.
    fn edits(&self, network: &Network, names: &[String]) -> Vec<Edit> {
        let mut edits = Vec::new();
        for (node, name) in network.nodes.iter().zip(names) {
            let Some(robot) = self.find(name) else { continue };
            let mut chunks = Vec::new();
            for attribute in &node.attributes {
                if !robot.keys.contains(attribute.key.as_str()) {
                    let before = if robot.inline { ", " } else { "\n" };
                    chunks.push(chunk(format!("{before}{} = ", attribute.key), &attribute.span));
                    chunks.extend(attribute.value.iter().cloned());
                }
            }
            edits.push(Edit { at: robot.end..robot.end, chunks });
        }
        edits
    }
}

impl Name {
    fn to_text(&self) -> String {
        match self {
            Name::Text(text) => text.clone(),
            Name::Number(number) => number.to_string(),
        }
    }
}
