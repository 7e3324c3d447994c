//! Who hears whom, at which offset: all `[[edge]]`.

use std::collections::BTreeMap;

use formation::Vec2;
use formation::graph::{Edge, FormationGraph};
use protocol::law::Role;

use super::Robot;
use super::diagnostic::Diagnostic;
use super::robots::robot_named;
use super::table::Table;

/// All `[[edge]]`.
pub(super) fn graph(root: &Table<'_>, robots: &[Robot]) -> Result<FormationGraph, Diagnostic> {
    let mut edges: Vec<Edge> = Vec::new();
    let mut seen = BTreeMap::new();
    for (index, table) in root.tables("edge")?.into_iter().enumerate() {
        table.only(&["from", "to", "offset_m"])?;
        let from = table.need("from", "the robot that is heard")?;
        let to = table.need("to", "the robot that hears")?;
        let ends = (robot_named(&from, robots)?, robot_named(&to, robots)?);
        if ends.0 == ends.1 {
            return Err(to.wrong(
                format!("is \"{}\", the same as `from`", robots[ends.1].name),
                "expected another robot: nobody hears itself",
            ));
        }
        if let Some(first) = seen.insert(ends, index + 1) {
            return Err(to.wrong(
                format!(
                    "is \"{}\": edge {first} leads from {} to {} already",
                    robots[ends.1].name, robots[ends.0].name, robots[ends.1].name
                ),
                "expected one edge for a pair and direction",
            ));
        }
        let hearer = &robots[ends.1];
        let [x, y] = match (hearer.role, table.get("offset_m")) {
            (Role::Leader, _) => {
                return Err(to.wrong(
                    format!("is \"{}\", the leader", hearer.name),
                    "expected another robot: a leader goes by its trajectory and hears nobody",
                ));
            }
            (Role::Formation, Some(offset)) => offset.pair("m")?,
            (Role::Formation, None) => {
                let expected = "where to stand as seen from the robot heard: [x, y], in meters";
                return Err(table.missing("offset_m", expected));
            }
            (Role::Contained, None) => [0.0, 0.0],
            (Role::Contained, Some(offset)) => {
                return Err(offset.wrong(
                    format!("is given, but {} is contained: its law knows no offsets", hearer.name),
                    "expected no `offset_m` here, or a formation law for that robot",
                ));
            }
        };
        edges.push(Edge { from: ends.0, to: ends.1, offset_m: Vec2::new(x, y) });
    }
    Ok(FormationGraph::new(robots.len(), edges))
}
