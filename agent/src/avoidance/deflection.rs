//! Deflection: the way around others. It keeps the chapter's unstable focus, only as strong as
//! needed, and adds a dither that breaks symmetric deadlocks. It is comfort: it promises nothing.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n, t | own minus other, its length, its direction, n turned +90 degrees |
//! | p | displacement wanted within one period T, m; \|p\| <= V = v_max T |
//! | d_f | distance at which the deflection begins to matter, m |
//! | d_s | the same for a robot that stands off from a place that is taken, m |
//! | c_f | the same beside a wall, m |
//! | kappa | share of the slack to d_f that a period's approach may use up |

use std::f64::consts::TAU;

use formation::Vec2;
use formation::front_point::rotate;
use protocol::avoidance::Conditions;
use protocol::brief::{AgentBrief, Rank};

use super::braking::rate_per_s;
use super::{Sample, clip};
use crate::golden_phase;

/// kappa: the deflection begins where a period's approach exceeds this share of the slack to d_f.
const KAPPA: f64 = 0.25;
/// How soon the way along a wall is all that is left: to a side to which a quarter of p leads.
const ALONG: f64 = 4.0;
/// A: how far the dither turns the wanted displacement, rad.
const DITHER_RAD: f64 = 1.0;
/// The dither's shortest period, s; each robot has its own, so that no pair stays symmetric.
const DITHER_PERIOD_S: f64 = 1.5;

/// d_s is more than d_f by this share of how far the place wanted is within d_f of the other. Measured
/// over all single deaths and cuts of the shipped scenarios: with 0 three contained robots that have a
/// place end 2 to 8 cm off it, held up by some that have none; with 0.1 and with 0.15 nobody does.
pub const ASIDE: f64 = 0.1;

/// d_f, m: the distance from which a robot is led around another; larger for one that gives way.
pub fn deflection_distance_m(at: &Conditions<'_>) -> f64 {
    let d = at.avoidance.distance_min_m;
    let d_f = d + (1.5 * at.speed_m_s() * at.lifetime_s).max(0.05 * d);
    larger(at.rank) * d_f
}

/// d_f as a multiple of that of the first rank. Measured over all single deaths and cuts of the
/// shipped scenarios: with these no leader is held up by a contained robot, nor by a follower that
/// stands in its way because it has nobody left to go by. From 1.2 on, replacements of contained
/// robots may find every way in between two others too narrow.
fn larger(rank: Rank) -> f64 {
    match rank {
        Rank::First => 1.0,
        Rank::Follower => 1.1,
        Rank::Contained => 1.12,
    }
}

/// kappa. Where somebody has inertia it asks for no more than the bound grants, Lambda of the slack a
/// second.
pub fn deflection_share(at: &Conditions<'_>) -> f64 {
    match at.avoidance.braking_time_max_s > 0.0 {
        true => KAPPA.min(rate_per_s(at) * at.period_s),
        false => KAPPA,
    }
}

/// c_f, m: the distance from which a robot is led along a wall. The bound grants it twice as much there as
/// beside another robot.
pub fn wall_deflection_distance_m(at: &Conditions<'_>) -> f64 {
    let clearance = at.avoidance.clearance_m;
    clearance + (0.75 * at.speed_m_s() * at.lifetime_s).max(0.05 * clearance)
}

/// kappa beside a wall: where somebody has inertia, the bound grants 2 Lambda of the slack a second.
pub fn wall_deflection_share(at: &Conditions<'_>) -> f64 {
    match at.avoidance.braking_time_max_s > 0.0 {
        true => KAPPA.min(2.0 * rate_per_s(at) * at.period_s),
        false => KAPPA,
    }
}

/// The way of one robot around others.
pub struct Deflection {
    v_max: f64,
    /// T, s.
    period: f64,
    kappa: f64,
    pub(super) d_f: f64,
    /// kappa and c_f, beside walls.
    wall: (f64, f64),
    rank: Rank,
    /// Its place is taken: it is held back, and not led around.
    stands_off: Option<Taken>,
    pub(super) dither_period: f64,
    pub(super) dither_phase: f64,
}

