//! Node-link JSON, as networkx writes it: `node_link_data`, with `edges` or the older `links`.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;

use super::{Attribute, AttributeValue, ImportedGraph, ImportedGraphBuilder, LocatedValue, NodeId};
use crate::scenario::diagnostic::{Diagnostic, SourceText};

/// Maximum nesting depth of a value: lists in tables.
const DEPTH_MAX: usize = 4;
/// Maximum number of characters of a value in a message.
const SHOWN_CHARACTERS_MAX: usize = 60;

pub(super) fn read(
    source: &SourceText,
    text: &str,
    robot_keys: &[&str],
) -> Result<ImportedGraph, Diagnostic> {
    let (readable, not_finite) = replace_non_finite_numbers(text);
    let json =
        JsonSource { source, text: &readable, original_text: text, non_finite_numbers: not_finite };
    let JsonObject(root) =
        serde_json::from_str(&readable).map_err(|error| json.json_syntax_error(&error))?;
    json.reject_duplicate_members(
        &root,
        &["directed", "multigraph", "nodes", "edges", "links"],
        "the graph",
    )?;
    let get = |key: &str| root.iter().find(|(name, _)| name == key).map(|(_, value)| *value);
    json.refuse_other_formats(&root)?;
    let directed = match get("directed").map(|value| (value, value.get())) {
        Some((_, "true")) => true,
        Some((_, "false")) => false,
        Some((value, _)) => {
            return Err(json.error_at(
                value,
                "`directed` is neither true nor false",
                "expected true",
            ));
        }
        None => {
            return Err(json.error_in_file(
                "the graph does not say whether it is `directed`",
                "expected `directed`: true, or false where both ends of an edge hear each other",
            ));
        }
    };
    let multigraph = get("multigraph").filter(|value| value.get() != "false");
    if let Some(value) = multigraph.filter(|value| value.get() != "true") {
        let message = format!("`multigraph` is {}", json.excerpt(value));
        return Err(json.error_at(value, message, "expected true or false"));
    }
    // networkx distinguishes parallel edges by `key`; without parallel edges it has no meaning.
    let edge_members: &[&str] = match multigraph {
        Some(_) => &["source", "target", "key"],
        None => &["source", "target"],
    };
    let mut builder = ImportedGraphBuilder::new(source, robot_keys);
    let Some(nodes) = get("nodes") else {
        return Err(
            json.error_in_file("the graph has no `nodes`", "expected `nodes`: a list of objects")
        );
    };
    for node in json.parse_list(nodes, "`nodes`")? {
        let members = json.parse_object(node, "a node")?;
        json.reject_duplicate_members(&members, &["id"], "a node")?;
        let id = json.parse_node_id(node, &members, "id", "a node")?;
        let attributes = json.convert_attributes(members, &["id"]);
        builder.add_node(id.0, json.span(node), attributes)?;
    }
    let edges = match (get("edges"), get("links")) {
        (Some(edges), None) => edges,
        (None, Some(links)) => links,
        (Some(_), Some(links)) => {
            let message = "the graph has `edges` and `links`";
            return Err(json.error_at(links, message, "expected one of them"));
        }
        (None, None) => {
            return Err(json.error_in_file(
                "the graph has neither `edges` nor `links`",
                "expected `edges`: a list of objects with `source` and `target`",
            ));
        }
    };
    for edge in json.parse_list(edges, "the list of edges")? {
        let members = json.parse_object(edge, "an edge")?;
        json.reject_duplicate_members(&members, &["source", "target"], "an edge")?;
        let endpoints = [
            json.parse_node_id(edge, &members, "source", "an edge")?,
            json.parse_node_id(edge, &members, "target", "an edge")?,
        ];
        let attributes = json.convert_attributes(members, edge_members);
        builder.add_edge(endpoints, directed, json.span(edge), attributes)?;
    }
    Ok(builder.network)
}

/// The members of an object, in order.
type Members<'j> = Vec<(String, &'j RawValue)>;

/// An object that can have duplicate names.
struct JsonObject<'j>(Members<'j>);

impl<'de: 'j, 'j> Deserialize<'de> for JsonObject<'j> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct MembersVisitor;
        impl<'de> Visitor<'de> for MembersVisitor {
            type Value = JsonObject<'de>;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<JsonObject<'de>, A::Error> {
                let mut members: Members<'de> = Vec::new();
                while let Some((name, value)) = map.next_entry::<String, &RawValue>()? {
                    members.push((name, value));
                }
                Ok(JsonObject(members))
            }
        }
        deserializer.deserialize_map(MembersVisitor)
    }
}

