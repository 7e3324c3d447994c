//! The formation graph as text that others draw: Mermaid and Graphviz.
//!
//! Arrows point the way information flows: from the robot that is heard to the one that hears.
//! Whoever follows a trajectory has two rings, those that keep a place one, the contained a box, those
//! that go to goals a hexagon.

use std::fmt::Write;

use formation::graph::Edge;
use protocol::law::Reference;

use crate::scenario::Scenario;

/// Who draws it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drawing {
    /// Mermaid: GitHub and many editors draw it.
    Mermaid,
    /// Graphviz: `| dot -Tsvg`.
    Dot,
}

/// The scenario's graph in the words of `drawing`.
pub fn drawn(scenario: &Scenario, drawing: Drawing) -> String {
    match drawing {
        Drawing::Mermaid => mermaid(scenario),
        Drawing::Dot => dot(scenario),
    }
}

fn mermaid(scenario: &Scenario) -> String {
    // Writing to a string cannot fail. A JSON string is a YAML string.
    let title = serde_json::Value::from(scenario.name.as_str());
    let mut text = format!("---\ntitle: {title}\n---\nflowchart LR\n");
    for (i, robot) in scenario.robots.iter().enumerate() {
        let (open, close) = match robot.role.reference {
            Reference::Trajectory => ("(((", ")))"),
            Reference::Offsets => ("((", "))"),
            Reference::Middle => ("[", "]"),
            Reference::Goal => ("{{", "}}"),
        };
        // Names may be words of Mermaid's own, such as `end`: they are labels only.
        let name = robot.name.replace('"', "#quot;");
        let _ = writeln!(text, "    robot{}{open}\"{name}\"{close}", i + 1);
    }
    for edge in scenario.graph.edges() {
        let label = label(scenario, edge).map_or(String::new(), |label| format!("|\"{label}\"|"));
        let _ = writeln!(text, "    robot{} -->{label} robot{}", edge.from + 1, edge.to + 1);
    }
    text
}

fn dot(scenario: &Scenario) -> String {
    let mut text = format!("digraph {} {{\n    rankdir = LR\n", in_dot(&scenario.name));
    for robot in &scenario.robots {
        let shape = match robot.role.reference {
            Reference::Trajectory => "doublecircle",
            Reference::Offsets => "circle",
            Reference::Middle => "box",
            Reference::Goal => "hexagon",
        };
        let _ = writeln!(text, "    {} [shape = {shape}]", in_dot(&robot.name));
    }
    for edge in scenario.graph.edges() {
        let [from, to] = [edge.from, edge.to].map(|end| in_dot(&scenario.robots[end].name));
        let label = label(scenario, edge)
            .map_or(String::new(), |label| format!(" [label = {}]", in_dot(&label)));
        let _ = writeln!(text, "    {from} -> {to}{label}");
    }
    text + "}\n"
}

/// A string as Graphviz reads it.
fn in_dot(text: &str) -> String {
    let plain = text.replace(|c: char| c.is_control(), " ");
    format!("\"{}\"", plain.replace('\\', "\\\\").replace('"', "\\\""))
}

/// The offset, where the hearer's law knows one.
fn label(scenario: &Scenario, edge: &Edge) -> Option<String> {
    let at = edge.offset_m;
    (scenario.robots[edge.to].role.reference == Reference::Offsets)
        .then(|| format!("({:.3}, {:.3}) m", at.x, at.y))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use protocol::avoidance::AvoidanceDescription;
    use protocol::catalog::Catalog;
    use protocol::law::{LawDescription, Role};

    use super::*;
    use crate::scenario::read::{Overrides, read_text};

    fn scenario() -> Scenario {
        let law = |name, role| LawDescription {
            name,
            role,
            source: "",
            gains: &[],
            feed_forward: false,
            correction_max: None,
        };
        let laws =
            [law("lead", Role::LEADER), law("keep", Role::FORMATION), law("mean", Role::CONTAINED)];
        let catalog = Catalog { laws: laws.to_vec(), methods: vec![AvoidanceDescription::INERT] };
        let text = r#"
            name = 'a "quoted" \ name'
            duration_s = 1.0
            period_s = 0.005
            avoidance = { distance_min_m = 0.2, speed_max_m_s = 0.3 }
            robot_defaults = { front_point_m = 0.1 }
            trajectory = { kind = "still" }
            robot = [
                { name = "end", law = "lead", pose = { x_m = 0, y_m = 0, heading_rad = 0 } },
                { name = "r2", law = "keep", pose = { x_m = 1, y_m = 0, heading_rad = 0 } },
                { name = "r3", law = "mean", hears = ["end", "r2"], pose = { x_m = 2, y_m = 0, heading_rad = 0 } },
            ]
            edge = [{ from = "end", to = "r2", offset_m = [1, -0.5] }]
        "#;
        read_text(Path::new("t.toml"), text, &Overrides::default(), &catalog)
            .unwrap_or_else(|error| panic!("{}", error.render(false)))
            .0
    }

    #[test]
    fn mermaid_shows_roles_by_shape_and_offsets_as_labels() {
        let expected = r#"---
title: "a \"quoted\" \\ name"
---
flowchart LR
    robot1((("end")))
    robot2(("r2"))
    robot3["r3"]
    robot1 -->|"(1.000, -0.500) m"| robot2
    robot1 --> robot3
    robot2 --> robot3
"#;
        assert_eq!(drawn(&scenario(), Drawing::Mermaid), expected);
    }

    #[test]
    fn dot_shows_roles_by_shape_and_offsets_as_labels() {
        let expected = r#"digraph "a \"quoted\" \\ name" {
    rankdir = LR
    "end" [shape = doublecircle]
    "r2" [shape = circle]
    "r3" [shape = box]
    "end" -> "r2" [label = "(1.000, -0.500) m"]
    "end" -> "r3"
    "r2" -> "r3"
}
"#;
        assert_eq!(drawn(&scenario(), Drawing::Dot), expected);
    }
}
