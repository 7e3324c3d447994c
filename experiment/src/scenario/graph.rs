//! Formation graph: all `[[edge]]`, and the lists `hears` of the robots.

use std::collections::BTreeMap;
use std::ops::Range;

use formation::Vec2;
use formation::graph::{Edge, FormationGraph};
use protocol::law::Reference;

use super::Robot;
use super::diagnostic::Diagnostic;
use super::fields::kinds;
use super::keys;
use super::robots::{NeighborKeys, robot_named};
use super::table::{TableReader, Value};

/// Returns the edges of the file, then those of `hears`, robot by robot.
pub(super) fn graph(
    root: &TableReader<'_, keys::Root>,
    robots: &[Robot],
    ties: &[NeighborKeys<'_>],
) -> Result<FormationGraph, Diagnostic> {
    let into_leaders = root.truth(keys::Root::drop_edges_to_leaders)?;
    let (list, seen) = (Vec::new(), BTreeMap::new());
    let mut edges =
        Edges { robots, ties, drops_into_leaders: into_leaders, edges: list, locations: seen };
    for table in root.tables(keys::Root::edge)? {
        table.check_keys()?;
        table.is_at(&format!("edge.{}", edges.edges.len()));
        let from = table.required(keys::Edge::from)?;
        let to = table.required(keys::Edge::to)?;
        let ends = [robot_named(&from, robots)?, robot_named(&to, robots)?];
        let whole = |message, expected| table.error_at_table(message, expected);
        edges.add(ends, &to, &whole, table.get(keys::Edge::offset_m))?;
    }
    for (hearer, tie) in ties.iter().enumerate() {
        let Some(hears) = &tie.hears else { continue };
        let expected = "expected a list of names of robots: [\"r2\", \"r3\"]";
        for heard in hears.elements(expected)? {
            heard.is_at(&format!("edge.{}", edges.edges.len()));
            let ends = [robot_named(&heard, robots)?, hearer];
            edges.add(
                ends,
                &heard,
                &|message, expected| heard.error_at_value(message, expected),
                None,
            )?;
        }
    }
    Ok(FormationGraph::new(robots.len(), edges.edges))
}

/// Graph under construction.
struct Edges<'a, 't> {
    robots: &'a [Robot],
    ties: &'a [NeighborKeys<'t>],
    /// `true` if edges to a leader are dropped. Otherwise they are errors.
    drops_into_leaders: bool,
    edges: Vec<Edge>,
    /// Source location of the receiver of each edge, by sender and receiver.
    locations: BTreeMap<[usize; 2], Range<usize>>,
}

impl Edges<'_, '_> {
    /// Adds an edge. An error points at the receiver, or at the `whole` edge.
    fn add<T>(
        &mut self,
        ends: [usize; 2],
        hearer: &Value<'_, T>,
        whole: &dyn Fn(String, String) -> Diagnostic,
        offset: Option<Value<'_, kinds::Pair>>,
    ) -> Result<(), Diagnostic> {
        let [from, to] = ends.map(|end| &self.robots[end]);
        if ends[0] == ends[1] {
            return Err(hearer.error_at_value(
                format!("an edge leads from {} to itself", to.name),
                "expected another robot",
            ));
        }
        if to.role.reference == Reference::Trajectory && self.drops_into_leaders {
            return Ok(());
        }
        if let Some(first) = self.locations.insert(ends, hearer.span()) {
            let first = hearer.location(&first);
            return Err(hearer.error_at_value(
                format!(
                    "the edge from {} to {} is given twice, first at {first}",
                    from.name, to.name
                ),
                "expected one edge for a pair and direction, in `edge`, `hears` or `graph`",
            ));
        }
        let [x, y] = match (to.role.reference, offset) {
            (Reference::Trajectory, _) => {
                return Err(hearer.error_at_value(
                    format!("an edge makes the leader {} hear {}", to.name, from.name),
                    "expected no edge into the leader: it follows its trajectory and hears no robot; \
                     `drop_edges_to_leaders = true` drops such edges, as an undirected `graph` has them",
                ));
            }
            (Reference::Offsets, Some(offset)) => offset.pair()?,
            (Reference::Offsets, None) => self.offset_between_slots(ends, whole)?,
            (Reference::Free, Some(offset)) => offset.pair()?,
            (Reference::Free, None) => match ends.map(|end| self.ties[end].place_m) {
                [Some(from), Some(to)] => [to[0] - from[0], to[1] - from[1]],
                _ => [0.0, 0.0],
            },
            (Reference::Middle | Reference::Goal, None) => [0.0, 0.0],
            (reference @ (Reference::Middle | Reference::Goal), Some(offset)) => {
                let does = match reference {
                    Reference::Goal => "goes to a goal",
                    _ => "is contained",
                };
                return Err(offset.error_about_key(
                    format!("is given, but {} {does}: its law uses no offsets", to.name),
                    "expected no `offset_m` here, or a formation law for that robot",
                ));
            }
        };
        self.edges.push(Edge { from: ends[0], to: ends[1], offset_m: Vec2::new(x, y) });
        Ok(())
    }

    /// Returns the offset from one robot's slot to the other's.
    fn offset_between_slots(
        &self,
        ends: [usize; 2],
        whole: &dyn Fn(String, String) -> Diagnostic,
    ) -> Result<[f64; 2], Diagnostic> {
        let [from, to] = ends.map(|end| &self.robots[end].name);
        let without = match ends.map(|end| self.ties[end].place_m) {
            [Some(from), Some(to)] => return Ok([to[0] - from[0], to[1] - from[1]]),
            [None, None] => "neither robot has a".to_owned(),
            [None, Some(_)] => format!("{from} has no"),
            [Some(_), None] => format!("{to} has no"),
        };
        Err(whole(
            format!("the edge from {from} to {to} has no `offset_m`, and {without} `place_m`"),
            format!(
                "expected `place_m` = [x, y] in both robots, their slots in the formation; or an edge \
                 with `offset_m` = [x, y], the desired position of {to} relative to {from}"
            ),
        ))
    }
}