/// Source of the text, for locations.
struct JsonSource<'a> {
    source: &'a SourceText,
    /// The text that is parsed.
    text: &'a str,
    /// The text of the file, of the same length.
    original_text: &'a str,
    /// Numbers of the file that JSON does not support (NaN, Infinity), by byte offset.
    non_finite_numbers: BTreeMap<usize, &'static str>,
}

impl<'a> JsonSource<'a> {
    /// Returns the byte range of a value in the text.
    fn span(&self, value: &RawValue) -> Range<usize> {
        let start = (value.get().as_ptr() as usize).saturating_sub(self.text.as_ptr() as usize);
        start..start + value.get().len()
    }

    fn error_at(
        &self,
        value: &RawValue,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.source.error_at(&self.span(value), message, expected)
    }

    /// Returns a value on one line, as it is in the file, truncated to [`SHOWN_CHARACTERS_MAX`].
    fn excerpt(&self, value: &RawValue) -> String {
        let text: Vec<&str> = self.original_text[self.span(value)].split_whitespace().collect();
        let text = text.join(" ");
        match text.char_indices().nth(SHOWN_CHARACTERS_MAX) {
            Some((end, _)) => format!("{}...", &text[..end]),
            None => text,
        }
    }

    /// Fails if an object has one of these names twice.
    fn reject_duplicate_members(
        &self,
        members: &Members<'a>,
        names: &[&str],
        what: &str,
    ) -> Result<(), Diagnostic> {
        for name in names {
            if let Some((_, value)) = members.iter().filter(|(other, _)| other == name).nth(1) {
                let message = format!("{what} has `{name}` twice");
                return Err(self.error_at(value, message, "expected it once"));
            }
        }
        Ok(())
    }

    /// Fails for JSON of a known format that is not node-link JSON.
    fn refuse_other_formats(&self, root: &Members<'a>) -> Result<(), Diagnostic> {
        for (name, format) in [
            ("elements", "Cytoscape JSON"),
            ("adjacency", "networkx's adjacency JSON"),
            ("graphs", "JSON Graph Format"),
        ] {
            if let Some((_, value)) = root.iter().find(|(key, _)| key == name)
                && root.iter().all(|(key, _)| key != "nodes" || name == "adjacency")
            {
                return Err(self.source.error_at(
                    &(self.span(value).start..self.span(value).start + 1),
                    format!("this is {format}, not node-link JSON"),
                    "expected one object with `directed`, `nodes` and `edges`, as networkx's node_link_data makes it",
                ));
            }
        }
        Ok(())
    }

    fn error_in_file(&self, message: &str, expected: &str) -> Diagnostic {
        self.source.error_at(&(0..0), message, expected)
    }

    fn json_syntax_error(&self, error: &serde_json::Error) -> Diagnostic {
        let line_start = match error.line() {
            0 | 1 => 0,
            line => self.text.match_indices('\n').nth(line - 2).map_or(0, |(at, _)| at + 1),
        };
        let at = line_start + error.column().saturating_sub(1);
        let expected = match error.is_data() {
            true => "expected one object with `directed`, `nodes` and `edges`",
            false => "expected JSON, without comments and trailing commas",
        };
        let message = format!("this is no node-link JSON: {}", message_without_location(error));
        self.source.error_at(&(at..at + 1), message, expected)
    }

