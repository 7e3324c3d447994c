//! Node-link JSON, as networkx writes it: `node_link_data`, with `edges` or the older `links`.

use std::ops::Range;

use serde::Deserialize;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use serde_json::value::RawValue;

use super::{Attribute, Builder, Given, Name, Network, Tree};
use crate::scenario::diagnostic::{Diagnostic, Source};

/// How deep a value may nest: lists in tables, and no more.
const DEPTH_MAX: usize = 4;

pub(super) fn read(
    source: &Source,
    text: &str,
    robot_keys: &[&str],
) -> Result<Network, Diagnostic> {
    let json = Json { source, text };
    let Object(root) = serde_json::from_str(text).map_err(|error| json.no_json(&error))?;
    let get = |key: &str| root.iter().find(|(name, _)| name == key).map(|(_, value)| *value);
    let directed = match get("directed").map(|value| (value, value.get())) {
        Some((_, "true")) => true,
        Some((_, "false")) => false,
        Some((value, _)) => {
            return Err(json.wrong(value, "`directed` is neither true nor false", "expected true"));
        }
        None => {
            return Err(json.about(
                "the graph does not say whether it is `directed`",
                "expected `directed`: true, or false where both ends of an edge hear each other",
            ));
        }
    };
    if let Some(multigraph) = get("multigraph").filter(|value| value.get() != "false") {
        return Err(json.wrong(
            multigraph,
            format!("`multigraph` is {}", multigraph.get()),
            "expected false: one edge for a pair and direction",
        ));
    }
    let mut builder = Builder::new(source, robot_keys);
    let Some(nodes) = get("nodes") else {
        return Err(json.about("the graph has no `nodes`", "expected `nodes`: a list of objects"));
    };
    for node in json.list(nodes, "`nodes`")? {
        let members = json.object(node, "a node")?;
        let id = json.end(node, &members, "id", "a node")?;
        let attributes = json.attributes(members, &["id"])?;
        builder.node(id.0, json.span(node), attributes)?;
    }
    let edges = match (get("edges"), get("links")) {
        (Some(edges), None) => edges,
        (None, Some(links)) => links,
        (Some(_), Some(links)) => {
            let message = "the graph has `edges` and `links`";
            return Err(json.wrong(links, message, "expected one of them"));
        }
        (None, None) => {
            return Err(json.about(
                "the graph has neither `edges` nor `links`",
                "expected `edges`: a list of objects with `source` and `target`",
            ));
        }
    };
    for edge in json.list(edges, "the list of edges")? {
        let members = json.object(edge, "an edge")?;
        let ends = [
            json.end(edge, &members, "source", "an edge")?,
            json.end(edge, &members, "target", "an edge")?,
        ];
        let attributes = json.attributes(members, &["source", "target"])?;
        builder.link(ends, directed, json.span(edge), attributes)?;
    }
    Ok(builder.network)
}

/// The members of an object, in order.
type Members<'j> = Vec<(String, &'j RawValue)>;

/// An object without a name in it twice.
struct Object<'j>(Members<'j>);

impl<'de: 'j, 'j> Deserialize<'de> for Object<'j> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Object<'de>;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Object<'de>, A::Error> {
                let mut members: Members<'de> = Vec::new();
                while let Some((name, value)) = map.next_entry::<String, &RawValue>()? {
                    if members.iter().any(|(other, _)| *other == name) {
                        return Err(A::Error::custom(format!(
                            "the name {name:?} stands here twice"
                        )));
                    }
                    members.push((name, value));
                }
                Ok(Object(members))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

/// The text, for places in it.
struct Json<'a> {
    source: &'a Source,
    text: &'a str,
}

impl<'a> Json<'a> {
    /// Where a value of the text stands.
    fn span(&self, value: &RawValue) -> Range<usize> {
        let start = (value.get().as_ptr() as usize).saturating_sub(self.text.as_ptr() as usize);
        start..start + value.get().len()
    }

    fn wrong(
        &self,
        value: &RawValue,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.source.error(&self.span(value), message, expected)
    }

    fn about(&self, message: &str, expected: &str) -> Diagnostic {
        self.source.error(&(0..0), message, expected)
    }

