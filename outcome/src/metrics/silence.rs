//! Who is silent, by faults, and whom that breaks.

use experiment::prediction::{Broken, Predictor};
use experiment::scenario::{Scenario, Silenced};
use formation::reachability::Reachability;
use formation::seconds;

/// Who and what is silent now, and by how many faults.
#[derive(Debug, Clone)]
pub(super) struct Silent {
    robots: Vec<i32>,
    edges: Vec<i32>,
}

impl Silent {
    /// Everybody speaks.
    pub(super) fn new(scenario: &Scenario) -> Silent {
        let edges = scenario.graph.edges().len();
        Silent { robots: vec![0; scenario.robots.len()], edges: vec![0; edges] }
    }

    /// One fault more, or fewer, silences this.
    pub(super) fn count(&mut self, silenced: Silenced, by: i32) {
        match silenced {
            Silenced::Nobody => {}
            Silenced::Robot(robot) => self.robots[robot] += by,
            Silenced::Edge(edge) => self.edges[edge] += by,
        }
    }

    /// Everybody speaks again.
    pub(super) fn clear(&mut self) {
        self.robots.fill(0);
        self.edges.fill(0);
    }

    /// Whether anything is heard over this edge.
    pub(super) fn carries(&self, edge: usize, from: usize) -> bool {
        self.robots[from] <= 0 && self.edges[edge] <= 0
    }

    /// Whether nobody hears this robot.
    pub(super) fn robot(&self, robot: usize) -> bool {
        self.robots[robot] > 0
    }

    /// Everybody among the others whom no living leader reaches any more.
    pub(super) fn orphaned(&self, reachability: &Reachability) -> Vec<usize> {
        let loss = reachability.loss(&gone(&self.robots), &gone(&self.edges));
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
