//! Graphs that other tools wrote: `graph = "file"`.
//!
//! A file becomes a [`Network`] here, whatever its format; `splice` writes it out into the
//! scenario's own text. In all formats an edge points the way information flows: the target hears
//! the source. A matrix is that of (6): a_ij is not 0 where i hears j.
//!
//! | file | question it answers |
//! |---|---|
//! | `json` `matrix` `graphml` | what does a file of this format say? |
//! | `splice` | how does it become part of the scenario? |
//! | here | what do attributes of nodes and edges mean? |

mod graphml;
mod json;
mod matrix;
pub(super) mod splice;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use crate::scenario::diagnostic::{Diagnostic, Source, meant};

/// Keys of an edge, beside its ends.
const EDGE_KEYS: &[&str] = &["offset_m"];
/// Keys of robots and edges that tools without lists and tables spell out.
const SPELLED_OUT: &[(&str, &[&str])] = &[
    ("pose", &["x_m", "y_m", "heading_rad"]),
    ("place_m", &["place_x_m", "place_y_m"]),
    ("offset_m", &["offset_x_m", "offset_y_m"]),
];
/// networkx's own name for where to draw a node; no misspelled pose.
const DRAWN_AT: &str = "pos";

/// A graph as its file has it.
#[derive(Debug, Default)]
struct Network {
    nodes: Vec<Node>,
    links: Vec<Link>,
    /// Attributes without a meaning here, and where the first of each stands.
    ignored: BTreeMap<String, Range<usize>>,
}

/// A node: a robot.
#[derive(Debug)]
struct Node {
    name: Name,
    span: Range<usize>,
    attributes: Vec<Attribute>,
}

/// How a file names a node.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Name {
    /// Like a robot.
    Text(String),
    /// By a number, which counts the robots.
    Number(i64),
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Name::Text(text) => write!(f, "{text:?}"),
            Name::Number(number) => write!(f, "{number}"),
        }
    }
}

impl Name {
    /// A name in a file that knows no numbers.
    fn read(text: &str) -> Name {
        text.parse().map_or_else(|_| Name::Text(text.to_owned()), Name::Number)
    }
}

/// An edge, by the places of its ends in the list of nodes: `to` hears `from`.
#[derive(Debug)]
struct Link {
    from: usize,
    to: usize,
    span: Range<usize>,
    attributes: Vec<Attribute>,
}

/// A key, and its value.
type Attribute = (String, Given);

/// A value, and where in the graph's file it is given.
#[derive(Debug, Clone)]
struct Given {
    value: Tree,
    span: Range<usize>,
}

/// A value.
#[derive(Debug, Clone)]
enum Tree {
    /// As TOML has it.
    Plain(String),
    List(Vec<Given>),
    Table(Vec<Attribute>),
}

impl Given {
    /// A string, quoted as TOML has it.
    fn text(text: &str, span: Range<usize>) -> Given {
        Given { value: Tree::Plain(toml_edit::Value::from(text).to_string()), span }
    }
}

/// The graph in a text, by its file's extension; `robot_keys`: what nodes may say of a robot.
/// `None`: there is no such format.
fn network(
    file: &Path,
    source: &Source,
    text: &str,
    robot_keys: &[&str],
) -> Option<Result<Network, Diagnostic>> {
    let reader = match file.extension()?.to_str()? {
        "json" => json::read,
        "csv" => matrix::read,
        "graphml" => graphml::read,
        _ => return None,
    };
    Some(reader(source, text, robot_keys))
}

/// A graph under construction.
struct Builder<'a> {
    source: &'a Source,
    robot_keys: &'a [&'a str],
    network: Network,
    places: BTreeMap<Name, usize>,
}