/// Why a robot stands off.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    /// z of the other that has its place, m.
    by: Vec2,
    /// d_s, m.
    d_s: f64,
}

impl Deflection {
    /// That of the robot of this brief.
    pub fn new(brief: &AgentBrief) -> Deflection {
        let at = Conditions::of(brief);
        let phase = golden_phase(brief.index);
        Deflection {
            v_max: brief.avoidance.speed_max_m_s,
            period: brief.period_ns as f64 / 1e9,
            kappa: deflection_share(&at),
            d_f: deflection_distance_m(&at),
            wall: (wall_deflection_share(&at), wall_deflection_distance_m(&at)),
            rank: brief.rank,
            stands_off: None,
            dither_period: DITHER_PERIOD_S * (1.0 + 4.0 * phase / 3.0),
            dither_phase: phase,
        }
    }

    /// A contained robot does not ask for a place nearer than d_f to somebody: it asks for one
    /// beside it, at d_s. Beside: where the place lies as seen from the other, and, the nearer the two
    /// are, where the robot is as seen from it. All change without a jump as the other moves on.
    pub fn stand_off(&mut self, away: &[Vec2], error: Vec2) -> Vec2 {
        let gap = |z: &&Vec2| (*z - error).norm(); // |alpha* - alpha_j|
        let nearest = away.iter().min_by(|a, b| gap(a).total_cmp(&gap(b)));
        let taken = nearest.filter(|z| self.rank == Rank::Contained && gap(z) < self.d_f);
        self.stands_off =
            taken.map(|z| Taken { by: *z, d_s: self.d_f + ASIDE * (self.d_f - gap(&z)) });
        let Some(Taken { by: z, d_s }) = self.stands_off else { return error };
        let beside = (z - error) + (self.d_f - gap(&&z)) * z / z.norm();
        let beside = d_s * beside / beside.norm(); // from alpha_j
        let finite = beside.x.is_finite() && beside.y.is_finite();
        if finite { z - beside } else { error }
    }

    /// The wanted displacement `p`, led around those it would come too near. One that stands off is
    /// held back only: around others there is nothing for it, and on the way it would be in
    /// everybody else's. From all but whoever has its place it stays d_s away.
    ///
    /// Along a wall it is led to the side to which p leads anyway: a wall does not move aside.
    pub fn deflect(&self, sample: &Sample<'_>, mut p: Vec2) -> Vec2 {
        let reach = self.v_max * self.period; // V
        let excess = |z: &Vec2| {
            let aside = self.stands_off.filter(|taken| taken.by != *z);
            -self.kappa * (z.norm() - aside.map_or(self.d_f, |taken| taken.d_s))
        };
        let blocked = sample.away.iter().any(|z| z.dot(&p) < excess(z) * z.norm());
        if blocked && self.stands_off.is_none() {
            let turns = sample.t_s / self.dither_period + self.dither_phase;
            p = rotate(DITHER_RAD * (TAU * turns).sin(), p);
        }
        for _ in 0..2 {
            for z in sample.away.iter().rev() {
                let r = z.norm();
                if -excess(z) < reach && r > 0.0 {
                    let n = z / r;
                    let lambda = (excess(z) - n.dot(&p)).max(0.0);
                    let around = if self.stands_off.is_some() { 0.0 } else { 1.0 };
                    p += lambda * (n + around * Vec2::new(-n.y, n.x));
                }
            }
            for z in sample.walls.iter().rev() {
                let r = z.norm();
                let (kappa, c_f) = self.wall;
                let excess = -kappa * (r - c_f);
                if -excess < reach && r > 0.0 {
                    let n = z / r;
                    let lambda = (excess - n.dot(&p)).max(0.0);
                    let along = Vec2::new(-n.y, n.x);
                    let length = p.norm();
                    let side = if length > 0.0 { along.dot(&p) / length } else { 0.0 };
                    p += lambda * (n + (ALONG * side).clamp(-1.0, 1.0) * along);
                }
            }
        }
        clip(p, reach)
    }
}
