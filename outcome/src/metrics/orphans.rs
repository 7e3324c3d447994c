//! Robots that are disconnected from every leader (orphaned): alive, with a role that needs a leader, and not
//! reached by information of any living leader over living robots and working edges.
//!
//! With a main leader all other robots need it; without one the followers need a robot that keeps an offset. Known
//! deaths, freezes and cuts decide, not the reports of robots, so the result is the same in every lockstep run.
//! Only the state at the end of an instant counts, so that the order in which robots return at that instant has no
//! influence.

use formation::reachability::Reachability;

use crate::metrics::silence::{ReferenceChange, SilenceState};
use experiment::scenario::{Scenario, SilencedSource};

/// Tracker of the orphaned robots.
pub(super) struct OrphanTracker {
    reachability: Reachability,
    /// Silence up to the time to which changes were applied.
    silence: SilenceState,
    /// Changes after that time, with their times, ns.
    pending_changes: Vec<(u64, ReachChange)>,
    pub(super) is_orphaned: Vec<bool>,
}

/// A change that may affect which robots a leader reaches.
#[derive(Debug, Clone, Copy)]
enum ReachChange {
    /// A robot or edge was silenced (1), or is no longer silenced (-1).
    Silenced(SilencedSource, i32),
    Rewired(ReferenceChange),
}

/// A robot was disconnected from every leader, or is connected again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OrphanChange {
    /// Run time, ns.
    pub t_ns: u64,
    /// Index of the robot in the scenario.
    pub robot: usize,
    /// Whether the robot is disconnected now.
    pub is_orphaned: bool,
}

impl OrphanTracker {
    /// Creates the tracker without faults.
    pub(super) fn new(scenario: &Scenario) -> OrphanTracker {
        OrphanTracker {
            reachability: scenario.reachability_of(&scenario.graph_with_spares()),
            silence: SilenceState::new(scenario),
            pending_changes: Vec::new(),
            is_orphaned: vec![false; scenario.robots.len()],
        }
    }

    /// Adds `delta` to the number of faults that silence a robot or edge from that time on.
    pub(super) fn add_silence(&mut self, t_ns: u64, silenced: SilencedSource, delta: i32) {
        if silenced != SilencedSource::NoSource {
            self.pending_changes.push((t_ns, ReachChange::Silenced(silenced, delta)));
        }
    }

    /// Records a change of the neighbors that a robot uses from that time on.
    pub(super) fn record_rewiring(&mut self, t_ns: u64, rewiring: ReferenceChange) {
        self.pending_changes.push((t_ns, ReachChange::Rewired(rewiring)));
    }

