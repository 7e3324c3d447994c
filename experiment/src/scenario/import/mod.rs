//! Import of graphs that other tools wrote: `graph = "file"`.
//!
//! A file of any format is parsed to an [`ImportedGraph`]; `splice` inserts it into the text of the scenario. In all
//! formats an edge points in the direction of the information flow: the target receives from the source. A matrix is
//! that of (6): a_ij is not 0 if i receives from j.
//!
//! | file | question it answers |
//! |---|---|
//! | `encoding` | which characters does a file have? |
//! | `fields` | which rows and fields does separated text have? |
//! | `json` `matrix` `graphml` | which graph does a file of this format describe? |
//! | `splice` | how is the graph inserted into the scenario? |
//! | `mod` | what do attributes of nodes and edges mean? |

mod encoding;
mod fields;
#[cfg(test)]
mod foreign;
mod graphml;
mod json;
mod matrix;
pub(super) mod splice;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use crate::scenario::diagnostic::{Diagnostic, SourceText, most_similar_word};

/// Keys of an edge other than its sender and receiver.
const EDGE_KEYS: &[&str] = &["offset_m"];
/// Keys of robots and edges with lists and tables, which tools without these write as one attribute for each component.
const COMPONENT_KEYS: &[(&str, &[&str])] = &[
    ("pose", &["x_m", "y_m", "heading_rad"]),
    ("place_m", &["place_x_m", "place_y_m"]),
    ("offset_m", &["offset_x_m", "offset_y_m"]),
];
/// networkx's name for the drawing position of a node. It is not a misspelled `pose`.
const DRAWING_POSITION_KEY: &str = "pos";
/// Maximum number of attributes without a meaning that get a warning of their own; one more counts the rest.
const IGNORED_ATTRIBUTE_WARNINGS_MAX: usize = 8;

/// A graph as parsed from its file.
#[derive(Debug, Default)]
struct ImportedGraph {
    nodes: Vec<ImportedNode>,
    links: Vec<ImportedEdge>,
    /// Attributes without an effect.
    ignored_attributes: BTreeMap<String, IgnoredAttribute>,
    /// The first weight of a matrix that is neither 0 nor 1.
    first_weight: Option<(String, Range<usize>)>,
}

/// An attribute without an effect.
#[derive(Debug)]
struct IgnoredAttribute {
    /// Location at which the attribute is first used.
    span: Range<usize>,
    /// Similar key, if any.
    similar_key: Option<String>,
}

/// A node, which is a robot.
#[derive(Debug)]
struct ImportedNode {
    name: NodeId,
    span: Range<usize>,
    attributes: Vec<Attribute>,
}

/// Id of a node in the file.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum NodeId {
    /// A robot name.
    Text(String),
    /// A number that counts the robots.
    Number(i64),
}

impl std::fmt::Display for NodeId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NodeId::Text(text) => write!(f, "{text:?}"),
            NodeId::Number(number) => write!(f, "{number}"),
        }
    }
}

impl NodeId {
    /// Converts an id from a format without numbers.
    fn from_text(text: &str) -> NodeId {
        text.parse().map_or_else(|_| NodeId::Text(text.to_owned()), NodeId::Number)
    }
}

/// An edge, by the indices of its nodes. `to` receives from `from`.
#[derive(Debug)]
struct ImportedEdge {
    from: usize,
    to: usize,
    span: Range<usize>,
    attributes: Vec<Attribute>,
}

/// A key and its value.
type Attribute = (String, LocatedValue);

/// A value and its location in the graph file.
#[derive(Debug, Clone)]
struct LocatedValue {
    value: AttributeValue,
    span: Range<usize>,
}

/// Value of an attribute.
#[derive(Debug, Clone)]
enum AttributeValue {
    /// Text of the value in TOML.
    Plain(String),
    List(Vec<LocatedValue>),
    Table(Vec<Attribute>),
    /// Reason why the value cannot be written in TOML. It is an error only if the attribute has a meaning.
    Unreadable {
        message: String,
        remedy: &'static str,
    },
}

impl LocatedValue {
    /// Creates a quoted TOML string.
    fn from_text(text: &str, span: Range<usize>) -> LocatedValue {
        LocatedValue {
            value: AttributeValue::Plain(toml_edit::Value::from(text).to_string()),
            span,
        }
    }

    fn unreadable_value(
        message: String,
        expected: &'static str,
        span: Range<usize>,
    ) -> LocatedValue {
        LocatedValue { value: AttributeValue::Unreadable { message, remedy: expected }, span }
    }

    /// Returns the error of the first unreadable value within this value, or `None`.
    fn first_error(&self, source: &SourceText) -> Option<Diagnostic> {
        match &self.value {
            AttributeValue::Plain(_) => None,
            AttributeValue::List(list) => list.iter().find_map(|given| given.first_error(source)),
            AttributeValue::Table(entries) => {
                entries.iter().find_map(|(_, given)| given.first_error(source))
            }
            AttributeValue::Unreadable { message, remedy: expected } => {
                Some(source.error_at(&self.span, message, *expected))
            }
        }
    }
}

