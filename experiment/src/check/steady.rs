//! Where the robots settle, and how fast they must go to stay there.
//!
//! Once all errors are gone, alpha = (A^-1 tensor I) C(t): every robot stands at a fixed place in
//! the leader's frame, and all places turn and grow with it. (20)-(23) (30) (33)
//!
//! Errors go with feed-forward laws. One without lags behind a moving leader, by more the slower
//! it is; that is not told here.

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::desired::Target;
use formation::frame::LeaderFrame;
use formation::front_point::{drawing_velocity, drawn_heading, front_speed, twist_for};
use formation::laplacian::settled;
use formation::obstacle::Obstacles;
use formation::portable_math;
use formation::pose::Twist;
use formation::scale::Scale;
use serde::Serialize;

use crate::scenario::{Robot, Scenario};
use formation::seconds;

/// Steps of all robots together: a second of work at most.
const STEPS_MAX: usize = 1 << 22;
/// A step is at least this long, s: the shipped trajectories turn by less than 1 mrad in it.
const STEP_S_MIN: f64 = 2e-3;
/// A step is at most this long, s. What would take more of them than there may be is cut short.
const STEP_S_MAX: f64 = 1e-2;

/// A transient that makes nobody faster than this times its settled peak is none.
const FASTER: f64 = 1.001;

/// The shape that the robots settle in.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settled {
    /// Places at scale 1 and heading 0, seen from the leader (without one, from the first root), m;
    /// goals in `map`.
    pub places: Vec<Vec2>,
    /// Smallest and largest scale.
    pub scale: [f64; 2],
    /// The two nearest to each other at the smallest scale.
    pub closest: Option<ClosestPair>,
}

impl Settled {
    /// Of a scenario without errors, whose robots have goals or all are reached from a common one.
    pub fn of(scenario: &Scenario) -> Settled {
        let places =
            places(scenario).expect("a sound scenario has goals, or a root that reaches all");
        let scale = scenario.scale().map_or([1.0; 2], Scale::range);
        let smallest: Vec<Vec2> = places.iter().map(|place| scale[0] * place).collect();
        Settled { closest: closest_pair(&smallest), places, scale }
    }
}

/// Where everybody settles at scale 1 and heading 0, seen from the leader (without one, from the
/// first root), or goes, m; `None` where that does not follow from the graph.
pub(crate) fn places(scenario: &Scenario) -> Option<Vec<Vec2>> {
    let pinned = || scenario.leader().or_else(|| scenario.graph.roots().first().copied());
    scenario.goals_m().or_else(|| settled(&scenario.graph, pinned()?))
}

/// The fastest that one robot must go to stay in its place.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Peak {
    /// |alpha'|, m/s: what the speed limit bounds.
    pub front_speed_m_s: f64,
    /// |v|, m/s.
    pub v_m_s: f64,
    /// |w|, rad/s.
    pub w_rad_s: f64,
    /// |v| + track |w| / 2, m/s, of the faster wheel's rim, if the track is known.
    pub rim_speed_m_s: Option<f64>,
}

/// How leader and formation move once all errors are gone.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Motion {
    /// Looked at from 0 to this time, s: the run, or as much of it as is quickly done.
    pub horizon_s: f64,
    /// eta_m: bound on |m'|, m/s.
    pub trajectory_speed_m_s: f64,
    /// eta_c: bound on |C'_ji| over all edges with an offset, m/s.
    pub offset_rate_m_s: f64,
    /// Of each robot once all have settled.
    pub peaks: Vec<Peak>,
    /// When each robot is fastest, s since the start: its front point, and a wheel's rim.
    peaks_at_s: Vec<[f64; 2]>,
    /// How near each robot's place comes to a wall, if there is one.
    pub passages: Vec<Option<Passage>>,
    /// Where the leader starts with another heading than its path has, and that makes somebody
    /// faster.
    pub transient: Option<Transient>,
}

/// The smallest distance of a place from a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Passage {
    /// m.
    pub distance_m: f64,
    /// When, s since the start.
    pub t_s: f64,
    /// The convex part, by its place in the scenario.
    pub wall: usize,
}

