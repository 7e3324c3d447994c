//! Deflection (avoidance steering): steers around other robots. It uses the chapter's unstable focus only as
//! strongly as needed, looks ahead, and yields. It is a performance term without a safety guarantee.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n, t | own position minus other's, its length, its direction, n rotated by +90 degrees |
//! | p | requested displacement within one period T, m; \|p\| <= V = v_max T |
//! | e | own front point minus desired position, m |
//! | d_f | distance at which the deflection starts to act, m |
//! | d_s | standoff distance: replaces d_f for a robot that waits next to its occupied slot, m |
//! | c_f | distance from a wall at which the deflection starts to act, m |
//! | kappa | fraction of the slack to d_f that the approach of one period may use up |
//!
//! A robot that has arrived yields to an approaching robot: d_f is enlarged by a fraction of itself if e is
//! small and the other robot approaches the slot. In a formation that keeps its shape, at rest, moving or
//! turning, no robot approaches another robot's slot, and d_f is unchanged. Explanation:
//! `docs/explanation/arrival.md`.

mod constants;

use std::f64::consts::TAU;

use formation::Vec2;
use formation::front_point::rotate;
use formation::portable_math;
use protocol::avoidance::MethodConditions;
use protocol::brief::{AgentBrief, YieldPriority};

use constants::Constants;

use super::braking::slack_decrease_rate_per_s;
use super::neighbor_tracker::{NeighborTracker, TrackedNeighbor};
use super::progress_monitor::ProgressMonitor;
use super::{Sample, clip};
use crate::golden_phase;

/// Gain of the steering along a wall. If at least 1/4 of p points along the wall, the removed component is
/// redirected completely to that side.
const WALL_STEERING_GAIN: f64 = 4.0;
/// Minimum dither period, s. Each robot has a different period, so no pair stays symmetric.
const DITHER_PERIOD_S_MIN: f64 = 1.5;
/// Minimum dither amplitude of a robot that has been blocked for a long time, rad.
const BLOCKED_DITHER_RAD_MIN: f64 = 1.0;
/// Minimum of d_f - d, as a fraction of d.
const DEFLECTION_MARGIN_FRACTION_MIN: f64 = 0.05;
/// Time at rest after which another robot is assumed to occupy its position permanently, s.
const OCCUPIED_AFTER_S: f64 = 3.0;
/// Time constant of the smoothed slot velocity, in d / v_max. While a formation assembles, in-neighbors move
/// the slot. They still count as approaching.
const SLOT_SMOOTHING_TIME: f64 = 3.0;
/// Lower clamp on the time to closest approach in early avoidance, s.
const TIME_TO_APPROACH_S_MIN: f64 = 0.1;

/// Increase of the yield distance, and reduction of the yield speed, per unit of v_max H / d. With a longer
/// command timeout all robots move more slowly, so a robot yields farther from its slot and to slower robots.
const YIELD_REACH_PER_DELAY: f64 = 4.0;
const YIELD_SPEED_PER_DELAY: f64 = 5.0;

/// Excess of d_s over d_f, as a fraction of the distance by which the desired position lies within d_f of the
/// other robot. Measured over all single deaths and cuts of the shipped scenarios: with 0, three followers with
/// free slots end 2 to 8 cm off them, blocked by followers without. With 0.1 and 0.15 this does not occur.
pub const STANDOFF_EXCESS_FRACTION: f64 = 0.1;

/// Returns d_f, m: the distance from which a robot is steered around another. It is larger for robots of lower
/// yield priority.
pub fn deflection_distance_m(conditions: &MethodConditions<'_>) -> f64 {
    Constants::build_constants().deflection_distance_m(conditions)
}

/// Returns the sensing radius for early avoidance, m: d_f plus the distance driven at v_max during the
/// look-ahead time.
pub fn look_ahead_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    let look_ahead = Constants::build_constants().look_ahead(conditions);
    deflection_distance_m(conditions) + look_ahead * conditions.avoidance.distance_min_m
}