/// Parses a graph in the format of its file extension, or returns `None` if the format is unknown. `robot_keys`:
/// attributes of nodes that are keys of robots.
fn parse_network(
    file: &Path,
    source: &SourceText,
    text: &str,
    robot_keys: &[&str],
) -> Option<Result<ImportedGraph, Diagnostic>> {
    let reader = match file.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "json" => json::read,
        "csv" => matrix::read,
        "graphml" => graphml::read,
        _ => return None,
    };
    Some(reader(source, text, robot_keys))
}

/// Returns whether `key` is one of these keys or a component of one.
fn is_known_key(key: &str, known: &[&str]) -> bool {
    let components =
        COMPONENT_KEYS.iter().filter(|(key_of_components, _)| known.contains(key_of_components));
    known.contains(&key) || components.flat_map(|(_, names)| names.iter()).any(|name| *name == key)
}

/// A graph under construction.
struct ImportedGraphBuilder<'a> {
    source: &'a SourceText,
    robot_keys: &'a [&'a str],
    network: ImportedGraph,
    node_indices: BTreeMap<NodeId, usize>,
    /// Edges found so far, one for each direction.
    seen_edges: BTreeMap<[usize; 2], SeenEdge>,
}

/// An edge of the file.
struct SeenEdge {
    span: Range<usize>,
    /// Nodes of an undirected edge in file order; `None` for a directed edge.
    undirected_endpoints: Option<[usize; 2]>,
}

