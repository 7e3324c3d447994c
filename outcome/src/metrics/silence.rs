//! Who is silent, by faults, and whom that breaks.

use experiment::prediction::{Broken, Predictor};
use experiment::scenario::{Scenario, Silenced};
use formation::reachability::Reachability;
use formation::seconds;

/// Who and what is silent now, by how many faults, and by whom robots go meanwhile. Spares are edges behind
/// those of the graph.
#[derive(Debug, Clone)]
pub(super) struct Silent {
    robots: Vec<i32>,
    edges: Vec<i32>,
    /// The ends of each edge, `[from, to]`.
    ends: Vec<[usize; 2]>,
    /// How many are of the graph.
    in_graph: usize,
    gone_by: Vec<bool>,
    /// Whether a contained robot hears it to keep the place of a leader that it takes.
    for_place: Vec<bool>,
    leader: Option<usize>,
    /// Which deputies lead in its place.
    leads: Vec<bool>,
}

/// By whom a robot goes changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "robots by their places")]
pub enum Rewiring {
    /// It goes by another, or no longer does.
    GoesBy { robot: usize, other: usize, yes: bool },
    /// A deputy leads, or no longer does.
    Leads { robot: usize, yes: bool },
    /// It is replaced, and goes by its in-neighbours again.
    Anew { robot: usize },
}

impl Silent {
    /// Everybody speaks.
    pub(super) fn new(scenario: &Scenario) -> Silent {
        let in_graph = scenario.graph.edges().len();
        let edges = scenario.graph.edges().iter().chain(&scenario.spares);
        let for_place = |(place, edge)| place >= in_graph && scenario.is_for_place(edge);
        let for_place = edges.clone().enumerate().map(for_place).collect();
        let ends: Vec<[usize; 2]> = edges.map(|edge| [edge.from, edge.to]).collect();
        Silent {
            robots: vec![0; scenario.robots.len()],
            edges: vec![0; ends.len()],
            gone_by: (0..ends.len()).map(|edge| edge < in_graph).collect(),
            ends,
            for_place,
            in_graph,
            leader: scenario.leader(),
            leads: vec![false; scenario.robots.len()],
        }
    }

    /// One fault more, or fewer, silences this.
    pub(super) fn count(&mut self, silenced: Silenced, by: i32) {
        match silenced {
            Silenced::Nobody => {}
            Silenced::Robot(robot) => self.robots[robot] += by,
            Silenced::Edge(edge) => self.edges[edge] += by,
        }
    }

    /// A robot goes by others.
    pub(super) fn rewire(&mut self, rewiring: Rewiring) {
        match rewiring {
            Rewiring::Leads { robot, yes } => self.leads[robot] = yes,
            Rewiring::Anew { robot } => self.leads[robot] = false,
            Rewiring::GoesBy { .. } => {}
        }
        for (edge, &[from, to]) in self.ends.iter().enumerate() {
            match rewiring {
                Rewiring::GoesBy { robot, other, yes } if [from, to] == [other, robot] => {
                    self.gone_by[edge] = yes;
                }
                Rewiring::Anew { robot } if to == robot => {
                    self.gone_by[edge] = edge < self.in_graph;
                }
                _ => {}
            }
        }
    }

    /// Everybody speaks again.
    pub(super) fn clear(&mut self) {
        self.robots.fill(0);
        self.edges.fill(0);
    }

    /// Whether the robot that hears over this edge goes by it, and anything is heard.
    pub(super) fn carries(&self, edge: usize, from: usize) -> bool {
        self.gone_by[edge] && self.robots[from] <= 0 && self.edges[edge] <= 0
    }

    /// Whether the robot that hears over this edge goes by it, heard or not.
    pub(super) fn goes_by(&self, edge: usize) -> bool {
        self.gone_by[edge]
    }

    /// Whether this edge is a spare.
    pub(super) fn is_spare(&self, edge: usize) -> bool {
        edge >= self.in_graph
    }

    /// Whether this robot, a deputy, leads.
    pub(super) fn leads(&self, robot: usize) -> bool {
        self.leads[robot]
    }

    /// Whether this robot, a contained one, takes the place of a leader.
    pub(super) fn takes_place(&self, robot: usize) -> bool {
        let by = |edge: usize| self.for_place[edge] && self.gone_by[edge];
        (0..self.ends.len()).any(|edge| self.ends[edge][1] == robot && by(edge))
    }

    /// Whether nobody hears this robot.
    pub(super) fn robot(&self, robot: usize) -> bool {
        self.robots[robot] > 0
    }

    /// Everybody among the others whom no living leader reaches any more.
    pub(super) fn orphaned(&self, reachability: &Reachability) -> Vec<usize> {
        let silent = (0..self.ends.len()).filter(|&e| self.edges[e] > 0 || !self.gone_by[e]);
        let leaders = (0..self.leads.len()).filter(|&i| self.leads[i] || self.leader == Some(i));
        let (dead, silent): (_, Vec<usize>) = (gone(&self.robots), silent.collect());
        let loss = reachability.loss_led_by(&leaders.collect::<Vec<_>>(), &dead, &silent);
        [loss.unled, loss.uncontained, loss.adrift].concat()
    }

    /// Whom it breaks that all these are silent from `t_ns` on.
    pub(super) fn breaks(&self, predictor: &Predictor, t_ns: u64) -> Vec<Broken> {
        predictor.broken(&gone(&self.robots), &gone(&self.edges), Some(seconds(t_ns)))
    }
}

/// Those that some fault silences.
fn gone(counts: &[i32]) -> Vec<usize> {
    (0..counts.len()).filter(|&place| counts[place] > 0).collect()
}
