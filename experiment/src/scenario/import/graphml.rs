//! GraphML: nodes, edges and typed attributes, as networkx, yEd and others write it.

use std::collections::BTreeMap;
use std::ops::Range;

use roxmltree::{Document, Error, Node as Element, ParsingOptions};

use super::{
    Attribute, AttributeValue, EDGE_KEYS, ImportedGraph, ImportedGraphBuilder, LocatedValue,
    NodeId, is_known_key,
};
use crate::scenario::diagnostic::{Diagnostic, SourceText};

pub(super) fn read(
    source: &SourceText,
    text: &str,
    robot_keys: &[&str],
) -> Result<ImportedGraph, Diagnostic> {
    let document = parse_xml(source, text)?;
    let xml = XmlSource { source };
    let root = document.root_element();
    if root.tag_name().name() != "graphml" {
        let message = format!("this is no GraphML, but `{}`", root.tag_name().name());
        return Err(xml.error_at(root, message, "expected the element `graphml`"));
    }
    let graphs: Vec<Element<'_, '_>> = child_elements(root, "graph").collect();
    let &[graph] = &graphs[..] else {
        let message = format!("the file has {} graphs", graphs.len());
        let location = graphs.last().copied().unwrap_or(root);
        return Err(xml.error_at(location, message, "expected one element `graph`"));
    };
    let mut keys = BTreeMap::new();
    for key in child_elements(root, "key") {
        keys.insert(xml.required_attribute(key, "id")?, key);
    }
    let directed = match xml.required_attribute(graph, "edgedefault")? {
        "directed" => true,
        "undirected" => false,
        other => {
            let message = format!("`edgedefault` is {other:?}");
            return Err(xml.error_at(graph, message, "expected \"directed\" or \"undirected\""));
        }
    };
    let mut builder = ImportedGraphBuilder::new(source, robot_keys);
    if let Some(element) = child_elements(graph, "hyperedge").next() {
        return Err(xml.error_at(
            element,
            "a hyperedge has no direction from one robot to another",
            "expected edges between two robots each",
        ));
    }
    for node in child_elements(graph, "node") {
        if let Some(nested) = child_elements(node, "graph").next() {
            let expected = "expected all nodes in one graph";
            return Err(xml.error_at(nested, "a graph is nested in a node", expected));
        }
        let name = NodeId::from_text(xml.required_attribute(node, "id")?);
        let attributes = xml.parse_attributes(node, &keys, robot_keys)?;
        builder.add_node(name, node.range(), attributes)?;
    }
    for edge in child_elements(graph, "edge") {
        let mut endpoints = Vec::new();
        for key in ["source", "target"] {
            endpoints.push((
                NodeId::from_text(xml.required_attribute(edge, key)?),
                xml.attribute_span(edge, key),
            ));
        }
        let endpoints = <[_; 2]>::try_from(endpoints).expect("there are two ends");
        let directed = match edge.attribute("directed") {
            None => directed,
            Some("true") => true,
            Some("false") => false,
            Some(other) => {
                let message = format!("`directed` is {other:?}");
                return Err(xml.error_at(edge, message, "expected \"true\" or \"false\""));
            }
        };
        let attributes = xml.parse_attributes(edge, &keys, EDGE_KEYS)?;
        builder.add_edge(endpoints, directed, edge.range(), attributes)?;
    }
    Ok(builder.network)
}

/// Parses XML. A document type declaration is ignored. One that declares entities is refused, because a few nested
/// entities can expand to gigabytes.
fn parse_xml<'t>(source: &SourceText, text: &'t str) -> Result<Document<'t>, Diagnostic> {
    let to_diagnostic = |error| xml_syntax_error(source, text, &error);
    match Document::parse(text) {
        Err(Error::DtdDetected) => (),
        parsed => return parsed.map_err(to_diagnostic),
    }
    if let Some(at) = text.find("<!ENTITY") {
        return Err(source.error_at(
            &(at..at + "<!ENTITY".len()),
            "the document type declares an entity",
            "expected GraphML without entities: write out what they stand for",
        ));
    }
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(to_diagnostic)
}