impl<'a> ImportedGraphBuilder<'a> {
    fn new(source: &'a SourceText, robot_keys: &'a [&'a str]) -> ImportedGraphBuilder<'a> {
        let (node_indices, seen_edges) = (BTreeMap::new(), BTreeMap::new());
        ImportedGraphBuilder {
            source,
            robot_keys,
            network: ImportedGraph::default(),
            node_indices,
            seen_edges,
        }
    }

    fn add_node(
        &mut self,
        name: NodeId,
        span: Range<usize>,
        attributes: Vec<Attribute>,
    ) -> Result<(), Diagnostic> {
        let number = self.network.nodes.len();
        if let Some(first) = self.node_indices.insert(name.clone(), number) {
            let line = self.source.line_number_at(self.network.nodes[first].span.start);
            return Err(self.source.error_at(
                &span,
                format!("node {name} occurs twice, first in line {line}"),
                "expected a unique name",
            ));
        }
        let attributes =
            self.convert_to_keys(&format!("node {name}"), attributes, self.robot_keys)?;
        self.network.nodes.push(ImportedNode { name, span, attributes });
        Ok(())
    }

    /// Adds an edge; an undirected one in both directions. Fails for a duplicate, except that an undirected edge may be
    /// given from both ends.
    fn add_edge(
        &mut self,
        endpoints: [(NodeId, Range<usize>); 2],
        directed: bool,
        span: Range<usize>,
        attributes: Vec<Attribute>,
    ) -> Result<(), Diagnostic> {
        let title = format!("edge {} - {}", endpoints[0].0, endpoints[1].0);
        let mut indices = [0; 2];
        for (index, (name, span)) in indices.iter_mut().zip(&endpoints) {
            *index = *self.node_indices.get(name).ok_or_else(|| {
                let message = format!("an edge ends at {name}, but there is no such node");
                self.source.error_at(span, message, self.known_nodes_remedy())
            })?;
        }
        let attributes = self.convert_to_keys(&title, attributes, EDGE_KEYS)?;
        if let (false, Some((key, offset))) = (directed, attributes.first()) {
            return Err(self.source.error_at(
                &offset.span,
                format!("`{key}` is given for an edge without a direction, so it is not known which end it refers to"),
                "expected a directed graph, or `place_m` = [x, y] in the nodes",
            ));
        }
        let [from, to] = indices;
        let earlier = self
            .seen_edges
            .get(&indices)
            .or_else(|| self.seen_edges.get(&[to, from]).filter(|_| !directed));
        if let Some(earlier) = earlier {
            if !directed && from != to && earlier.undirected_endpoints == Some([to, from]) {
                return Ok(());
            }
            let line = self.source.line_number_at(earlier.span.start);
            return Err(self.source.error_at(
                &span,
                format!("{title} occurs twice, first in line {line}"),
                "expected one edge for a pair and direction: parallel edges have no meaning here",
            ));
        }
        let undirected = (!directed).then_some(indices);
        self.seen_edges
            .insert(indices, SeenEdge { span: span.clone(), undirected_endpoints: undirected });
        if !directed {
            self.seen_edges.insert(
                [to, from],
                SeenEdge { span: span.clone(), undirected_endpoints: undirected },
            );
            let (span, attributes) = (span.clone(), Vec::new());
            self.network.links.push(ImportedEdge { from: to, to: from, span, attributes });
        }
        self.network.links.push(ImportedEdge { from, to, span, attributes });
        Ok(())
    }

    fn known_nodes_remedy(&self) -> String {
        let names: Vec<String> = self.node_indices.keys().take(8).map(NodeId::to_string).collect();
        let more = if self.node_indices.len() > names.len() { ", ..." } else { "" };
        format!("expected the id of a node: {}{more}", names.join(", "))
    }

    /// Converts attributes to keys of the scenario. Attributes for single components, such as `x_m`, are combined into
    /// one key. An attribute without a meaning is recorded for a warning. Fails if the value of any other attribute
    /// cannot be read.
    fn convert_to_keys(
        &mut self,
        title: &str,
        attributes: Vec<Attribute>,
        known: &[&str],
    ) -> Result<Vec<Attribute>, Diagnostic> {
        let spelled_out: Vec<_> = COMPONENT_KEYS
            .iter()
            .filter(|(combined_key, _)| known.contains(combined_key))
            .collect();
        let mut keys: Vec<Attribute> = Vec::new();
        let mut parts: BTreeMap<String, LocatedValue> = BTreeMap::new();
        for (key, value_of_key) in attributes {
            let names = spelled_out.iter().flat_map(|(_, names)| names.iter()).copied();
            let is_part = names.clone().any(|name| name == key);
            if !is_part && !known.contains(&key.as_str()) {
                self.network.ignored_attributes.entry(key).or_insert_with_key(|key| {
                    let close = most_similar_word(key, names.chain(known.iter().copied()));
                    let close = close.filter(|_| key != DRAWING_POSITION_KEY).map(str::to_owned);
                    IgnoredAttribute { span: value_of_key.span, similar_key: close }
                });
                continue;
            }
            if let Some(error) = value_of_key.first_error(self.source) {
                return Err(error);
            }
            if parts.contains_key(&key) || keys.iter().any(|(other, _)| *other == key) {
                let message = format!("{title} has `{key}` twice");
                return Err(self.source.error_at(&value_of_key.span, message, "expected it once"));
            }
            if is_part {
                parts.insert(key, value_of_key);
            } else {
                keys.push((key, value_of_key));
            }
        }
        for (combined_key, names) in spelled_out {
            let found = names.iter().filter_map(|name| Some((*name, parts.get(*name)?.clone())));
            let found: Vec<(&str, LocatedValue)> = found.collect();
            let Some((first, LocatedValue { span, .. })) = found.first() else { continue };
            let error = |message, expected| Err(self.source.error_at(span, message, expected));
            if keys.iter().any(|(key, _)| key == combined_key) {
                let message = format!("{title} has `{first}` and `{combined_key}`");
                return error(message, "expected one of them".to_owned());
            }
            if let Some(missing) = names.iter().find(|name| !parts.contains_key(**name)) {
                let message = format!("{title} has `{first}`, but no `{missing}`");
                return error(message, format!("expected all of {}", names.join(", ")));
            }
            let span = span.clone();
            let value = match *combined_key {
                "pose" => AttributeValue::Table(
                    found.into_iter().map(|(key, part)| (key.into(), part)).collect(),
                ),
                _ => AttributeValue::List(found.into_iter().map(|(_, part)| part).collect()),
            };
            keys.push(((*combined_key).to_owned(), LocatedValue { value, span }));
        }
        Ok(keys)
    }
}

impl ImportedGraph {
    /// Returns a warning for each attribute that has no effect, with those first that resemble a key. Beyond
    /// [`IGNORED_ATTRIBUTE_WARNINGS_MAX`] one warning counts the rest.
    fn warnings(&self, source: &SourceText) -> Vec<Diagnostic> {
        let expected = "expected keys of a robot, or at an edge `offset_m`";
        let mut ignored: Vec<_> = self.ignored_attributes.iter().collect();
        ignored.sort_by_key(|(_, attribute)| attribute.similar_key.is_none());
        let warning = |(key, attribute): &(&String, &IgnoredAttribute)| {
            let message = format!("the attribute `{key}` has no meaning here and is ignored");
            let close =
                attribute.similar_key.as_ref().map(|close| format!("did you mean `{close}`?"));
            let expected = close.unwrap_or_else(|| expected.to_owned());
            source.error_at(&attribute.span, message, expected).into_warning()
        };
        let mut warnings: Vec<_> =
            ignored.iter().take(IGNORED_ATTRIBUTE_WARNINGS_MAX).map(warning).collect();
        if let Some((_, attribute)) = ignored.get(IGNORED_ATTRIBUTE_WARNINGS_MAX) {
            let more = ignored.len() - IGNORED_ATTRIBUTE_WARNINGS_MAX;
            let message = format!("{more} more attributes have no meaning here and are ignored");
            warnings.push(source.error_at(&attribute.span, message, expected).into_warning());
        }
        if let Some((weight, span)) = &self.first_weight {
            let message =
                format!("the weights, such as {weight}, have no meaning here and are ignored");
            let expected = "expected 0 or 1: laws treat all neighbors alike";
            warnings.push(source.error_at(span, message, expected).into_warning());
        }
        warnings
    }
}