/// What the leader's heading at the start asks of the others until it has turned.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Transient {
    /// The heading of the leader's path at the start, rad: starting with it, there is no transient.
    pub tangent_rad: f64,
    /// Of each robot from the start on.
    pub peaks: Vec<Peak>,
    /// When each robot is fastest, s since the start: its front point, and a wheel's rim.
    pub peaks_at_s: Vec<[f64; 2]>,
}

impl Motion {
    /// `None` without a leader: then all stand still in the end.
    ///
    /// The leader's front point is on m(t) from the start. Its heading starts as it does in the
    /// scenario; what that alone asks of the others is told apart. The others start with the
    /// heading they are drawn to.
    pub fn of(scenario: &Scenario, settled: &Settled) -> Option<Motion> {
        let (leader, lead) = (scenario.leader()?, scenario.lead.as_ref()?);
        let start_rad = scenario.robots[leader].start.heading_rad;
        let given = Motion::from(start_rad, scenario, settled)?;
        // A path that begins at rest has its heading a little later.
        let begun =
            (0..=100).map(|step| lead.trajectory.target_at(f64::from(step) * STEP_S_MIN).velocity);
        let Some(tangent_rad) = begun.into_iter().find_map(heading_of) else { return Some(given) };
        let along = Motion::from(tangent_rad, scenario, settled)?;
        let faster = |(given, along): (&Peak, &Peak)| {
            given.front_speed_m_s > FASTER * along.front_speed_m_s
                || given.rim_speed_m_s > along.rim_speed_m_s.map(|rim_m_s| FASTER * rim_m_s)
        };
        if !given.peaks.iter().zip(&along.peaks).any(faster) {
            return Some(given);
        }
        let Motion { peaks, peaks_at_s, .. } = given;
        Some(Motion {
            peaks: along.peaks,
            peaks_at_s: along.peaks_at_s,
            passages: along.passages,
            transient: Some(Transient { tangent_rad, peaks, peaks_at_s }),
            ..given
        })
    }

    /// The motion whose leader starts with that heading.
    fn from(leader_rad: f64, scenario: &Scenario, settled: &Settled) -> Option<Motion> {
        let leader = scenario.leader()?;
        let robots = &scenario.robots;
        let steps_max = (STEPS_MAX / robots.len()) as f64;
        let duration_s = seconds(scenario.duration_ns);
        let step_s = (duration_s / steps_max).clamp(STEP_S_MIN, STEP_S_MAX).min(duration_s);
        let steps = (duration_s / step_s).ceil().min(steps_max) as usize;
        let offset_m =
            scenario.formation_edges().map(|(_, edge)| edge.offset_m.norm()).fold(0.0, f64::max);

        let mut motion = Motion {
            horizon_s: (steps as f64 * step_s).min(duration_s),
            trajectory_speed_m_s: 0.0,
            offset_rate_m_s: 0.0,
            peaks: vec![Peak::default(); robots.len()],
            peaks_at_s: vec![[0.0; 2]; robots.len()],
            passages: vec![None; robots.len()],
            transient: None,
        };
        let walls = scenario.obstacles();
        // Where each place was when its distance from all walls was looked at last, m.
        let mut looked = vec![(Vec2::zeros(), 0.0); robots.len()];
        let mut headings_rad: Vec<f64> = robots.iter().map(|r| r.start.heading_rad).collect();
        let mut before: Option<Vec<Vec2>> = None;
        for (t_s, target, frame) in leader_course(scenario, leader_rad, step_s, steps)? {
            headings_rad[leader] = frame.heading_rad;
            if !walls.is_empty() {
                let places = settled.places.iter();
                let places = places.map(|&place| target.position + frame.offset(place).position);
                motion.pass(&walls, places, t_s, &mut looked);
            }
            let places = settled.places.iter();
            let velocities: Vec<Vec2> =
                places.map(|&place| target.velocity + frame.offset(place).velocity).collect();
            for (i, robot) in robots.iter().enumerate() {
                if i != leader {
                    headings_rad[i] = match &before {
                        None => heading_of(velocities[i]).unwrap_or(headings_rad[i]),
                        Some(before) => {
                            let between = 0.5 * (before[i] + velocities[i]);
                            drawn_heading(headings_rad[i], robot.front_point_m, between, step_s)
                        }
                    };
                }
                let twist = twist_for(headings_rad[i], robot.front_point_m, velocities[i]);
                let peaks_at_s = &mut motion.peaks_at_s[i];
                motion.peaks[i].raise(peaks_at_s, robot, twist, t_s);
            }
            motion.trajectory_speed_m_s = motion.trajectory_speed_m_s.max(target.velocity.norm());
            let longest = frame.offset(Vec2::new(offset_m, 0.0)).velocity.norm();
            motion.offset_rate_m_s = motion.offset_rate_m_s.max(longest);
            before = Some(velocities);
        }
        Some(motion)
    }