    fn parse_list(&self, value: &'a RawValue, what: &str) -> Result<Vec<&'a RawValue>, Diagnostic> {
        serde_json::from_str(value.get()).map_err(|_| {
            self.error_at(value, format!("{what} is no list"), "expected a list: [...]")
        })
    }

    fn parse_object(&self, value: &'a RawValue, what: &str) -> Result<Members<'a>, Diagnostic> {
        serde_json::from_str(value.get()).map(|JsonObject(members)| members).map_err(|error| {
            let message = format!("{what} is no object: {}", message_without_location(&error));
            self.error_at(value, message, "expected an object: { ... }")
        })
    }

    /// Parses the id of a node in a node or an edge.
    fn parse_node_id(
        &self,
        parent: &RawValue,
        members: &Members<'a>,
        key: &str,
        what: &str,
    ) -> Result<(NodeId, Range<usize>), Diagnostic> {
        let Some((_, value)) = members.iter().find(|(name, _)| name == key) else {
            let expected = format!("expected `{key}`: the name of a robot, or its number");
            return Err(self.error_at(parent, format!("{what} has no `{key}`"), expected));
        };
        let name = if let Ok(number) = value.get().parse() {
            NodeId::Number(number)
        } else if let Some(text) = self.string_value(value) {
            NodeId::from_text(&text)
        } else {
            let expected = match value.get().starts_with('[') {
                true => {
                    "expected the name of a robot, or a whole number; networkx's \
                     convert_node_labels_to_integers makes numbers of other ids"
                }
                false => "expected the name of a robot, or a whole number",
            };
            return Err(self.error_at(
                value,
                format!("`{key}` is {}", self.excerpt(value)),
                expected,
            ));
        };
        Ok((name, self.span(value)))
    }

    /// Returns the string if the value is a string in the file, and not a replaced NaN or Infinity.
    fn string_value(&self, value: &RawValue) -> Option<String> {
        let is_number = self.non_finite_numbers.contains_key(&self.span(value).start);
        serde_json::from_str(value.get()).ok().filter(|_| !is_number)
    }

    fn convert_attributes(&self, members: Members<'a>, structural: &[&str]) -> Vec<Attribute> {
        let attributes = members.into_iter().filter(|(key, _)| !structural.contains(&key.as_str()));
        attributes.map(|entry| self.convert_attribute(entry, DEPTH_MAX)).collect()
    }

    fn convert_attribute(&self, (key, value): (String, &'a RawValue), depth: usize) -> Attribute {
        let converted = self.convert_to_toml(&key, value, depth);
        (key, converted)
    }

    /// Converts a JSON value to the TOML value, or to an error message if TOML has no such value.
    fn convert_to_toml(&self, key: &str, value: &'a RawValue, depth: usize) -> LocatedValue {
        let (text, span) = (value.get(), self.span(value));
        let unreadable = |what: &str, expected| {
            LocatedValue::unreadable_value(format!("`{key}` {what}"), expected, span.clone())
        };
        if let Some(number) = self.non_finite_numbers.get(&span.start) {
            return unreadable(&format!("is {number}"), "expected a finite number");
        }
        if depth == 0 {
            return unreadable("nests too deep", "expected a plain value");
        }
        let value = match text.as_bytes().first() {
            Some(b'{') => {
                let Ok(JsonObject(members)) = serde_json::from_str(text) else {
                    return unreadable("is no object", "expected an object: { ... }");
                };
                let mut names: Vec<&str> = members.iter().map(|(name, _)| name.as_str()).collect();
                names.sort_unstable();
                if let Some(duplicate) = names.windows(2).find(|pair| pair[0] == pair[1]) {
                    return unreadable(
                        &format!("has `{}` twice", duplicate[0]),
                        "expected it once",
                    );
                }
                let members =
                    members.into_iter().map(|member| self.convert_attribute(member, depth - 1));
                AttributeValue::Table(members.collect())
            }
            Some(b'[') => {
                let Ok(elements) = serde_json::from_str::<Vec<&RawValue>>(text) else {
                    return unreadable("is no list", "expected a list: [...]");
                };
                let elements = elements.into_iter();
                AttributeValue::List(
                    elements.map(|element| self.convert_to_toml(key, element, depth - 1)).collect(),
                )
            }
            Some(b'"') => match serde_json::from_str::<String>(text) {
                Ok(text) => return LocatedValue::from_text(&text, span),
                Err(error) => {
                    let what = format!("is no text: {}", message_without_location(&error));
                    return unreadable(&what, "expected a string");
                }
            },
            Some(b'n') => return unreadable("is null", "expected a value, or no such attribute"),
            // Numbers, true and false are written alike in both.
            _ => AttributeValue::Plain(text.to_owned()),
        };
        LocatedValue { value, span }
    }
}

/// Replaces each NaN and Infinity, which Python writes although JSON does not support them, by a string of the same
/// length. Returns the text and the byte offsets of the replaced numbers.
fn replace_non_finite_numbers(text: &str) -> (String, BTreeMap<usize, &'static str>) {
    let mut readable = String::with_capacity(text.len());
    let mut found = BTreeMap::new();
    let mut quoted = false;
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let number =
            ["NaN", "Infinity", "-Infinity"].into_iter().find(|word| rest.starts_with(word));
        let length = match number.filter(|_| !quoted) {
            Some(word) => {
                found.insert(readable.len(), word);
                readable += &format!("{:?}", "-".repeat(word.len() - 2));
                word.len()
            }
            None => {
                let escape = if quoted && c == '\\' { rest.chars().nth(1) } else { None };
                quoted ^= c == '"';
                let length = c.len_utf8() + escape.map_or(0, char::len_utf8);
                readable += &rest[..length];
                length
            }
        };
        rest = &rest[length..];
    }
    (readable, found)
}

/// Returns an error message without the location at its end.
fn message_without_location(error: &serde_json::Error) -> String {
    let message = error.to_string();
    message.split(" at line ").next().unwrap_or_default().to_owned()
}
