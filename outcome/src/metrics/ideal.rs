//! How far each robot is from its place in the *ideal formation*: the place that it would have if
//! everybody it depends on stood where the whole graph, as planned, wants it.
//!
//! The error of `error` is measured against those a robot hears: it is small where all are wrong
//! together. This one is measured against the main leader's true front point and the places that the
//! whole graph settles in (33), in the leader's frame: of those that keep a place, the offsets
//! summed along the graph; of the contained, the middle of the ideal places of those they hear (51).
//! No fault changes the graph in here. A leader with deputies is taken to be where m(t) is: they go on
//! without it. The main leader's own error is its tracking error; that of those that go to goals is the
//! distance to the goal.
//!
//! Without a leader nobody says where the formation is. It is put where most of the living are: at
//! the median, along each axis, of where each of them would have it.

use formation::Vec2;
use formation::frame::LeaderFrame;
use formation::front_point::rotate;
use formation::laplacian::settled;
use formation::seconds;
use formation::trajectory::Trajectory;
use protocol::law::Reference;

use crate::metrics::error::or_infinite;
use crate::metrics::finals::{Finals, Window};
use experiment::scenario::Scenario;

/// The errors to the ideal formation so far. Those of the dead count for nothing.
pub(super) struct Ideal {
    leader: Option<usize>,
    /// m(t), of a leader with deputies.
    course: Option<Trajectory>,
    /// Everybody goes to a goal of its own.
    to_goals: bool,
    /// Of each robot at heading 0 and scale 1, m, seen from the leader, or without one from some
    /// robot; empty where the graph gives no place to everybody.
    places: Vec<Vec2>,
    /// Without a leader: who says where the formation is.
    anchors: Vec<usize>,
    /// At the newest truth.
    pub(super) now_m: Vec<Option<f64>>,
    pub(super) finals: Finals,
    /// Where the living would have the formation, along one axis, m; kept for the next truth.
    votes: Vec<f64>,
}

impl Ideal {
    /// Nothing measured yet. `window`: which errors are final.
    pub(super) fn new(scenario: &Scenario, window: Window) -> Ideal {
        let robots = scenario.robots.len();
        let pinned = scenario.leader().or_else(|| scenario.graph.roots().first().copied());
        let keeps_place = |&i: &usize| scenario.robots[i].role.reference == Reference::Offsets;
        Ideal {
            leader: scenario.leader(),
            course: (!scenario.deputies.is_empty())
                .then(|| scenario.lead.as_ref().map(|lead| lead.trajectory.clone()))
                .flatten(),
            to_goals: scenario.goals_m().is_some(),
            places: pinned.and_then(|i| settled(&scenario.graph, i)).unwrap_or_default(),
            anchors: (0..robots).filter(keeps_place).collect(),
            now_m: vec![None; robots],
            finals: Finals::new(robots, window),
            votes: Vec::with_capacity(robots),
        }
    }

    /// Takes in where everybody is now, and the frame that the formation turns and grows with. `own_m`: the errors by the robots' own roles, of which the
    /// main leader's is its tracking error.
    pub(super) fn truth(
        &mut self,
        t_ns: u64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
        alive: &[bool],
        own_m: &[Option<f64>],
    ) {
        if self.places.is_empty() && !self.to_goals {
            return;
        }
        let origin = match self.leader {
            _ if self.to_goals => None,
            Some(leader) => Some(match &self.course {
                Some(course) => course.target_at(seconds(t_ns)).position,
                None => alphas[leader],
            }),
            None => self.fitted(frame.scale, alphas, alive),
        };
        // Turned and grown at once: delta R(theta_n) s is a multiplication of complex numbers.
        let turn = rotate(frame.heading_rad, Vec2::new(frame.scale, 0.0));
        for (i, alpha) in alphas.iter().enumerate() {
            let ideal = origin.map(|origin| {
                let place = self.places[i];
                let turned = Vec2::new(
                    turn.x * place.x - turn.y * place.y,
                    turn.y * place.x + turn.x * place.y,
                );
                or_infinite((alpha - origin - turned).norm())
            });
            let own = self.to_goals || self.leader == Some(i);
            self.now_m[i] = if own { own_m[i] } else { ideal };
            if let Some(error) = self.now_m[i].filter(|_| alive[i]) {
                self.finals.take(t_ns, i, error);
            }
        }
    }