/// Returns d_f of a rank as a multiple of that of the first rank. Measured over all single deaths and cuts of
/// the shipped scenarios: with these values no leader is blocked by a follower of a hull (`Contained`), or by a
/// formation robot that stopped in its path because it has no in-neighbor left. From 1.2 on, replacements of
/// contained robots may find every gap between two others too narrow.
fn rank_distance_factor(rank: YieldPriority) -> f64 {
    match rank {
        YieldPriority::First => 1.0,
        YieldPriority::Follower => 1.1,
        YieldPriority::Contained => 1.12,
    }
}

/// Returns kappa. If any robot has inertia, it is limited to what the bound grants: Lambda of the slack per
/// second.
pub fn approach_slack_fraction(conditions: &MethodConditions<'_>) -> f64 {
    Constants::build_constants().approach_slack_fraction(conditions)
}

impl Constants {
    /// Returns d_f, m, as [`deflection_distance_m`].
    fn deflection_distance_m(&self, conditions: &MethodConditions<'_>) -> f64 {
        self.deflection_distance_for(conditions.avoidance.distance_min_m, conditions)
    }

    /// Returns d_f, m, for robots that keep the minimum distance `d`, m, from this robot.
    fn deflection_distance_for(&self, d: f64, conditions: &MethodConditions<'_>) -> f64 {
        let d_f = d
            + (self.margin * conditions.speed_max_m_s() * conditions.command_timeout_s)
                .max(DEFLECTION_MARGIN_FRACTION_MIN * d);
        rank_distance_factor(conditions.rank) * d_f
    }

    /// Returns the look-ahead time, in d / v_max.
    fn look_ahead(&self, conditions: &MethodConditions<'_>) -> f64 {
        match conditions.moves_along_heading {
            true => self.look_ahead_along_heading,
            false => self.look_ahead,
        }
    }

    /// Returns kappa, as [`approach_slack_fraction`].
    fn approach_slack_fraction(&self, conditions: &MethodConditions<'_>) -> f64 {
        match conditions.avoidance.braking_time_max_s > 0.0 {
            true => {
                self.slack_share.min(slack_decrease_rate_per_s(conditions) * conditions.period_s)
            }
            false => self.slack_share,
        }
    }
}

/// Returns c_f, m: the distance from which a robot is steered along a wall. The bound grants twice the approach
/// speed that it grants next to another robot.
pub fn wall_deflection_distance_m(conditions: &MethodConditions<'_>) -> f64 {
    let clearance = conditions.avoidance.clearance_m;
    clearance
        + (0.75 * conditions.speed_max_m_s() * conditions.command_timeout_s).max(0.05 * clearance)
}

/// Returns kappa next to a wall. If any robot has inertia, the bound grants 2 Lambda of the slack per second.
pub fn wall_approach_slack_fraction(conditions: &MethodConditions<'_>) -> f64 {
    match conditions.avoidance.braking_time_max_s > 0.0 {
        true => WALL_APPROACH_SLACK_FRACTION
            .min(2.0 * slack_decrease_rate_per_s(conditions) * conditions.period_s),
        false => WALL_APPROACH_SLACK_FRACTION,
    }
}

/// Value of kappa next to a wall without inertia.
const WALL_APPROACH_SLACK_FRACTION: f64 = 0.25;

/// Avoidance steering of one robot.
pub struct Deflection {
    /// Speed limit, m/s.
    v_max: f64,
    /// Control period (T), s.
    period_s: f64,
    approach_slack_fraction: f64,
    pub(super) deflection_distance: f64,
    /// Deflection distance for robots of each class, m; empty if the brief has no classes.
    class_deflection_distances: Vec<f64>,
    /// Values of kappa and c_f (m) next to walls.
    wall_slack_fraction_and_distance: (f64, f64),
    rank: YieldPriority,
    tracker: NeighborTracker,
    progress: ProgressMonitor,
    gains: DeflectionGains,
    /// Smoothed velocity of the desired position, m/s.
    slot_velocity: Vec2,
    /// Set while the desired position is occupied. The robot is then held back and not steered around others.
    occupied_slot: Option<OccupiedSlot>,
    constraints: Vec<DisplacementConstraint>,
    pub(super) dither_period_s: f64,
    pub(super) dither_phase_rad: f64,
}

