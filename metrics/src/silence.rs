//! Who is silent, by faults, and who loses by that what it goes by.

use experiment::scenario::{Scenario, Silenced};
use formation::reachability::{Reachability, Standing};

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
        let loss = self.loss(reachability);
        [loss.unled, loss.uncontained, loss.adrift].concat()
    }

    /// Everybody who loses what it goes by.
    pub(super) fn loses(&self, reachability: &Reachability) -> Vec<usize> {
        let loss = self.loss(reachability);
        let lists = [loss.unled, loss.pulled, loss.uncontained, loss.adrift, loss.groups.concat()];
        let mut robots = lists.concat();
        robots.sort_unstable();
        robots.dedup();
        robots
    }

    fn loss(&self, reachability: &Reachability) -> Standing {
        let gone = |counts: &[i32]| -> Vec<usize> {
            (0..counts.len()).filter(|&place| counts[place] > 0).collect()
        };
        reachability.loss(&gone(&self.robots), &gone(&self.edges))
    }
}
