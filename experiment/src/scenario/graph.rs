//! Formation graph: all `[[edge]]`, and the lists `hears` of the robots.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use formation::Vec2;
use formation::graph::{Edge, FormationGraph};
use protocol::brief::RangeBrief;
use protocol::law::Reference;

use super::Robot;
use super::diagnostic::Diagnostic;
use super::fields::kinds;
use super::keys;
use super::robots::{NeighborKeys, parse_robot_index};
use super::table::{TableReader, TypedValue};

/// Maximum number of robots of a scenario with communication by distance: each has a link from every other.
const DISK_ROBOTS_MAX: usize = 64;
/// Default of `hysteresis_m`, as a fraction of the radius.
const HYSTERESIS_FRACTION_DEFAULT: f64 = 0.05;

/// Communication by distance: some edges of the graph exist only while their robots are near each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiskGraph {
    /// Distances at which these edges appear and disappear.
    pub range: RangeBrief,
    /// Index of the first of these edges; all edges after it are by distance too.
    pub first_edge_index: usize,
}

/// Parameters of edges, by sender and receiver.
type EdgeParams = BTreeMap<[usize; 2], toml::Table>;

/// Parses the graph: the edges of the file, then of `hears`, robot by robot, then by distance. The parameters of the
/// edges are in the third element.
pub(super) fn parse_graph(
    root: &TableReader<'_, keys::Root>,
    robots: &[Robot],
    neighbor_keys: &[NeighborKeys<'_>],
) -> Result<(FormationGraph, Option<DiskGraph>, EdgeParams), Diagnostic> {
    let mut params = EdgeParams::new();
    let drops_edges_into_leaders = root.boolean(keys::Root::drop_edges_to_leaders)?;
    let mut builder = GraphBuilder {
        robots,
        neighbor_keys,
        drops_edges_into_leaders,
        edges: Vec::new(),
        locations: BTreeMap::new(),
    };
    for table in root.tables(keys::Root::edge)? {
        table.check_keys()?;
        table.record_location(&format!("edge.{}", builder.edges.len()));
        let from = table.required_value(keys::Edge::from)?;
        let to = table.required_value(keys::Edge::to)?;
        let endpoints = [parse_robot_index(&from, robots)?, parse_robot_index(&to, robots)?];
        let error_at_edge = |message, expected| table.error_at_table(message, expected);
        builder.add_edge(endpoints, &to, &error_at_edge, table.get(keys::Edge::offset_m))?;
        if let Some(edge_params) = table.get(keys::Edge::params) {
            let to = &robots[endpoints[1]];
            if !to.takes_params {
                return Err(edge_params.error_about_key(
                    format!(
                        "is given, but the law \"{}\" of {} takes no parameters",
                        to.law, to.name
                    ),
                    "expected no such key, or a law that is a program: `[laws.NAME]`",
                ));
            }
            params.insert(endpoints, edge_params.any_table()?);
        }
    }
    for (receiver, robot_keys) in neighbor_keys.iter().enumerate() {
        let Some(senders) = &robot_keys.hears else { continue };
        let expected = "expected a list of names of robots: [\"r2\", \"r3\"]";
        for sender in senders.elements(expected)? {
            sender.record_location(&format!("edge.{}", builder.edges.len()));
            let endpoints = [parse_robot_index(&sender, robots)?, receiver];
            builder.add_edge(
                endpoints,
                &sender,
                &|message, expected| sender.error_at_value(message, expected),
                None,
            )?;
        }
    }
    let mut edges = builder.edges;
    let disk =
        root.get(keys::Root::graph).map(|graph| parse_disk_graph(&graph, robots, &mut edges));
    Ok((FormationGraph::new(robots.len(), edges), disk.transpose()?, params))
}

/// Parses communication by distance, and adds its edges: to each robot with the role `free` or `goal`, from all others
/// without an edge to it.
fn parse_disk_graph(
    graph: &TypedValue<'_, kinds::FileOrTable<keys::Disk>>,
    robots: &[Robot],
    edges: &mut Vec<Edge>,
) -> Result<DiskGraph, Diagnostic> {
    let table = graph.table()?;
    let _: String = table.read_word(keys::Disk::kind)?;
    let radius_m = table.number(keys::Disk::radius_m)?;
    let hysteresis_m = table.optional_number(keys::Disk::hysteresis_m)?;
    let hysteresis_m = hysteresis_m.unwrap_or(HYSTERESIS_FRACTION_DEFAULT * radius_m);
    if robots.len() > DISK_ROBOTS_MAX {
        return Err(graph.error_about_key(
            format!("is communication by distance between {} robots", robots.len()),
            format!("expected at most {DISK_ROBOTS_MAX} robots, because each has a link from every other"),
        ));
    }
    let needs_no_slot =
        |to: &usize| matches!(robots[*to].role.reference, Reference::LawTarget | Reference::Goal);
    let receivers: Vec<usize> = (0..robots.len()).filter(needs_no_slot).collect();
    if receivers.is_empty() {
        return Err(graph.error_about_key(
            "is communication by distance, but no robot has the role `free` or `goal`",
            "expected a law with `role = \"free\"`: a robot that keeps a slot needs fixed in-neighbors, as `hears` and `edge` \
             list them",
        ));
    }
    let first_edge_index = edges.len();
    let existing: BTreeSet<[usize; 2]> = edges.iter().map(|edge| [edge.from, edge.to]).collect();
    for to in receivers {
        let others =
            (0..robots.len()).filter(|&from| from != to && !existing.contains(&[from, to]));
        edges.extend(others.map(|from| Edge { from, to, offset_m: Vec2::zeros() }));
    }
    Ok(DiskGraph { range: RangeBrief { radius_m, hysteresis_m }, first_edge_index })
}

/// Graph under construction.
struct GraphBuilder<'a, 't> {
    robots: &'a [Robot],
    neighbor_keys: &'a [NeighborKeys<'t>],
    /// `true` if edges to a leader are dropped. Otherwise they are errors.
    drops_edges_into_leaders: bool,
    edges: Vec<Edge>,
    /// Source location of the receiver of each edge, by sender and receiver.
    locations: BTreeMap<[usize; 2], Range<usize>>,
}

