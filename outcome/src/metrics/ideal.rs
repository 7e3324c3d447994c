//! Errors with respect to the *ideal formation*, in which every robot is in the slot that the complete planned
//! graph gives it.
//!
//! The error of `error` refers to the in-neighbors that a robot receives from; it is small if all of them are wrong
//! together. The ideal error refers to the main leader's true front point and to the equilibrium of the whole graph
//! (33), in the leader's frame: for robots that keep an offset, the offsets summed along the graph; for followers
//! (containment control), the mean of the ideal slots of their in-neighbors (51). Faults do not change this graph.
//! A leader with deputies is taken to be at m(t), because the deputies continue without it. The ideal error of the
//! main leader is its tracking error; that of a robot that goes to goals is the distance to its goal.
//!
//! Without a leader the position of the ideal formation is not defined. It is the median, along each axis, of the
//! positions that the living robots imply.

use formation::Vec2;
use formation::frame::LeaderFrame;
use formation::front_point::rotate;
use formation::laplacian::settled_positions;
use formation::ns_to_seconds;
use formation::trajectory::Trajectory;
use protocol::law::Reference;

use crate::metrics::error::nan_to_infinity;
use crate::metrics::finals::{FinalErrors, FinalWindow};
use experiment::scenario::Scenario;

/// Errors with respect to the ideal formation. Dead robots are not included.
pub(super) struct IdealErrors {
    leader: Option<usize>,
    /// Trajectory m(t), for a leader with deputies.
    leader_trajectory: Option<Trajectory>,
    /// Whether every robot goes to a goal of its own.
    has_goals: bool,
    /// Slot of each robot at heading 0 and scale 1, m, relative to the leader or, without one, to a root of the
    /// graph. Empty if the graph does not determine all slots.
    slots: Vec<Vec2>,
    /// Indices of the robots whose positions determine the formation's position, without a leader.
    anchors: Vec<usize>,
    /// Errors at the newest ground-truth sample, m.
    pub(super) current_errors_m: Vec<Option<f64>>,
    pub(super) final_errors: FinalErrors,
    /// Buffer of the positions along one axis that the living robots imply, m; reused for each sample.
    implied_positions_m: Vec<f64>,
}

impl IdealErrors {
    /// Creates the errors before the first sample. `window` selects the errors that are final.
    pub(super) fn new(scenario: &Scenario, window: FinalWindow) -> IdealErrors {
        let robots = scenario.robots.len();
        let reference_robot = scenario.leader().or_else(|| scenario.graph.roots().first().copied());
        let keeps_offset = |&i: &usize| scenario.robots[i].role.reference == Reference::Offsets;
        IdealErrors {
            leader: scenario.leader(),
            leader_trajectory: (!scenario.repair_plan.deputies.is_empty())
                .then(|| scenario.lead.as_ref().map(|lead| lead.trajectory.clone()))
                .flatten(),
            has_goals: scenario.goals_m().is_some(),
            slots: reference_robot
                .and_then(|i| settled_positions(&scenario.graph, i))
                .unwrap_or_default(),
            anchors: (0..robots).filter(keeps_offset).collect(),
            current_errors_m: vec![None; robots],
            final_errors: FinalErrors::new(robots, window),
            implied_positions_m: Vec::with_capacity(robots),
        }
    }

