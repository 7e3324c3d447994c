//! Who hears whom, at which offset: all `[[edge]]`, and what each robot `hears`.

use std::collections::BTreeMap;

use formation::Vec2;
use formation::graph::{Edge, FormationGraph};
use protocol::law::Role;

use super::Robot;
use super::diagnostic::Diagnostic;
use super::robots::{Ties, robot_named};
use super::table::{Table, Value};

/// The edges of the file, then those that `hears` stands for, robot by robot.
pub(super) fn graph(
    root: &Table<'_>,
    robots: &[Robot],
    ties: &[Ties<'_>],
) -> Result<FormationGraph, Diagnostic> {
    let mut edges = Edges { robots, ties, list: Vec::new(), seen: BTreeMap::new() };
    for table in root.tables("edge")? {
        table.only(&["from", "to", "offset_m"])?;
        let from = table.need("from", "the robot that is heard")?;
        let to = table.need("to", "the robot that hears")?;
        let ends = [robot_named(&from, robots)?, robot_named(&to, robots)?];
        let missing = |what: &str, expected: &str| table.wrong(what, expected);
        edges.add(ends, &to, table.get("offset_m"), &missing)?;
    }
    for (hearer, tie) in ties.iter().enumerate() {
        let Some(hears) = &tie.hears else { continue };
        let expected = "expected a list of names of robots: [\"r2\", \"r3\"]";
        for heard in hears.elements(expected)? {
            heard.is_at(&format!("edge.{}", edges.list.len()));
            let ends = [robot_named(&heard, robots)?, hearer];
            let missing = |what: &str, expected: &str| {
                heard.wrong(format!("is \"{}\": the edge {what}", robots[ends[0]].name), expected)
            };
            edges.add(ends, &heard, None, &missing)?;
        }
    }
    Ok(FormationGraph::new(robots.len(), edges.list))
}

/// The edges so far.
struct Edges<'a, 't> {
    robots: &'a [Robot],
    ties: &'a [Ties<'t>],
    list: Vec<Edge>,
    /// Which number, from 1, the edge between two robots has.
    seen: BTreeMap<[usize; 2], usize>,
}

impl Edges<'_, '_> {
    /// Adds an edge, or says what is wrong: at `blamed`, or, about its offset, by `missing`.
    fn add(
        &mut self,
        ends: [usize; 2],
        blamed: &Value<'_>,
        offset: Option<Value<'_>>,
        missing: &dyn Fn(&str, &str) -> Diagnostic,
    ) -> Result<(), Diagnostic> {
        let [from, to] = ends.map(|end| &self.robots[end]);
        if ends[0] == ends[1] {
            return Err(blamed.wrong(
                format!("is \"{}\", the robot itself", to.name),
                "expected another robot: nobody hears itself",
            ));
        }
        let number = self.list.len() + 1;
        if let Some(first) = self.seen.insert(ends, number) {
            return Err(blamed.wrong(
                format!("repeats edge {first}: it leads from {} to {} already", from.name, to.name),
                "expected one edge for a pair and direction, in `edge` or in `hears`",
            ));
        }
        let [x, y] = match (to.role, offset) {
            (Role::Leader, _) => {
                return Err(blamed.wrong(
                    format!("makes {}, the leader, hear {}", to.name, from.name),
                    "expected no edge into the leader: it goes by its trajectory and hears nobody",
                ));
            }
            (Role::Formation, Some(offset)) => offset.pair("m")?,
            (Role::Formation, None) => self.between_places(ends, missing)?,
            (Role::Contained, None) => [0.0, 0.0],
            (Role::Contained, Some(offset)) => {
                return Err(offset.wrong(
                    format!("is given, but {} is contained: its law knows no offsets", to.name),
                    "expected no `offset_m` here, or a formation law for that robot",
                ));
            }
        };
        self.list.push(Edge { from: ends[0], to: ends[1], offset_m: Vec2::new(x, y) });
        Ok(())
    }

    /// From one robot's place in the shape to the other's.
    fn between_places(
        &self,
        ends: [usize; 2],
        missing: &dyn Fn(&str, &str) -> Diagnostic,
    ) -> Result<[f64; 2], Diagnostic> {
        let [from, to] = ends.map(|end| &self.robots[end].name);
        let without = match ends.map(|end| self.ties[end].place_m) {
            [Some(from), Some(to)] => return Ok([to[0] - from[0], to[1] - from[1]]),
            [None, None] => format!("neither {from} nor {to} has"),
            [None, Some(_)] => format!("{from} has no"),
            [Some(_), None] => format!("{to} has no"),
        };
        Err(missing(
            &format!("has no `offset_m`, and {without} `place_m`"),
            &format!(
                "expected `place_m` = [x, y] in both robots, their places in the shape; or an edge \
                 with `offset_m` = [x, y], where {to} stands as seen from {from}"
            ),
        ))
    }
}