/// Constants that depend on the robot, in SI units.
struct DeflectionGains {
    dither_amplitude_rad: f64,
    tangential_gain: f64,
    blocked_tangential_gain: f64,
    look_ahead_s: f64,
    look_ahead_gain: f64,
    look_ahead_turn_max_rad: f64,
    yield_gain: f64,
    yield_speed_m_s: f64,
    yield_reach_m: f64,
    /// Time constant of the smoothed slot velocity, s.
    slot_smoothing_time_s: f64,
}

impl DeflectionGains {
    /// Converts the constants. A leader of all others neither yields nor turns away early.
    fn new(
        constants: &Constants,
        conditions: &MethodConditions<'_>,
        is_leader: bool,
    ) -> DeflectionGains {
        let (d, v_max) = (conditions.avoidance.distance_min_m, conditions.speed_max_m_s());
        // A leader keeps its path, because all others follow wherever it turns.
        let unless_leader = |constant: f64| if is_leader { 0.0 } else { constant };
        let delay_ratio = v_max * conditions.command_timeout_s / d;
        DeflectionGains {
            dither_amplitude_rad: match conditions.avoidance.braking_time_max_s > 0.0 {
                true => constants.dither_inertial_rad,
                false => constants.dither_rad,
            },
            tangential_gain: constants.around,
            blocked_tangential_gain: constants.around_at_last,
            look_ahead_s: constants.look_ahead(conditions) * d / v_max,
            look_ahead_gain: constants.look_ahead_share,
            look_ahead_turn_max_rad: unless_leader(constants.look_ahead_turn_rad),
            // Another robot that approaches the position of a contained robot may have it as its destination,
            // and stay there.
            yield_gain: match conditions.rank {
                YieldPriority::Contained => 0.0,
                YieldPriority::First | YieldPriority::Follower => {
                    unless_leader(constants.yield_share)
                }
            },
            yield_speed_m_s: constants.yield_speed * v_max
                / (1.0 + YIELD_SPEED_PER_DELAY * delay_ratio),
            yield_reach_m: constants.yield_reach * d + YIELD_REACH_PER_DELAY * delay_ratio * d,
            slot_smoothing_time_s: SLOT_SMOOTHING_TIME * d / v_max,
        }
    }
}

/// Constraint on the displacement of one period from another robot or a wall.
#[derive(Debug, Clone, Copy)]
struct DisplacementConstraint {
    /// Own position minus that of the other robot or of the nearest wall point (z), m.
    z: Vec2,
    /// Length of z (r), m.
    distance: f64,
    /// Minimum of n . p, m. It is negative while there is slack.
    lower_bound: f64,
    /// `true` for a wall, which does not move aside.
    is_wall: bool,
}

impl DisplacementConstraint {
    /// Returns `true` if the constraint can be active for a displacement of at most `reach`, m.
    fn can_be_active(&self, reach: f64) -> bool {
        -self.lower_bound < reach && self.distance > 0.0
    }

    /// Returns the displacement `p` with the missing component away from the other added, and the fraction
    /// `tangential_gain` of that component added across. Next to a wall the sign of the cross component is that of p.
    fn steer_around(&self, p: Vec2, tangential_gain: f64) -> Vec2 {
        let n = self.z / self.distance;
        let lambda = self.lower_bound - n.dot(&p);
        if lambda <= 0.0 {
            return p;
        }
        let tangent = Vec2::new(-n.y, n.x);
        let tangential_gain = match self.is_wall {
            true => (WALL_STEERING_GAIN * tangent.dot(&p) / p.norm().max(f64::MIN_POSITIVE))
                .clamp(-1.0, 1.0),
            false => tangential_gain,
        };
        p + lambda * (n + tangential_gain * tangent)
    }
}

/// Occupied desired position, and where the robot waits.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OccupiedSlot {
    /// Vector z of the robot that occupies the position, m.
    occupant_vector: Vec2,
    /// Standoff distance (d_s), m.
    standoff_distance: f64,
    /// Waiting position relative to the desired position, m.
    standoff_offset: Vec2,
}