    /// Notes how near these places are to a wall. `looked`: where each was when it was looked at last, and how
    /// far from all walls, m.
    fn pass(
        &mut self,
        walls: &Obstacles,
        places: impl Iterator<Item = Vec2>,
        t_s: f64,
        looked: &mut [(Vec2, f64)],
    ) {
        for ((at, passage), looked) in places.zip(&mut self.passages).zip(looked) {
            let least_m = passage.map_or(f64::INFINITY, |passage| passage.distance_m);
            // No nearer than this to any wall, since it was so far from all of them there.
            let (there, far_m) = *looked;
            if far_m - (at - there).norm() > least_m {
                continue;
            }
            let Some(near) = walls.nearest(at) else { continue };
            *looked = (at, near.distance_m);
            if near.distance_m < least_m {
                *passage = Some(Passage { distance_m: near.distance_m, t_s, wall: near.index });
            }
        }
    }
}

impl Peak {
    /// Notes this twist at `t_s`, if it is faster; `peaks_at_s`: when front point and rim were fastest.
    fn raise(&mut self, peaks_at_s: &mut [f64; 2], robot: &Robot, twist: Twist, t_s: f64) {
        let (v, w) = (twist.v_m_s.abs(), twist.w_rad_s.abs());
        let front_m_s = front_speed(robot.front_point_m, twist);
        if front_m_s > self.front_speed_m_s {
            (self.front_speed_m_s, peaks_at_s[0]) = (front_m_s, t_s);
        }
        self.v_m_s = self.v_m_s.max(v);
        self.w_rad_s = self.w_rad_s.max(w);
        if let Some(wheels) = robot.wheels {
            let rim_m_s = v + 0.5 * wheels.track_m * w;
            if self.rim_speed_m_s.is_none_or(|peak_m_s| rim_m_s > peak_m_s) {
                (self.rim_speed_m_s, peaks_at_s[1]) = (Some(rim_m_s), t_s);
            }
        }
    }
}

/// The main leader's target and frame at 0 and after each of so many steps, with the time, s: its front point is on
/// m(t), and draws its heading along, which is `heading_rad` at the start. `None` where nobody leads.
pub(crate) fn leader_course(
    scenario: &Scenario,
    heading_rad: f64,
    step_s: f64,
    steps: usize,
) -> Option<impl Iterator<Item = (f64, Target, LeaderFrame)>> {
    let (leader, lead) = (scenario.leader()?, scenario.lead.as_ref()?);
    let ell_m = scenario.robots[leader].front_point_m;
    let mut heading_rad = heading_rad;
    Some((0..=steps).map(move |step| {
        let t_s = step as f64 * step_s;
        if step > 0 {
            let between = lead.trajectory.target_at(t_s - 0.5 * step_s).velocity;
            let drawing = drawing_velocity(heading_rad, between, lead.keep_heading);
            heading_rad = drawn_heading(heading_rad, ell_m, drawing, step_s);
        }
        let target = lead.trajectory.target_at(t_s);
        let (scale, scale_rate_per_s) = lead.scale.value_and_rate_at(t_s);
        let drawing = drawing_velocity(heading_rad, target.velocity, lead.keep_heading);
        let turn_rate_rad_s = twist_for(heading_rad, ell_m, drawing).w_rad_s;
        let still = LeaderFrame::STILL;
        let frame = LeaderFrame { heading_rad, turn_rate_rad_s, scale, scale_rate_per_s, ..still };
        (t_s, target, frame)
    }))
}

/// Where a velocity points, if anywhere.
fn heading_of(velocity: Vec2) -> Option<f64> {
    (velocity.norm() > 0.0).then(|| portable_math::atan2(velocity.y, velocity.x))
}
