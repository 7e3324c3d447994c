//! Whom the death of robots and the cut of edges break, and why: theory, before anything moves.
//!
//! The one function behind `phalanx check` and every fault of a report. A robot is *broken* if it
//! ends farther than a bound from its place in the formation as planned. What is measured is
//! measured elsewhere, by other code from the same definition (`metrics`).
//!
//! | file | question it answers |
//! |---|---|
//! | `reduced` | whom does everybody still go by, who stops, and whom does the leader reach? |
//! | `course` | does the formation still move, and how fast? |
//! | `cuts` | which single cuts change nothing? |
//! | `crowd` | who stands where somebody else wants to be? (Remark 1) |
//! | `broken` | how is it said: who, why, by how much? |
//!
//! Assumed is a formation that has settled when the fault strikes, and a fault that stays. Places
//! are compared in the leader's frame (without a leader, in `map`). A formation that moves leaves
//! behind whoever stops; in one that stands nobody who stops is off.

mod broken;
mod course;
mod crowd;
mod cuts;
mod reduced;
#[cfg(test)]
mod tests;

use formation::Vec2;
use formation::graph::Edge;
use formation::laplacian::settle;
use protocol::brief::{REPAIR_SPEED_FACTOR, Rank, SilencePolicy};
use protocol::law::Reference;

pub use broken::{Broken, BrokenRobot, Cause, broken_means, lines};
use course::Course;
use crowd::Crowd;
pub use cuts::SingleCuts;
use reduced::Reduced;

use crate::scenario::{Scenario, Substitutes, Succession};
use formation::{portable_math, seconds};

/// What theory needs to know of a scenario to foretell what its deaths and cuts break.
#[derive(Debug, Clone)]
pub struct Predictor {
    robots: Vec<Facts>,
    /// For each robot, whom it hears: the edge's place in the graph, who, and c_ji, m.
    heard: Vec<Vec<Ear>>,
    /// For each robot its spares for anybody, in order: who, and at which offset, m.
    spares: Vec<Vec<(usize, Vec2)>>,
    /// For each deputy of a secondary leader, by whom it keeps the place that it takes, and at which offset, m.
    for_place: Vec<Vec<(usize, Vec2)>>,
    /// Who takes the places of secondary leaders, the best rank first.
    successions: Vec<Succession>,
    /// By whom contained robots go in place of each that they may lose, if that is planned.
    substitutes: Vec<Substitutes>,
    /// The main leader.
    leader: Option<usize>,
    /// Who leads in its place, the best rank first.
    deputies: Vec<usize>,
    /// Where each robot belongs: places as planned, at scale 1 and heading 0, m.
    planned: Vec<Vec2>,
    /// How the main leader goes, if there is one.
    course: Option<Course>,
    /// How far into its future a dead robot is believed, s: until it is lost, and its last beacon is
    /// two periods old when it dies.
    believed_s: f64,
    /// For how long a robot that has lost everybody waits for a spare, s.
    repair_after_s: f64,
    /// d, m.
    distance_min_m: f64,
    /// Usual and smallest scale.
    scale: [f64; 2],
    /// Farther off its place than this a robot is broken, m.
    bound_m: f64,
}

/// One robot.
#[derive(Debug, Clone, Copy)]
struct Facts {
    reference: Reference,
    silence: SilencePolicy,
    /// Nearer to another than this it does not come to rest, m. (Remark 1)
    stands_off_m: f64,
    /// Whether it stands off where its place is taken.
    gives_way: bool,
    /// k of a law whose correction is k tanh, m/s.
    gain_m_s: Option<f64>,
    /// By what share of how far its place is within that distance it then stays farther away.
    aside: f64,
}

/// An edge, as the robot has it that hears.
#[derive(Debug, Clone, Copy)]
struct Ear {
    edge: usize,
    from: usize,
    offset_m: Vec2,
}