    /// Where the living would have the robot from which the places are seen, m, if anybody lives.
    fn fitted(&mut self, scale: f64, alphas: &[Vec2], alive: &[bool]) -> Option<Vec2> {
        let Ideal { places, anchors, votes, .. } = self;
        let mut median = |axis: usize| {
            let living = anchors.iter().filter(|&&i| alive[i]);
            votes.clear();
            votes.extend(living.map(|&i| alphas[i][axis] - scale * places[i][axis]));
            votes.sort_unstable_by(f64::total_cmp);
            let count = votes.len();
            (count > 0).then(|| 0.5 * (votes[(count - 1) / 2] + votes[count / 2]))
        };
        Some(Vec2::new(median(0)?, median(1)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::examples::rows;
    use crate::metrics::frame::IdealFrame;
    use experiment::examples::row_of_three;
    use formation::front_point::front_point;
    use formation::graph::{Edge, FormationGraph};
    use formation::scale::Scale;
    use formation::seconds;
    use formation::trajectory::Trajectory;
    use protocol::brief::LeadBrief;
    use protocol::law::Role;
    use protocol::message::TruthRow;

    const ALL: [bool; 3] = [true; 3];
    const SECOND_NS: u64 = 1_000_000_000;

    /// The row, led by r1 on this trajectory.
    fn led(trajectory: Trajectory, scale: Scale) -> Scenario {
        let mut scenario = row_of_three();
        scenario.robots[0].role = Role::LEADER;
        scenario.lead = Some(LeadBrief { trajectory, scale, keep_heading: false });
        scenario
    }

    fn still() -> Scenario {
        led(Trajectory::Still { center_m: [0.0, 0.0] }, Scale::ONE)
    }

    /// The ideal formation and its frame.
    struct Planned {
        frame: IdealFrame,
        ideal: Ideal,
    }

    impl Planned {
        fn new(scenario: &Scenario) -> Planned {
            Planned {
                frame: IdealFrame::new(scenario),
                ideal: Ideal::new(scenario, Window::From(0)),
            }
        }

        fn errors(&mut self, t_ns: u64, rows: &[TruthRow], alive: &[bool]) -> Vec<Option<f64>> {
            let frame = self.frame.truth(t_ns, rows, alive);
            let alphas: Vec<Vec2> = rows.iter().map(|row| front_point(row.pose(), 0.1)).collect();
            let own_m = vec![Some(0.5); rows.len()];
            self.ideal.truth(t_ns, &frame, &alphas, alive, &own_m);
            self.ideal.now_m.to_vec()
        }
    }

    fn are(found: &[Option<f64>], expected: &[f64]) {
        let close = |(found, expected): (&Option<f64>, &f64)| {
            found.is_some_and(|found| (found - expected).abs() < 1e-9)
        };
        assert!(found.iter().zip(expected).all(close), "{found:?}, expected {expected:?}");
    }

    #[test]
    fn the_contained_belong_in_the_middle_of_the_places_of_those_they_hear() {
        let mut scenario = still();
        scenario.robots[2].role = Role::CONTAINED;
        let edge = |from, to, x| Edge { from, to, offset_m: Vec2::new(x, 0.0) };
        let edges = vec![edge(0, 1, -1.0), edge(0, 2, 0.0), edge(1, 2, 0.0)];
        scenario.graph = FormationGraph::new(3, edges);
        // r2 is dead, far away from its place: that moves no place of anybody.
        let mut planned = Planned::new(&scenario);
        let found = planned.errors(0, &rows([0.0, -4.0, -0.75]), &[true, false, true]);
        are(&found, &[0.5, 3.0, 0.25]);
        assert_eq!(
            planned.ideal.finals.by_robot_m(u64::MAX)[1],
            None,
            "the dead count for nothing"
        );
    }

    #[test]
    fn without_a_leader_one_straggler_is_off_and_does_not_move_all() {
        let mut planned = Planned::new(&row_of_three());
        are(&planned.errors(0, &rows([7.0, 6.0, 5.0]), &ALL), &[0.0, 0.0, 0.0]);
        are(&planned.errors(0, &rows([7.0, 6.0, 1.0]), &ALL), &[0.0, 0.0, 4.0]);
        // Of two, nobody can say who is right.
        let two = [false, true, true];
        are(&planned.errors(0, &rows([7.0, 6.0, 1.0]), &two), &[2.0, 2.0, 2.0]);
        assert_eq!(planned.errors(0, &rows([7.0, 6.0, 5.0]), &[false; 3]), [None; 3]);
    }

    #[test]
    fn a_place_that_is_no_number_is_infinitely_far_away() {
        let mut planned = Planned::new(&still());
        let found = planned.errors(0, &rows([0.0, f64::NAN, -2.0]), &ALL);
        assert_eq!(found[1], Some(f64::INFINITY));
    }

    #[test]
    fn the_leaders_own_way_turns_all_places_as_it_turns_the_leader_however_many_truths_are_lost() {
        let circle = Trajectory::Circle { center_m: [0.0, 0.0], radius_m: 2.0, period_s: 20.0 };
        let mut scenario =
            led(circle.clone(), Scale::Sine { mean: 2.0, amplitude: 0.0, period_s: 1.0 });
        scenario.period_ns = SECOND_NS / 1000;
        // Settled on a circle, the vehicle stands at a fixed angle to the velocity that draws it:
        // sin psi = ell w / u = ell / r.
        let at = |t_s: f64| {
            let (place, velocity) =
                (circle.target_at(t_s).position, circle.target_at(t_s).velocity);
            let heading_rad = velocity.y.atan2(velocity.x) - (0.1f64 / 2.0).asin();
            let place_of = |s: Vec2| place + 2.0 * rotate(heading_rad, s);
            let mut truth = rows([0.0; 3]);
            for (i, row) in truth.iter_mut().enumerate() {
                let alpha = place_of(Vec2::new(-(i as f64), 0.0));
                let middle = alpha - rotate(heading_rad, Vec2::new(0.1, 0.0));
                (row.x_m, row.y_m, row.heading_rad) = (middle.x, middle.y, heading_rad);
            }
            truth
        };
        let mut planned = Planned::new(&scenario);
        // Then 5 s are lost.
        let ticks = (0..=1000).chain([6000]);
        for tick in ticks {
            let t_ns = tick * scenario.period_ns;
            let found = planned.errors(t_ns, &at(seconds(t_ns)), &ALL);
            assert!(found.iter().skip(1).all(|e| e.is_some_and(|e| e < 1e-5)), "{tick}: {found:?}");
        }
    }
}