impl<'a> Builder<'a> {
    fn new(source: &'a Source, robot_keys: &'a [&'a str]) -> Builder<'a> {
        Builder { source, robot_keys, network: Network::default(), places: BTreeMap::new() }
    }

    fn node(
        &mut self,
        name: Name,
        span: Range<usize>,
        attributes: Vec<Attribute>,
    ) -> Result<(), Diagnostic> {
        let number = self.network.nodes.len();
        if let Some(first) = self.places.insert(name.clone(), number) {
            return Err(self.source.error(
                &span,
                format!("node {} is called {name}, like node {}", number + 1, first + 1),
                "expected a name of its own",
            ));
        }
        let attributes = self.keys(&format!("node {name}"), attributes, self.robot_keys)?;
        self.network.nodes.push(Node { name, span, attributes });
        Ok(())
    }

    /// An edge; one that is not `directed` leads both ways.
    fn link(
        &mut self,
        ends: [(Name, Range<usize>); 2],
        directed: bool,
        span: Range<usize>,
        attributes: Vec<Attribute>,
    ) -> Result<(), Diagnostic> {
        let title = format!("edge {} - {}", ends[0].0, ends[1].0);
        let mut places = [0; 2];
        for (place, (name, span)) in places.iter_mut().zip(&ends) {
            *place = *self.places.get(name).ok_or_else(|| {
                let message = format!("an edge ends at {name}, but there is no such node");
                self.source.error(span, message, self.known_nodes())
            })?;
        }
        let attributes = self.keys(&title, attributes, EDGE_KEYS)?;
        if let (false, Some((key, offset))) = (directed, attributes.first()) {
            return Err(self.source.error(
                &offset.span,
                format!("`{key}` stands at an edge without a direction: seen from which end?"),
                "expected a directed graph, or `place_m` = [x, y] in the nodes",
            ));
        }
        let [from, to] = places;
        if !directed {
            let (span, attributes) = (span.clone(), Vec::new());
            self.network.links.push(Link { from: to, to: from, span, attributes });
        }
        self.network.links.push(Link { from, to, span, attributes });
        Ok(())
    }

    fn known_nodes(&self) -> String {
        let names: Vec<String> = self.places.keys().take(8).map(Name::to_string).collect();
        let more = if self.places.len() > names.len() { ", ..." } else { "" };
        format!("expected the id of a node: {}{more}", names.join(", "))
    }

    /// Attributes as keys of the scenario: what is spelled out put together, what has no meaning
    /// left out, what looks misspelled refused.
    fn keys(
        &mut self,
        title: &str,
        attributes: Vec<Attribute>,
        known: &[&str],
    ) -> Result<Vec<Attribute>, Diagnostic> {
        let spelled_out: Vec<_> =
            SPELLED_OUT.iter().filter(|(whole, _)| known.contains(whole)).collect();
        let mut keys: Vec<Attribute> = Vec::new();
        let mut parts: BTreeMap<String, Given> = BTreeMap::new();
        for (key, given) in attributes {
            let mut names = spelled_out.iter().flat_map(|(_, names)| names.iter()).copied();
            if known.contains(&key.as_str()) {
                keys.push((key, given));
            } else if names.clone().any(|name| name == key) {
                parts.entry(key).or_insert(given);
            } else if let Some(close) = meant(&key, names.by_ref().chain(known.iter().copied()))
                && key != DRAWN_AT
            {
                return Err(self.source.error(
                    &given.span,
                    format!("{title} has the attribute `{key}`, which has no meaning here"),
                    format!("did you mean `{close}`?"),
                ));
            } else {
                self.network.ignored.entry(key).or_insert(given.span);
            }
        }
        for (whole, names) in spelled_out {
            let found = names.iter().filter_map(|name| Some((*name, parts.get(*name)?.clone())));
            let found: Vec<(&str, Given)> = found.collect();
            let Some((first, Given { span, .. })) = found.first() else { continue };
            let wrong = |message, expected| Err(self.source.error(span, message, expected));
            if keys.iter().any(|(key, _)| key == whole) {
                let message = format!("{title} has `{first}` and `{whole}`");
                return wrong(message, "expected one of them".to_owned());
            }
            if let Some(missing) = names.iter().find(|name| !parts.contains_key(**name)) {
                let message = format!("{title} has `{first}`, but no `{missing}`");
                return wrong(message, format!("expected all of {}", names.join(", ")));
            }
            let span = span.clone();
            let value = match *whole {
                "pose" => {
                    Tree::Table(found.into_iter().map(|(key, part)| (key.into(), part)).collect())
                }
                _ => Tree::List(found.into_iter().map(|(_, part)| part).collect()),
            };
            keys.push(((*whole).to_owned(), Given { value, span }));
        }
        Ok(keys)
    }
}

impl Network {
    /// What of the file has no effect.
    fn warnings(&self, source: &Source) -> Vec<Diagnostic> {
        let warning = |(key, span): (&String, &Range<usize>)| {
            let message = format!("the attribute `{key}` has no meaning here and is left out");
            let expected = "expected keys of a robot, or at an edge `offset_m`";
            source.error(span, message, expected).as_warning()
        };
        self.ignored.iter().map(warning).collect()
    }
}