/// Returns the diagnostic of an XML syntax error.
fn xml_syntax_error(source: &SourceText, text: &str, error: &roxmltree::Error) -> Diagnostic {
    let pos = error.pos();
    let (row, column) = (pos.row as usize, pos.col as usize);
    let line_start: usize =
        text.split_inclusive('\n').take(row.saturating_sub(1)).map(str::len).sum();
    let line = &text[line_start..];
    let offset = line.char_indices().nth(column.saturating_sub(1)).map_or(line.len(), |(at, _)| at);
    let at = line_start + offset;
    let message = error.to_string();
    let message = message.rsplit_once(" at ").map_or(message.as_str(), |(what, _)| what);
    source.error_at(&(at..at + 1), format!("this is no GraphML: {message}"), "expected XML here")
}

fn child_elements<'x, 'i>(
    element: Element<'x, 'i>,
    name: &'static str,
) -> impl Iterator<Item = Element<'x, 'i>> {
    element.children().filter(move |child| child.tag_name().name() == name)
}

/// Source of the text, for locations.
struct XmlSource<'a> {
    source: &'a SourceText,
}

impl XmlSource<'_> {
    fn error_at(
        &self,
        element: Element<'_, '_>,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        self.source.error_at(&element.range(), message, expected)
    }

    /// Returns the byte range of the value of an XML attribute.
    fn attribute_span(&self, element: Element<'_, '_>, name: &str) -> Range<usize> {
        element.attribute_node(name).map_or(element.range(), |node| node.range_value())
    }

    fn required_attribute<'x>(
        &self,
        element: Element<'x, '_>,
        name: &str,
    ) -> Result<&'x str, Diagnostic> {
        element.attribute(name).ok_or_else(|| {
            let tag = element.tag_name().name();
            self.error_at(
                element,
                format!("`{tag}` has no `{name}`"),
                format!("expected {name}=\"...\""),
            )
        })
    }

    /// Returns the attributes of a node or an edge: the values of its `data` elements, and the defaults of keys without
    /// such an element. Fails for a `data` element with an undeclared key whose id is one of `known`.
    fn parse_attributes(
        &self,
        element: Element<'_, '_>,
        keys: &BTreeMap<&str, Element<'_, '_>>,
        known: &[&str],
    ) -> Result<Vec<Attribute>, Diagnostic> {
        let kind = element.tag_name().name();
        let mut attributes: Vec<Attribute> = Vec::new();
        for data in child_elements(element, "data") {
            let id = self.required_attribute(data, "key")?;
            match keys.get(id) {
                Some(key) => attributes.push(parse_data_attribute(*key, data)),
                None if is_known_key(id, known) => {
                    let message = format!("`data` has the key {id:?}, which is not declared");
                    return Err(self.error_at(
                        data,
                        message,
                        "expected the id of an element `key`",
                    ));
                }
                None => attributes.push((id.to_owned(), LocatedValue::from_text("", data.range()))),
            }
        }
        for key in keys.values() {
            let meant_for = key.attribute("for").unwrap_or("all");
            let Some(default) = child_elements(*key, "default").next() else { continue };
            if meant_for == kind || meant_for == "all" {
                let attribute = parse_data_attribute(*key, default);
                if attributes.iter().all(|(key, _)| *key != attribute.0) {
                    attributes.push(attribute);
                }
            }
        }
        Ok(attributes)
    }
}

/// Returns the value of a `key` that the element `holder` contains, or the reason why it is invalid.
fn parse_data_attribute(key: Element<'_, '_>, holder: Element<'_, '_>) -> Attribute {
    // Drawings of editors have no name.
    let name = key.attribute("attr.name").or(key.attribute("id")).unwrap_or_default();
    let text = holder.text().unwrap_or_default().trim();
    let span = holder.range();
    let value = match key.attribute("attr.type").unwrap_or("string") {
        "int" | "long" => text
            .parse::<i64>()
            .map(|number| number.to_string())
            .map_err(|_| "expected a whole number"),
        "float" | "double" => match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(format!("{number:?}")),
            _ => Err("expected a finite number"),
        },
        "boolean" => match text.to_ascii_lowercase().as_str() {
            "true" | "1" => Ok("true".to_owned()),
            "false" | "0" => Ok("false".to_owned()),
            _ => Err("expected true or false"),
        },
        _ => return (name.to_owned(), LocatedValue::from_text(text, span)),
    };
    let located = match value {
        Ok(value) => LocatedValue { value: AttributeValue::Plain(value), span },
        Err(expected) => {
            LocatedValue::unreadable_value(format!("`{name}` is {text:?}"), expected, span)
        }
    };
    (name.to_owned(), located)
}