    /// Updates the errors with one sample. `frame` is the frame in which the formation rotates and scales;
    /// `role_errors_m` are the errors by the robots' own roles, m, of which the main leader's is its tracking error.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
        alive: &[bool],
        role_errors_m: &[Option<f64>],
    ) {
        if self.slots.is_empty() && !self.has_goals {
            return;
        }
        let origin = match self.leader {
            _ if self.has_goals => None,
            Some(leader) => Some(match &self.leader_trajectory {
                Some(trajectory) => trajectory.target_at(ns_to_seconds(t_ns)).position,
                None => alphas[leader],
            }),
            None => self.fit_reference(frame.scale, alphas, alive),
        };
        // Rotation and scaling in one step: delta R(theta_n) s is a multiplication of complex numbers.
        let rotation = rotate(frame.heading_rad, Vec2::new(frame.scale, 0.0));
        for (i, alpha) in alphas.iter().enumerate() {
            let ideal = origin.map(|origin| {
                let slot = self.slots[i];
                let rotated_slot = Vec2::new(
                    rotation.x * slot.x - rotation.y * slot.y,
                    rotation.y * slot.x + rotation.x * slot.y,
                );
                nan_to_infinity((alpha - origin - rotated_slot).norm())
            });
            let uses_own_error = self.has_goals || self.leader == Some(i);
            self.current_errors_m[i] = if uses_own_error { role_errors_m[i] } else { ideal };
            if let Some(error) = self.current_errors_m[i].filter(|_| alive[i]) {
                self.final_errors.push(t_ns, i, error);
            }
        }
    }

    /// Returns the position of the reference robot that the living robots imply, m, as the median along each axis.
    /// Returns `None` if no anchor is alive.
    fn fit_reference(&mut self, scale: f64, alphas: &[Vec2], alive: &[bool]) -> Option<Vec2> {
        let IdealErrors { slots, anchors, implied_positions_m, .. } = self;
        let mut median = |axis: usize| {
            let alive_anchors = anchors.iter().filter(|&&i| alive[i]);
            implied_positions_m.clear();
            implied_positions_m
                .extend(alive_anchors.map(|&i| alphas[i][axis] - scale * slots[i][axis]));
            let count = implied_positions_m.len();
            (count > 0).then(|| {
                let (smaller, upper, _) =
                    implied_positions_m.select_nth_unstable_by(count / 2, f64::total_cmp);
                let lower = match count % 2 {
                    0 => *smaller.iter().max_by(|a, b| a.total_cmp(b)).expect("two or more"),
                    _ => *upper,
                };
                0.5 * (lower + *upper)
            })
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
    use formation::ns_to_seconds;
    use formation::scale::Scale;
    use formation::trajectory::Trajectory;
    use protocol::brief::LeadBrief;
    use protocol::law::Role;
    use protocol::message::TruthRow;

    const ALL_ALIVE: [bool; 3] = [true; 3];
    const SECOND_NS: u64 = 1_000_000_000;

    /// Returns the row of three, led by r1 on this trajectory.
    fn row_with_leader(trajectory: Trajectory, scale: Scale) -> Scenario {
        let mut scenario = row_of_three();
        scenario.robots[0].role = Role::LEADER;
        scenario.lead = Some(LeadBrief { trajectory, scale, keep_heading: false });
        scenario
    }

    fn row_with_resting_leader() -> Scenario {
        row_with_leader(Trajectory::Still { center_m: [0.0, 0.0] }, Scale::CONSTANT_ONE)
    }

    /// The ideal errors and their frame, for tests.
    struct IdealErrorFixture {
        frame: IdealFrame,
        ideal: IdealErrors,
    }

    impl IdealErrorFixture {
        fn new(scenario: &Scenario) -> IdealErrorFixture {
            IdealErrorFixture {
                frame: IdealFrame::new(scenario),
                ideal: IdealErrors::new(scenario, FinalWindow::FromTime(0)),
            }
        }

        fn errors(&mut self, t_ns: u64, rows: &[TruthRow], alive: &[bool]) -> Vec<Option<f64>> {
            let frame = self.frame.add_truth(t_ns, rows, alive);
            let alphas: Vec<Vec2> = rows.iter().map(|row| front_point(row.pose(), 0.1)).collect();
            let role_errors_m = vec![Some(0.5); rows.len()];
            self.ideal.add_truth(t_ns, &frame, &alphas, alive, &role_errors_m);
            self.ideal.current_errors_m.to_vec()
        }
    }

    fn assert_close(found: &[Option<f64>], expected: &[f64]) {
        let close = |(found, expected): (&Option<f64>, &f64)| {
            found.is_some_and(|found| (found - expected).abs() < 1e-9)
        };
        assert!(found.iter().zip(expected).all(close), "{found:?}, expected {expected:?}");
    }

    #[test]
    fn contained_robot_slot_is_the_mean_of_in_neighbor_slots() {
        let mut scenario = row_with_resting_leader();
        scenario.robots[2].role = Role::CONTAINED;
        let edge = |from, to, x| Edge { from, to, offset_m: Vec2::new(x, 0.0) };
        let edges = vec![edge(0, 1, -1.0), edge(0, 2, 0.0), edge(1, 2, 0.0)];
        scenario.graph = FormationGraph::new(3, edges);
        // r2 is dead and far from its slot; that must not move any slot.
        let mut fixture = IdealErrorFixture::new(&scenario);
        let found = fixture.errors(0, &rows([0.0, -4.0, -0.75]), &[true, false, true]);
        assert_close(&found, &[0.5, 3.0, 0.25]);
        assert_eq!(
            fixture.ideal.final_errors.errors_by_robot_m(u64::MAX)[1],
            None,
            "dead robots have no final error"
        );
    }

    #[test]
    fn leaderless_reference_ignores_one_straggler() {
        let mut fixture = IdealErrorFixture::new(&row_of_three());
        assert_close(&fixture.errors(0, &rows([7.0, 6.0, 5.0]), &ALL_ALIVE), &[0.0, 0.0, 0.0]);
        assert_close(&fixture.errors(0, &rows([7.0, 6.0, 1.0]), &ALL_ALIVE), &[0.0, 0.0, 4.0]);
        // With two robots the median cannot tell which one is right.
        let two = [false, true, true];
        assert_close(&fixture.errors(0, &rows([7.0, 6.0, 1.0]), &two), &[2.0, 2.0, 2.0]);
        assert_eq!(fixture.errors(0, &rows([7.0, 6.0, 5.0]), &[false; 3]), [None; 3]);
    }

    #[test]
    fn slot_that_is_nan_has_infinite_error() {
        let mut fixture = IdealErrorFixture::new(&row_with_resting_leader());
        let found = fixture.errors(0, &rows([0.0, f64::NAN, -2.0]), &ALL_ALIVE);
        assert_eq!(found[1], Some(f64::INFINITY));
    }

    #[test]
    fn leader_turn_rotates_all_slots_despite_lost_samples() {
        let circle = Trajectory::Circle { center_m: [0.0, 0.0], radius_m: 2.0, period_s: 20.0 };
        let mut scenario = row_with_leader(
            circle.clone(),
            Scale::Sine { mean: 2.0, amplitude: 0.0, period_s: 1.0 },
        );
        scenario.period_ns = SECOND_NS / 1000;
        // On a circle in steady state, the vehicle has a fixed angle to the velocity that draws it: sin psi = ell w
        // / u = ell / r.
        let rows_at = |t_s: f64| {
            let (leader_position, velocity) =
                (circle.target_at(t_s).position, circle.target_at(t_s).velocity);
            let heading_rad = velocity.y.atan2(velocity.x) - (0.1f64 / 2.0).asin();
            let position_of = |s: Vec2| leader_position + 2.0 * rotate(heading_rad, s);
            let mut truth = rows([0.0; 3]);
            for (i, row) in truth.iter_mut().enumerate() {
                let alpha = position_of(Vec2::new(-(i as f64), 0.0));
                let middle = alpha - rotate(heading_rad, Vec2::new(0.1, 0.0));
                (row.x_m, row.y_m, row.heading_rad) = (middle.x, middle.y, heading_rad);
            }
            truth
        };
        let mut fixture = IdealErrorFixture::new(&scenario);
        // After 1000 ticks, 5 s of samples are lost.
        let ticks = (0..=1000).chain([6000]);
        for tick in ticks {
            let t_ns = tick * scenario.period_ns;
            let found = fixture.errors(t_ns, &rows_at(ns_to_seconds(t_ns)), &ALL_ALIVE);
            assert!(found.iter().skip(1).all(|e| e.is_some_and(|e| e < 1e-5)), "{tick}: {found:?}");
        }
    }
}