impl Predictor {
    /// Of a scenario, with its `converged_error_m` as the bound.
    pub fn of(scenario: &Scenario) -> Predictor {
        let facts = |i: usize| Facts {
            reference: scenario.robots[i].role.reference,
            silence: scenario.silence.policy,
            stands_off_m: scenario.steers_within_m(i).unwrap_or(0.0),
            gives_way: scenario.rank(i) == Rank::Contained,
            gain_m_s: scenario.robots[i].correction_max_m_s,
            aside: scenario.method.aside,
        };
        let n = scenario.robots.len();
        let mut heard = vec![Vec::new(); n];
        for (edge, ends) in scenario.graph.edges().iter().enumerate() {
            heard[ends.to].push(Ear { edge, from: ends.from, offset_m: ends.offset_m });
        }
        let spares_of = |i: usize, are: &dyn Fn(&Edge) -> bool| {
            let spares = scenario.spares.iter().filter(|edge| edge.to == i && are(edge));
            spares.map(|edge| (edge.from, edge.offset_m)).collect()
        };
        let for_anybody = |edge: &Edge| scenario.is_for_anybody(edge);
        let for_place = |edge: &Edge| scenario.is_for_place(edge);
        let mut predictor = Predictor {
            robots: (0..n).map(facts).collect(),
            heard,
            spares: (0..n).map(|i| spares_of(i, &for_anybody)).collect(),
            for_place: (0..n).map(|i| spares_of(i, &for_place)).collect(),
            successions: scenario.successions.clone(),
            substitutes: scenario.substitutes.clone(),
            leader: scenario.leader(),
            deputies: scenario.deputies.clone(),
            planned: scenario.goals_m().unwrap_or_else(|| vec![Vec2::zeros(); n]),
            course: Course::of(scenario),
            believed_s: seconds(scenario.silence.lost_after_ns) - 2.0 * seconds(scenario.period_ns),
            repair_after_s: seconds(scenario.repair_after_ns.unwrap_or(0)),
            distance_min_m: scenario.avoidance.distance_min_m,
            scale: scenario.scale().map_or([1.0; 2], |scale| [scale.usual(), scale.range()[0]]),
            bound_m: scenario.expect.converged_error_m,
        };
        let whole = Reduced::of(&predictor, &[], &[], false);
        let mut places = whole.places(&predictor.planned);
        let (free, _) = whole.free(&predictor);
        // Singular only where somebody is reached by nobody, and that is an error of the scenario.
        if settle(&whole.heard, &free, &mut places).is_some() {
            predictor.planned = places[..n].to_vec();
        }
        predictor
    }

    /// The same with another bound, m.
    pub fn with_bound(self, bound_m: f64) -> Predictor {
        Predictor { bound_m, ..self }
    }

    /// Farther off its place than this, m, a robot is broken.
    pub fn bound_m(&self) -> f64 {
        self.bound_m
    }

    /// Whom of the living it breaks, by their places and in order, that from `t_s` on (at any time
    /// without one) the robots `dead` are dead or frozen and the edges `cut` carry nothing.
    pub fn broken(&self, dead: &[usize], cut: &[usize], t_s: Option<f64>) -> Vec<Broken> {
        let moving = self.course.as_ref().is_some_and(|course| course.moves(t_s));
        let mut reduced = Reduced::of(self, dead, cut, moving);
        // About a dead leader all stand, if no deputy leads.
        let unled = self.leader.is_some() && !reduced.leads.contains(&true);
        reduced.moving &= !unled;
        let mut causes = reduced.left_behind(self);
        let places = self.settled(&reduced, &causes);
        let crowd = Crowd::of(self, &reduced, &places, &causes);
        for (i, cause) in crowd.causes(self, &reduced).into_iter().enumerate() {
            if let Some((cause, off_m)) = cause {
                let outside_m = crowd.outside_m(self, &reduced, i);
                causes[i] = Some(Broken { robot: i, cause, off_m: Some(off_m), outside_m });
            }
        }
        if moving && unled {
            self.run_on(&mut causes, &reduced, t_s);
        }
        causes.into_iter().flatten().collect()
    }

    /// When, s after these deaths, contained robots are within the bound of the places that they then have, if any of
    /// those that heard the dead has another one: e' = -k tanh(h e) from there, once the dead are given up. Whoever
    /// heard none of them stays amid those that it hears meanwhile, and is no farther off than they.
    pub fn settles_after_s(&self, dead: &[usize]) -> Option<f64> {
        let reduced = Reduced::of(self, dead, &[], false);
        let places = self.settled(&reduced, &vec![None; self.robots.len()]);
        let slow_s = |i: usize| {
            let moved_m = self.scale[0] * (places[i] - self.planned[i]).norm();
            let contained = reduced.alive[i] && self.robots[i].reference == Reference::Middle;
            let moves = contained && reduced.lost[i].is_some() && moved_m > self.bound_m;
            let k = self.robots[i].gain_m_s.filter(|_| moves)?;
            let planned = self.substitutes.iter().any(|planned| planned.robot == i);
            let hears = |leader: usize| self.heard[i].iter().any(|ear| ear.from == leader);
            let has_deputies = self.successions.iter().any(|one| hears(one.leader));
            let repaired = planned || has_deputies || !self.spares[i].is_empty();
            let h = if repaired { REPAIR_SPEED_FACTOR } else { 1.0 };
            let sinh = |x: f64| (portable_math::exp(x) - portable_math::exp(-x)) / 2.0;
            Some(portable_math::ln(sinh(h * moved_m) / sinh(h * self.bound_m)) / (h * k))
        };
        let slowest_s = (0..self.robots.len()).filter_map(slow_s).reduce(f64::max)?;
        Some(self.believed_s + self.repair_after_s + slowest_s)
    }

