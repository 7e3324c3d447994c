//! Formation graph as input text for Mermaid and Graphviz.
//!
//! Arrows point in the direction of the information flow: from the sender to the receiver. A robot that tracks a
//! trajectory is a double circle, one that keeps a slot a circle, a contained robot a box, one with a goal a hexagon.

use std::fmt::Write;

use formation::graph::Edge;
use protocol::law::Reference;

use crate::scenario::{Robot, Scenario};

/// Language in which the graph is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawingLanguage {
    /// Mermaid, which GitHub and many editors render.
    Mermaid,
    /// Graphviz, for `| dot -Tsvg`.
    Dot,
}

/// Returns the graph of the scenario in the language of `drawing`.
pub fn draw_graph(scenario: &Scenario, drawing: DrawingLanguage) -> String {
    match drawing {
        DrawingLanguage::Mermaid => draw_mermaid(scenario),
        DrawingLanguage::Dot => draw_dot(scenario),
    }
}

/// Returns the brackets of a Mermaid node and the Graphviz shape of a robot.
fn node_shape(robot: &Robot) -> ([&'static str; 2], &'static str) {
    match robot.role.reference {
        Reference::Trajectory => (["(((", ")))"], "doublecircle"),
        Reference::Offsets => (["((", "))"], "circle"),
        Reference::NeighborMean => (["[", "]"], "box"),
        Reference::Goal => (["{{", "}}"], "hexagon"),
        Reference::LawTarget => (["([", "])"], "ellipse"),
    }
}

fn draw_mermaid(scenario: &Scenario) -> String {
    // Writing to a string cannot fail. A JSON string is a YAML string.
    let title = serde_json::Value::from(scenario.name.as_str());
    let mut text = format!("---\ntitle: {title}\n---\nflowchart LR\n");
    for (i, robot) in scenario.robots.iter().enumerate() {
        let ([open, close], _) = node_shape(robot);
        // Names are only used as labels, because they can be Mermaid keywords such as `end`.
        let name = robot.name.replace('"', "#quot;");
        let _ = writeln!(text, "    robot{}{open}\"{name}\"{close}", i + 1);
    }
    for edge in scenario.graph.edges() {
        let label =
            edge_label(scenario, edge).map_or(String::new(), |label| format!("|\"{label}\"|"));
        let _ = writeln!(text, "    robot{} -->{label} robot{}", edge.from + 1, edge.to + 1);
    }
    text
}

fn draw_dot(scenario: &Scenario) -> String {
    let mut text = format!("digraph {} {{\n    rankdir = LR\n", quote_for_dot(&scenario.name));
    for robot in &scenario.robots {
        let (_, shape) = node_shape(robot);
        let _ = writeln!(text, "    {} [shape = {shape}]", quote_for_dot(&robot.name));
    }
    for edge in scenario.graph.edges() {
        let [from, to] = [edge.from, edge.to].map(|end| quote_for_dot(&scenario.robots[end].name));
        let label = edge_label(scenario, edge)
            .map_or(String::new(), |label| format!(" [label = {}]", quote_for_dot(&label)));
        let _ = writeln!(text, "    {from} -> {to}{label}");
    }
    text + "}\n"
}

/// Returns a quoted Graphviz string.
fn quote_for_dot(text: &str) -> String {
    let plain = text.replace(|c: char| c.is_control(), " ");
    format!("\"{}\"", plain.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Returns the offset of an edge, or `None` if the receiver's law uses no offsets.
fn edge_label(scenario: &Scenario, edge: &Edge) -> Option<String> {
    let offset_m = edge.offset_m;
    (scenario.robots[edge.to].role.reference == Reference::Offsets)
        .then(|| format!("({:.3}, {:.3}) m", offset_m.x, offset_m.y))
}

#[cfg(test)]
mod tests {
    use protocol::law::Role;

    use super::*;
    use crate::examples::row_of_three;

    #[test]
    fn both_show_roles_by_shape_and_offsets_as_labels() {
        let mut scenario = row_of_three();
        scenario.name = "a \"quoted\" \\ name".to_owned();
        scenario.robots[0].name = "end".to_owned();
        scenario.robots[0].role = Role::LEADER;
        scenario.robots[2].role = Role::CONTAINED;
        let mermaid = r#"---
title: "a \"quoted\" \\ name"
---
flowchart LR
    robot1((("end")))
    robot2(("r2"))
    robot3["r3"]
    robot1 -->|"(-1.000, 0.000) m"| robot2
    robot2 --> robot3
"#;
        assert_eq!(draw_graph(&scenario, DrawingLanguage::Mermaid), mermaid);
        let dot = r#"digraph "a \"quoted\" \\ name" {
    rankdir = LR
    "end" [shape = doublecircle]
    "r2" [shape = circle]
    "r3" [shape = box]
    "end" -> "r2" [label = "(-1.000, 0.000) m"]
    "r2" -> "r3"
}
"#;
        assert_eq!(draw_graph(&scenario, DrawingLanguage::Dot), dot);
    }
}