    /// Applies all changes before this time, ns. Returns the robots whose state changed, in order of time and
    /// robots.
    pub(super) fn apply_changes_before(&mut self, t_ns: u64) -> Vec<OrphanChange> {
        let mut changes = Vec::new();
        if self.pending_changes.is_empty() {
            return changes;
        }
        self.pending_changes.sort_by_key(|&(t_ns, ..)| t_ns);
        let known = self.pending_changes.partition_point(|&(change_ns, ..)| change_ns < t_ns);
        let known: Vec<_> = self.pending_changes.drain(..known).collect();
        for instant in known.chunk_by(|(a_ns, _), (b_ns, _)| a_ns == b_ns) {
            for &(_, change) in instant {
                match change {
                    ReachChange::Silenced(silenced, delta) => {
                        self.silence.add_silence(silenced, delta)
                    }
                    ReachChange::Rewired(rewiring) => self.silence.apply_rewiring(rewiring),
                }
            }
            let orphaned = self.silence.orphaned_robots(&self.reachability);
            for (robot, was_orphaned) in self.is_orphaned.iter_mut().enumerate() {
                let is_orphaned = orphaned.contains(&robot);
                // A robot that is silent itself is not reported as orphaned.
                let is_reported = *was_orphaned != is_orphaned && !self.silence.is_silent(robot);
                *was_orphaned = is_orphaned;
                if is_reported {
                    changes.push(OrphanChange { t_ns: instant[0].0, robot, is_orphaned });
                }
            }
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;
    use formation::scale::Scale;
    use formation::trajectory::Trajectory;
    use protocol::brief::LeadBrief;
    use protocol::law::Role;

    /// Returns the tracker of a row: r1 leads, r2 receives from r1, r3 from r2.
    fn row_with_leader() -> OrphanTracker {
        let mut scenario = row_of_three();
        scenario.robots[0].role = Role::LEADER;
        let trajectory = Trajectory::Still { center_m: [0.0, 0.0] };
        scenario.lead =
            Some(LeadBrief { trajectory, scale: Scale::CONSTANT_ONE, keep_heading: false });
        OrphanTracker::new(&scenario)
    }

    fn orphan_change(t_ns: u64, robot: usize, is_orphaned: bool) -> OrphanChange {
        OrphanChange { t_ns, robot, is_orphaned }
    }

    #[test]
    fn death_and_cut_orphan_downstream_robots_until_both_end() {
        let mut orphans = row_with_leader();
        orphans.add_silence(3, SilencedSource::Robot(0), 1);
        orphans.add_silence(5, SilencedSource::Edge(1), 1);
        orphans.add_silence(7, SilencedSource::Robot(0), -1);
        orphans.add_silence(9, SilencedSource::Edge(1), -1);
        assert_eq!(orphans.apply_changes_before(3), []);
        assert_eq!(
            orphans.apply_changes_before(4),
            [orphan_change(3, 1, true), orphan_change(3, 2, true)]
        );
        assert_eq!(orphans.is_orphaned, [false, true, true]);
        assert_eq!(orphans.apply_changes_before(9), [orphan_change(7, 1, false)]);
        assert_eq!(orphans.apply_changes_before(10), [orphan_change(9, 2, false)]);
        assert_eq!(orphans.is_orphaned, [false; 3]);
    }

    #[test]
    fn dead_robot_leaves_orphans_without_event() {
        let mut orphans = row_with_leader();
        orphans.add_silence(3, SilencedSource::Robot(0), 1);
        orphans.add_silence(4, SilencedSource::Robot(1), 1);
        assert_eq!(
            orphans.apply_changes_before(5),
            [orphan_change(3, 1, true), orphan_change(3, 2, true)]
        );
        assert_eq!(orphans.is_orphaned, [false, false, true]);
        // A replacement has no leader either.
        orphans.add_silence(5, SilencedSource::Robot(1), -1);
        assert_eq!(orphans.apply_changes_before(6), [orphan_change(5, 1, true)]);
    }

    #[test]
    fn order_of_simultaneous_returns_has_no_effect() {
        for order in [[0, 1], [1, 0]] {
            let mut orphans = row_with_leader();
            orphans.add_silence(3, SilencedSource::Robot(0), 1);
            orphans.add_silence(3, SilencedSource::Robot(1), 1);
            order
                .into_iter()
                .for_each(|robot| orphans.add_silence(5, SilencedSource::Robot(robot), -1));
            assert_eq!(
                orphans.apply_changes_before(9),
                [orphan_change(3, 2, true), orphan_change(5, 2, false)]
            );
        }
    }

    #[test]
    fn leaderless_formation_orphans_only_isolated_contained_robots() {
        let mut scenario = row_of_three();
        scenario.robots[2].role = Role::CONTAINED;
        let mut orphans = OrphanTracker::new(&scenario);
        orphans.add_silence(3, SilencedSource::Robot(0), 1);
        assert_eq!(orphans.apply_changes_before(4), []);
        orphans.add_silence(5, SilencedSource::Edge(1), 1);
        assert_eq!(orphans.apply_changes_before(6), [orphan_change(5, 2, true)]);
    }
}