impl GraphBuilder<'_, '_> {
    /// Adds an edge. An error points at `receiver`; `error_at_edge` points at the whole edge.
    fn add_edge<T>(
        &mut self,
        endpoints: [usize; 2],
        receiver: &TypedValue<'_, T>,
        error_at_edge: &dyn Fn(String, String) -> Diagnostic,
        offset: Option<TypedValue<'_, kinds::Pair>>,
    ) -> Result<(), Diagnostic> {
        let [from, to] = endpoints.map(|robot| &self.robots[robot]);
        if endpoints[0] == endpoints[1] {
            return Err(receiver.error_at_value(
                format!("an edge leads from {} to itself", to.name),
                "expected another robot",
            ));
        }
        if to.role.reference == Reference::Trajectory && self.drops_edges_into_leaders {
            return Ok(());
        }
        if let Some(first) = self.locations.insert(endpoints, receiver.span()) {
            let first = receiver.location(&first);
            return Err(receiver.error_at_value(
                format!(
                    "the edge from {} to {} is given twice, first at {first}",
                    from.name, to.name
                ),
                "expected one edge for a pair and direction, in `edge`, `hears` or `graph`",
            ));
        }
        let [x, y] = match (to.role.reference, offset) {
            (Reference::Trajectory, _) => {
                return Err(receiver.error_at_value(
                    format!("an edge makes the leader {} hear {}", to.name, from.name),
                    "expected no edge into the leader: it follows its trajectory and hears no robot; \
                     `drop_edges_to_leaders = true` drops such edges, as an undirected `graph` has them",
                ));
            }
            (Reference::Offsets, Some(offset)) => offset.pair()?,
            (Reference::Offsets, None) => self.offset_between_slots(endpoints, error_at_edge)?,
            (Reference::LawTarget, Some(offset)) => offset.pair()?,
            (Reference::LawTarget, None) => {
                match endpoints.map(|robot| self.neighbor_keys[robot].place_m) {
                    [Some(from), Some(to)] => [to[0] - from[0], to[1] - from[1]],
                    _ => [0.0, 0.0],
                }
            }
            (Reference::NeighborMean | Reference::Goal, None) => [0.0, 0.0],
            (reference @ (Reference::NeighborMean | Reference::Goal), Some(offset)) => {
                let reason = match reference {
                    Reference::Goal => "goes to a goal",
                    _ => "is contained",
                };
                return Err(offset.error_about_key(
                    format!("is given, but {} {reason}: its law uses no offsets", to.name),
                    "expected no `offset_m` here, or a formation law for that robot",
                ));
            }
        };
        self.edges.push(Edge { from: endpoints[0], to: endpoints[1], offset_m: Vec2::new(x, y) });
        Ok(())
    }

    /// Returns the offset from one robot's slot to the other's.
    fn offset_between_slots(
        &self,
        endpoints: [usize; 2],
        error_at_edge: &dyn Fn(String, String) -> Diagnostic,
    ) -> Result<[f64; 2], Diagnostic> {
        let [from, to] = endpoints.map(|robot| &self.robots[robot].name);
        let missing = match endpoints.map(|robot| self.neighbor_keys[robot].place_m) {
            [Some(from), Some(to)] => return Ok([to[0] - from[0], to[1] - from[1]]),
            [None, None] => "neither robot has a".to_owned(),
            [None, Some(_)] => format!("{from} has no"),
            [Some(_), None] => format!("{to} has no"),
        };
        Err(error_at_edge(
            format!("the edge from {from} to {to} has no `offset_m`, and {missing} `place_m`"),
            format!(
                "expected `place_m` = [x, y] in both robots, their slots in the formation; or an edge \
                 with `offset_m` = [x, y], the desired position of {to} relative to {from}"
            ),
        ))
    }
}