impl Deflection {
    /// Creates the deflection for the robot of this brief.
    pub fn new(brief: &AgentBrief) -> Deflection {
        Deflection::with_constants(brief, &Constants::build_constants())
    }

    fn with_constants(brief: &AgentBrief, constants: &Constants) -> Deflection {
        let conditions = MethodConditions::for_robot(brief);
        let phase = golden_phase(brief.index);
        let (d, v_max) = (conditions.avoidance.distance_min_m, conditions.speed_max_m_s());
        Deflection {
            v_max: brief.avoidance.speed_max_m_s,
            period_s: brief.period_ns as f64 / 1e9,
            approach_slack_fraction: constants.approach_slack_fraction(&conditions),
            deflection_distance: constants.deflection_distance_m(&conditions),
            class_deflection_distances: conditions
                .avoidance
                .classes
                .iter()
                .map(|class| constants.deflection_distance_for(class.distance_min_m, &conditions))
                .collect(),
            wall_slack_fraction_and_distance: (
                wall_approach_slack_fraction(&conditions),
                wall_deflection_distance_m(&conditions),
            ),
            rank: brief.rank,
            tracker: NeighborTracker::new(&conditions),
            progress: ProgressMonitor::new(d, v_max, constants.impatience_time),
            gains: DeflectionGains::new(constants, &conditions, brief.lead.is_some()),
            slot_velocity: Vec2::zeros(),
            occupied_slot: None,
            constraints: Vec::new(),
            dither_period_s: DITHER_PERIOD_S_MIN * (1.0 + 4.0 * phase / 3.0),
            dither_phase_rad: phase,
        }
    }

    /// Returns the error e, m, as the control law shall use it. If another robot occupies the desired position,
    /// the robot does not approach it closer than d_f. It takes a position next to it, at d_s, in the direction
    /// of the desired position as seen from the other robot, and increasingly in the own direction the closer
    /// both are. This changes continuously as the other robot moves on. The position of a contained robot may
    /// be occupied by any robot at once, any other slot only by a robot that has been at rest for
    /// [`OCCUPIED_AFTER_S`].
    pub fn standoff_error(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        self.tracker.observe(sample);
        let gap_squared = |z: &Vec2| (z - error).norm_squared(); // |alpha* - alpha_j|^2
        let immediately = self.rank == YieldPriority::Contained || self.progress.is_resting();
        let occupies_slot = |neighbor: &&TrackedNeighbor| {
            let d_f = self.deflection_distance_to(neighbor);
            gap_squared(&neighbor.z) < d_f * d_f
                && (immediately || neighbor.rest_time_s >= OCCUPIED_AFTER_S)
        };
        let neighbors = self.tracker.neighbors().iter().filter(occupies_slot);
        let nearest = neighbors.min_by(|a, b| gap_squared(&a.z).total_cmp(&gap_squared(&b.z)));
        let nearest = nearest.map(|neighbor| (neighbor.z, self.deflection_distance_to(neighbor)));
        let nearest = nearest.filter(|_| {
            self.rank == YieldPriority::Contained
                || self.progress.update_standoff(self.tracker.dt())
        });
        self.occupied_slot = nearest.map(|(z, d_f)| {
            let shortfall = d_f - gap_squared(&z).sqrt();
            let d_s = d_f + STANDOFF_EXCESS_FRACTION * shortfall;
            let from_occupant = (z - error) + shortfall * z / z.norm();
            let from_occupant = d_s * from_occupant / from_occupant.norm(); // from alpha_j
            let standoff_offset = from_occupant - (z - error);
            let is_finite = standoff_offset.x.is_finite() && standoff_offset.y.is_finite();
            OccupiedSlot {
                occupant_vector: z,
                standoff_distance: d_s,
                standoff_offset: if is_finite { standoff_offset } else { Vec2::zeros() },
            }
        });
        self.occupied_slot.map_or(error, |slot| error - slot.standoff_offset)
    }