    /// By how much somebody who keeps a place is off at most, m, once these robots, of whom one led, die at `t_s` (at
    /// any time without one), and a deputy leads; `None`: none does. Whom no leader reaches
    /// but over spares stands until these are opened; and who comes by where a dead leader stands keeps d from it.
    pub fn peak_m(&self, dead: &[usize], t_s: Option<f64>) -> Option<f64> {
        let leader = self.leader.filter(|leader| dead.contains(leader))?;
        let course = self.course.as_ref().filter(|_| !self.deputies.is_empty())?;
        let spares = vec![Vec::new(); self.robots.len()];
        let reduced = Reduced::of(&Predictor { spares, ..self.clone() }, dead, &[], true);
        let leading: Vec<usize> = (0..self.robots.len()).filter(|&i| reduced.leads[i]).collect();
        if leading.is_empty() {
            return None;
        }
        let led = reduced.downstream(&leading);
        let mut peak_m = 0.0f64;
        let keeps_place = |&i: &usize| self.robots[i].reference == Reference::Offsets;
        for i in (0..self.robots.len()).filter(keeps_place).filter(|i| reduced.alive[*i]) {
            let seen_from_leader = self.planned[i] - self.planned[leader];
            if !led[i] {
                let stands_m = course.speed_m_s(seen_from_leader, t_s) * self.repair_after_s;
                peak_m = peak_m.max(stands_m);
            }
            if let Some(t_s) = t_s {
                peak_m = peak_m.max(self.distance_min_m - course.nears_m(seen_from_leader, t_s));
            }
        }
        Some(peak_m)
    }

    /// Who has gone on until the leader was given up, with the speed of its place, for too far.
    fn run_on(&self, causes: &mut [Option<Broken>], reduced: &Reduced, t_s: Option<f64>) {
        let (Some(course), Some(leader)) = (&self.course, self.leader) else { return };
        for robot in (0..self.robots.len()).filter(|&i| reduced.alive[i]) {
            let ran_m = course.speed_m_s(self.planned[robot], t_s) * self.believed_s;
            if ran_m > self.bound_m && !self.robots[robot].reference.is_local() {
                let other = causes[robot];
                let off_m = other.and_then(|other| other.off_m).unwrap_or(0.0).max(ran_m);
                let outside_m = other.and_then(|other| other.outside_m);
                let cause = Cause::LeaderDead { leader };
                causes[robot] = Some(Broken { robot, cause, off_m: Some(off_m), outside_m });
            }
        }
    }

    /// The place as planned of a robot, or of where it was lost, m.
    fn place_of(&self, i: usize) -> Vec2 {
        self.planned[i % self.robots.len()]
    }

    /// Returns whether these robots, and where others were lost, ask robot `i` to be in its place as planned.
    fn asks_for_its_place(&self, heard: &[(usize, Vec2)], i: usize) -> bool {
        let asked: Vec2 = heard.iter().map(|&(from, offset)| self.place_of(from) + offset).sum();
        // A mean that is no number asks for nothing else.
        let off_m = (asked / heard.len() as f64 - self.planned[i]).norm();
        off_m <= 1e-9 || off_m.is_nan()
    }

    /// Returns the predictions of all single cuts.
    pub fn single_cuts(&self) -> SingleCuts<'_> {
        SingleCuts::new(self)
    }

    /// Where those settle that are not left behind.
    fn settled(&self, reduced: &Reduced, behind: &[Option<Broken>]) -> Vec<Vec2> {
        let mut places = reduced.places(&self.planned);
        let (free, adrift) = reduced.free(self);
        let off = |&i: &usize| !self.asks_for_its_place(&reduced.heard[i], i);
        let free: Vec<usize> = free.into_iter().filter(|&i| behind[i].is_none()).collect();
        // Whoever hears only robots that stay where they were stays as well.
        let moved: Vec<usize> = free.iter().copied().filter(off).collect();
        let moved = reduced.downstream(&moved);
        let free: Vec<usize> = free.into_iter().filter(|&i| moved[i]).collect();
        if settle(&reduced.heard, &free, &mut places).is_none() {
            return places;
        }
        // A group that hears nobody outside keeps its middle.
        for group in adrift {
            let shift: Vec2 = group.iter().map(|&i| self.planned[i] - places[i]).sum();
            let shift = shift / group.len() as f64;
            if shift.norm() > 1e-9 {
                let with = reduced.downstream(&group);
                (0..self.robots.len()).filter(|&i| with[i]).for_each(|i| places[i] += shift);
            }
        }
        places
    }
}
