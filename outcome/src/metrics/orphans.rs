//! Who is cut off from its leader: alive, in need of one by its role, and not reached by the
//! information of any that lives, over living robots and edges that carry.
//!
//! With a main leader everybody else needs it; without one the contained need somebody that keeps a
//! place. Known deaths, freezes and cuts decide it, not what robots say: it is the same in every
//! lockstep run. Of one instant only what holds at its end counts, so that it does not matter in
//! which order robots came back at it.

use formation::reachability::Reachability;

use crate::metrics::silence::{Rewiring, Silent};
use experiment::scenario::{Scenario, Silenced};

/// Who is orphaned.
pub(super) struct Orphans {
    reachability: Reachability,
    /// Up to the time that is settled.
    silent: Silent,
    /// What happened since, and when, ns.
    pending: Vec<(u64, Change)>,
    pub(super) orphaned: Vec<bool>,
}

/// What decides who is reached.
#[derive(Debug, Clone, Copy)]
enum Change {
    /// This was silenced (1), or spoke again (-1).
    Silenced(Silenced, i32),
    Rewired(Rewiring),
}

/// A robot was cut off from its leader, or is reached again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// When, ns of run time.
    pub t_ns: u64,
    /// Which robot, by its place in the scenario.
    pub robot: usize,
    /// What became of it.
    pub orphaned: bool,
}

impl Orphans {
    /// Everybody speaks.
    pub(super) fn new(scenario: &Scenario) -> Orphans {
        Orphans {
            reachability: scenario.reachability_of(&scenario.graph_with_spares()),
            silent: Silent::new(scenario),
            pending: Vec::new(),
            orphaned: vec![false; scenario.robots.len()],
        }
    }

    /// From that time on this is silenced by one fault more (1), or fewer (-1).
    pub(super) fn count(&mut self, t_ns: u64, silenced: Silenced, by: i32) {
        if silenced != Silenced::Nobody {
            self.pending.push((t_ns, Change::Silenced(silenced, by)));
        }
    }

    /// From that time on a robot goes by others.
    pub(super) fn rewired(&mut self, t_ns: u64, rewiring: Rewiring) {
        self.pending.push((t_ns, Change::Rewired(rewiring)));
    }

    /// Everything before this time, ns, is known: who turned what, in order of time and of robots.
    pub(super) fn settle_before(&mut self, t_ns: u64) -> Vec<Turn> {
        let mut turns = Vec::new();
        if self.pending.is_empty() {
            return turns;
        }
        self.pending.sort_by_key(|&(t_ns, ..)| t_ns);
        let known = self.pending.partition_point(|&(then_ns, ..)| then_ns < t_ns);
        let known: Vec<_> = self.pending.drain(..known).collect();
        for instant in known.chunk_by(|(a_ns, _), (b_ns, _)| a_ns == b_ns) {
            for &(_, change) in instant {
                match change {
                    Change::Silenced(silenced, by) => self.silent.count(silenced, by),
                    Change::Rewired(rewiring) => self.silent.rewire(rewiring),
                }
            }
            let cut_off = self.silent.orphaned(&self.reachability);
            for (robot, was) in self.orphaned.iter_mut().enumerate() {
                let is = cut_off.contains(&robot);
                // Of one that fell silent itself there is more to say than that.
                let told = *was != is && !self.silent.robot(robot);
                *was = is;
                if told {
                    turns.push(Turn { t_ns: instant[0].0, robot, orphaned: is });
                }
            }
        }
        turns
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

    /// r1 leads, r2 hears it, r3 hears r2.
    fn led() -> Orphans {
        let mut scenario = row_of_three();
        scenario.robots[0].role = Role::LEADER;
        let trajectory = Trajectory::Still { center_m: [0.0, 0.0] };
        scenario.lead = Some(LeadBrief { trajectory, scale: Scale::ONE, keep_heading: false });
        Orphans::new(&scenario)
    }

    fn turn(t_ns: u64, robot: usize, orphaned: bool) -> Turn {
        Turn { t_ns, robot, orphaned }
    }

    #[test]
    fn a_death_and_a_cut_orphan_those_behind_until_the_last_of_them_is_over() {
        let mut orphans = led();
        orphans.count(3, Silenced::Robot(0), 1);
        orphans.count(5, Silenced::Edge(1), 1);
        orphans.count(7, Silenced::Robot(0), -1);
        orphans.count(9, Silenced::Edge(1), -1);
        assert_eq!(orphans.settle_before(3), []);
        assert_eq!(orphans.settle_before(4), [turn(3, 1, true), turn(3, 2, true)]);
        assert_eq!(orphans.orphaned, [false, true, true]);
        assert_eq!(orphans.settle_before(9), [turn(7, 1, false)]);
        assert_eq!(orphans.settle_before(10), [turn(9, 2, false)]);
        assert_eq!(orphans.orphaned, [false; 3]);
    }

    #[test]
    fn who_dies_is_no_orphan_any_more_and_says_nothing_of_it() {
        let mut orphans = led();
        orphans.count(3, Silenced::Robot(0), 1);
        orphans.count(4, Silenced::Robot(1), 1);
        assert_eq!(orphans.settle_before(5), [turn(3, 1, true), turn(3, 2, true)]);
        assert_eq!(orphans.orphaned, [false, false, true]);
        // Its replacement has no leader either.
        orphans.count(5, Silenced::Robot(1), -1);
        assert_eq!(orphans.settle_before(6), [turn(5, 1, true)]);
    }

    #[test]
    fn of_one_instant_the_order_in_which_robots_come_back_decides_nothing() {
        for order in [[0, 1], [1, 0]] {
            let mut orphans = led();
            orphans.count(3, Silenced::Robot(0), 1);
            orphans.count(3, Silenced::Robot(1), 1);
            order.into_iter().for_each(|robot| orphans.count(5, Silenced::Robot(robot), -1));
            assert_eq!(orphans.settle_before(9), [turn(3, 2, true), turn(5, 2, false)]);
        }
    }

    #[test]
    fn a_formation_without_a_leader_has_no_orphans_but_for_contained_that_hear_nobody() {
        let mut scenario = row_of_three();
        scenario.robots[2].role = Role::CONTAINED;
        let mut orphans = Orphans::new(&scenario);
        orphans.count(3, Silenced::Robot(0), 1);
        assert_eq!(orphans.settle_before(4), []);
        orphans.count(5, Silenced::Edge(1), 1);
        assert_eq!(orphans.settle_before(6), [turn(5, 2, true)]);
    }
}