    /// Returns the distance from which the robot is steered around another, m: d_s during a standoff, except
    /// towards the robot that occupies its slot, and d_f otherwise.
    fn steering_distance(&self, neighbor: &TrackedNeighbor) -> f64 {
        match self.occupied_slot {
            Some(slot) if slot.occupant_vector != neighbor.z => slot.standoff_distance,
            _ => self.deflection_distance_to(neighbor),
        }
    }

    /// Returns the deflection distance for robots of the class of this neighbor, m.
    fn deflection_distance_to(&self, neighbor: &TrackedNeighbor) -> f64 {
        let of_class = self.class_deflection_distances.get(usize::from(neighbor.class));
        of_class.copied().unwrap_or(self.deflection_distance)
    }

    /// Returns the constraints that may be active within this period, walls first, each group nearest first.
    fn active_constraints(&mut self, sample: &Sample<'_>) -> Vec<DisplacementConstraint> {
        let mut constraints = std::mem::take(&mut self.constraints);
        constraints.clear();
        let reach = self.v_max * self.period_s;
        let (kappa, c_f) = self.wall_slack_fraction_and_distance;
        let walls = sample.wall_vectors.iter().map(|&z| {
            let r = z.norm();
            DisplacementConstraint {
                z,
                distance: r,
                lower_bound: -kappa * (r - c_f),
                is_wall: true,
            }
        });
        let farthest = self.occupied_slot.map_or(self.deflection_distance, |slot| {
            slot.standoff_distance.max(self.deflection_distance)
        });
        let farthest =
            farthest * (1.0 + self.gains.yield_gain) + reach / self.approach_slack_fraction;
        let neighbors = self.tracker.neighbors().iter().filter_map(|neighbor| {
            let r2 = neighbor.z.norm_squared();
            (r2 < farthest * farthest)
                .then(|| self.constraint_from_neighbor(neighbor, r2.sqrt(), sample))
        });
        constraints
            .extend(walls.chain(neighbors).filter(|constraint| constraint.can_be_active(reach)));
        constraints
    }

    /// Returns the constraint from another robot at distance `r`, m. If the robot is near its slot, it acts
    /// from farther away, the faster the other approaches.
    fn constraint_from_neighbor(
        &self,
        neighbor: &TrackedNeighbor,
        r: f64,
        sample: &Sample<'_>,
    ) -> DisplacementConstraint {
        let d_f = self.steering_distance(neighbor);
        let comes_m_s = (neighbor.velocity - self.slot_velocity).dot(&neighbor.z) / r;
        let share = (comes_m_s / self.gains.yield_speed_m_s).clamp(0.0, 1.0);
        let beside = |yields: f64| {
            let excess = -self.approach_slack_fraction * (r - d_f * (1.0 + yields));
            DisplacementConstraint {
                z: neighbor.z,
                distance: r,
                lower_bound: excess,
                is_wall: false,
            }
        };
        // Coincident positions have no direction of approach, and the quotient is NaN.
        let yield_gain = if share > 0.0 { self.gains.yield_gain * share } else { 0.0 };
        match yield_gain > 0.0 && beside(yield_gain).can_be_active(self.v_max * self.period_s) {
            true => beside(yield_gain * self.yield_degree(sample)),
            false => beside(yield_gain),
        }
    }

    /// Returns the degree of yielding: 1 at the slot or while progress is given up, towards 0 far away, and 0
    /// if the robot has no desired position and stops.
    fn yield_degree(&self, sample: &Sample<'_>) -> f64 {
        let offset = self.occupied_slot.map_or(Vec2::zeros(), |slot| slot.standoff_offset);
        let Some(error) = sample.error.map(|error| error - offset) else { return 0.0 };
        match self.progress.is_resting() {
            true => 1.0,
            false => portable_math::exp(
                -error.norm_squared() / portable_math::square(self.gains.yield_reach_m),
            ),
        }
    }