    fn no_json(&self, error: &serde_json::Error) -> Diagnostic {
        let line_start = match error.line() {
            0 | 1 => 0,
            line => self.text.match_indices('\n').nth(line - 2).map_or(0, |(at, _)| at + 1),
        };
        let at = line_start + error.column().saturating_sub(1);
        let expected = match error.is_data() {
            true => "expected one object with `directed`, `nodes` and `edges`",
            false => "expected JSON here, which knows no NaN, no comments and no trailing commas",
        };
        let message = format!("this is no node-link JSON: {}", without_place(error));
        self.source.error(&(at..at + 1), message, expected)
    }

    fn list(&self, value: &'a RawValue, what: &str) -> Result<Vec<&'a RawValue>, Diagnostic> {
        serde_json::from_str(value.get())
            .map_err(|_| self.wrong(value, format!("{what} is no list"), "expected a list: [...]"))
    }

    fn object(&self, value: &'a RawValue, what: &str) -> Result<Members<'a>, Diagnostic> {
        serde_json::from_str(value.get()).map(|Object(members)| members).map_err(|error| {
            let message = format!("{what} is no object: {}", without_place(&error));
            self.wrong(value, message, "expected an object with every name in it once")
        })
    }

    /// The id of a node, as a node or an edge has it.
    fn end(
        &self,
        around: &RawValue,
        members: &Members<'a>,
        key: &str,
        what: &str,
    ) -> Result<(Name, Range<usize>), Diagnostic> {
        let Some((_, value)) = members.iter().find(|(name, _)| name == key) else {
            let expected = format!("expected `{key}`: the name of a robot, or its number");
            return Err(self.wrong(around, format!("{what} has no `{key}`"), expected));
        };
        let name = if let Ok(number) = value.get().parse() {
            Name::Number(number)
        } else if let Ok(text) = serde_json::from_str(value.get()) {
            Name::Text(text)
        } else {
            return Err(self.wrong(
                value,
                format!("`{key}` is {}", value.get()),
                "expected the name of a robot, or a whole number",
            ));
        };
        Ok((name, self.span(value)))
    }

    fn attributes(
        &self,
        members: Members<'a>,
        known: &[&str],
    ) -> Result<Vec<Attribute>, Diagnostic> {
        let attributes = members.into_iter().filter(|(key, _)| !known.contains(&key.as_str()));
        attributes.map(|entry| self.attribute(entry, DEPTH_MAX)).collect()
    }

    fn attribute(
        &self,
        (key, value): (String, &'a RawValue),
        depth: usize,
    ) -> Result<Attribute, Diagnostic> {
        let given = self.given(&key, value, depth)?;
        Ok((key, given))
    }

    /// A value as TOML has it.
    fn given(&self, key: &str, value: &'a RawValue, depth: usize) -> Result<Given, Diagnostic> {
        let (text, span) = (value.get(), self.span(value));
        let wrong =
            |what: &str, expected| Err(self.wrong(value, format!("`{key}` {what}"), expected));
        if depth == 0 {
            return wrong("nests too deep", "expected a plain value");
        }
        let value = match text.as_bytes().first() {
            Some(b'{') => {
                let members = self.object(value, key)?.into_iter();
                let members = members.map(|member| self.attribute(member, depth - 1));
                Tree::Table(members.collect::<Result<_, _>>()?)
            }
            Some(b'[') => {
                let elements = self.list(value, key)?.into_iter();
                let elements = elements.map(|element| self.given(key, element, depth - 1));
                Tree::List(elements.collect::<Result<_, _>>()?)
            }
            Some(b'"') => match serde_json::from_str::<String>(text) {
                Ok(text) => return Ok(Given::text(&text, span)),
                Err(error) => {
                    let what = format!("is no text: {}", without_place(&error));
                    return wrong(&what, "expected a string");
                }
            },
            Some(b'n') => return wrong("is null", "expected a value, or no such attribute"),
            // Numbers, true and false are written alike in both.
            _ => Tree::Plain(text.to_owned()),
        };
        Ok(Given { value, span })
    }
}

/// An error's message without the place at its end.
fn without_place(error: &serde_json::Error) -> String {
    let message = error.to_string();
    message.split(" at line ").next().unwrap_or_default().to_owned()
}