    /// Returns the requested displacement `p`, deflected around robots that it would approach too closely.
    /// During a standoff, or while progress is given up, the robot is only held back: passing others would gain
    /// nothing and block their paths. It then stays d_s away from every robot except the one that occupies its
    /// slot.
    ///
    /// Along a wall the deflection is to the side to which p points, because a wall does not move aside.
    pub fn deflect(&mut self, sample: &Sample<'_>, mut p: Vec2) -> Vec2 {
        let reach = self.v_max * self.period_s; // V
        self.tracker.observe(sample);
        let length = p.norm();
        let actual_speed_m_s =
            if length > 0.0 { sample.front_velocity.dot(&p) / length } else { 0.0 };
        let requested_speed_m_s = length / self.period_s;
        let fractions = [requested_speed_m_s, requested_speed_m_s - actual_speed_m_s]
            .map(|speed| speed / self.v_max);
        let dt = self.tracker.dt();
        self.progress.observe(dt, sample, fractions);
        let may_steer_around = self.occupied_slot.is_none() && !self.progress.is_resting();
        let velocity_change = sample.slot_velocity - self.slot_velocity;
        self.slot_velocity += velocity_change * (dt / (dt + self.gains.slot_smoothing_time_s));
        let constraints = self.active_constraints(sample);
        let mut gain = 0.0;
        if may_steer_around {
            p = self.turn_away_early(p);
            if constraints.iter().any(|constraint| {
                !constraint.is_wall
                    && constraint.z.dot(&p) < constraint.lower_bound * constraint.distance
            }) {
                let cycles = sample.t_s / self.dither_period_s + self.dither_phase_rad;
                let amplitude_rad = self.gains.dither_amplitude_rad;
                let blocked_degree = self.progress.blocked_degree();
                let dither_rad = amplitude_rad
                    + (BLOCKED_DITHER_RAD_MIN - amplitude_rad).max(0.0) * blocked_degree;
                p = rotate(dither_rad * portable_math::sin(TAU * cycles), p);
            }
            let DeflectionGains { tangential_gain, blocked_tangential_gain, .. } = self.gains;
            gain = tangential_gain
                + (blocked_tangential_gain - tangential_gain) * self.progress.missing_progress();
        }
        for _ in 0..2 {
            p = constraints.iter().rev().fold(p, |p, constraint| constraint.steer_around(p, gain));
        }
        self.constraints = constraints;
        clip(p, reach)
    }

    /// Returns `p`, turned early away from robots that it would pass closer than d_f at constant velocities. It
    /// turns to the side on which it passes anyway, by a larger angle for an earlier encounter.
    fn turn_away_early(&self, p: Vec2) -> Vec2 {
        let length = p.norm();
        if length == 0.0 {
            return p;
        }
        let (requested, speed) = (p / self.period_s, length / self.period_s);
        let look_ahead_s = self.gains.look_ahead_s;
        let turn_away_from = |neighbor: &TrackedNeighbor| {
            let relative = requested - neighbor.velocity;
            let (approach, speed2) = (-neighbor.z.dot(&relative), relative.norm_squared());
            // Ignored: robots already passed, met after the look-ahead time, or with the same velocity.
            if !(approach > 0.0 && approach < look_ahead_s * speed2) {
                return 0.0;
            }
            // Signed miss distance to the left of the other's path, m, times the relative speed.
            let left = neighbor.z.y * relative.x - neighbor.z.x * relative.y;
            let d_f = self.deflection_distance_to(neighbor);
            if left * left >= d_f * d_f * speed2 {
                return 0.0;
            }
            let (time_to_approach_s, offset) = (approach / speed2, left / speed2.sqrt());
            // A robot that passes on the left of the other's path turns further to the left.
            let side = if (left >= 0.0) == (relative.dot(&requested) >= 0.0) { 1.0 } else { -1.0 };
            let shortfall = d_f - offset.abs();
            let lateral_m_s = self.gains.look_ahead_gain * shortfall
                / time_to_approach_s.max(TIME_TO_APPROACH_S_MIN);
            side * lateral_m_s * (1.0 - time_to_approach_s / look_ahead_s) / speed
        };
        let turn: f64 = self.tracker.neighbors().iter().map(turn_away_from).sum();
        let turn_max_rad = self.gains.look_ahead_turn_max_rad;
        if turn == 0.0 { p } else { rotate(turn.clamp(-turn_max_rad, turn_max_rad), p) }
    }
}

#[cfg(test)]
mod tests;
