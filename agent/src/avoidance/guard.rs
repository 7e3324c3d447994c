//! The guard: no two front points nearer than d, whatever is sampled late, frozen or killed.
//!
//! Two parts. *Deflect* keeps the chapter's unstable focus as the way around others, only as
//! strong as needed; it is comfort. *Bound* restricts the held command so that, for as long as
//! the plant may obey it (the lifetime H, counted from the sample's stamp), the robot gives up no
//! more than its half of the slack to anybody near; it is the promise. The plant's half of the
//! promise: commands die at stamp + H, late and old ones are refused, and hypot(v, ell w) never
//! exceeds v_max.
//!
//! Why it is safe: while a command acts, z moves by at most M, so the true direction to the other
//! stays within asin(M/r) of n, and the heading within delta of thetabar; hence n(t) . alpha' >= -b.
//! With rho the true slack and E = e^(2 Lambda t) rho, both robots together keep E from falling.
//! Nothing about latency, phase, freezes or deaths is used: they only cause refusals and stops.
//! The folder `proof` has this checked by Coq; comments name its lemma where a rule is needed.
//!
//! A place that is taken: a contained robot whose place lies within d_f of somebody stands off.
//! It asks for a place beside the other, and is held back instead of led around until its own is
//! free. Else it would circle the other for ever, and push aside whoever has a place there.
//!
//! Right of way is part of *deflect* alone: a robot of a later rank has a larger d_f, so that it is
//! led around the others before they are led around it. *Bound* knows d, v_max and H, which are
//! the same for all, and takes nothing from d_f: whatever *deflect* wants, of however many ranks,
//! passes through the same half-planes. So the promise does not depend on who gives way to whom.
//!
//! Sensors may err within known bounds, positions by eps and the heading by eta. An own front point
//! that is computed with a wrong heading is off by 2 ell sin(eta/2) at most, which adds to eps. Then
//! the true distance is r - eps or more, and z stays within M + eps of what was sensed. A wrong
//! heading turns the arc of the coming motion as a whole: its shape follows from (v, w), which the
//! plant does exactly, so the true heading stays within delta + eta of thetabar. With rho taken
//! shorter by eps, M longer by eps and delta wider by eta, n(t) . alpha' >= -b holds as before.
//!
//! Everything is computed from one odometry sample. Not in the paper.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n, t | own minus other, its length, its direction, n turned +90 degrees |
//! | p | displacement wanted within one period T, m; \|p\| <= V = v_max T |
//! | d_f | distance at which the deflection begins to matter, m |
//! | M | how far two robots can move relative to each other while a command acts, m |
//! | eps, eta | bounds on the errors of a sensed distance, m, and of the heading, rad |
//! | rho | slack r - d, m |
//! | b | how fast this robot may approach another, m/s |
//! | W-, W+ | range of turn rates that may be in force while this command acts, rad/s |

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use formation::Vec2;
use formation::front_point::{front_speed, rotate};
use formation::pose::Twist;
use protocol::avoidance::{Advice, AvoidanceDescription, Conditions, Promise, Senses};
use protocol::brief::{AgentBrief, Pace, Rank};
use protocol::number::{short, told_apart};

use super::polygon::{HalfPlane, nearest_point};
use super::{Avoidance, AvoidanceRow, Sample, exact_hold};
use crate::golden_phase;

/// kappa: the deflection begins where a period's approach exceeds this share of the slack to d_f.
pub const KAPPA: f64 = 0.25;
/// A: how far the dither turns the wanted displacement, rad.
const DITHER_RAD: f64 = 1.0;
/// The dither's shortest period, s; each robot has its own, so that no pair stays symmetric.
const DITHER_PERIOD_S: f64 = 1.5;
/// Taken off every distance, m: covers rounding, here and in the plant.
const ROUNDING_M: f64 = 1e-9;
/// Scales of the wanted command that the bound tries.
const SIGMAS: [f64; 3] = [1.0, 0.5, 0.25];
/// How often the range of turn rates is widened before the robot stands.
const PASSES_MAX: usize = 4;

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "guard",
        source: "not in the chapter",
        promise: Promise::Always,
        clamps_speed: true,
        senses: Senses::Positions,
        sensing_radius_m,
        steers_within: Some(("d_f", deflection_distance_m)),
        speed_cap_m_s: Some(speed_cap_m_s),
        advice: braking,
        ..AvoidanceDescription::INERT
    },
    build: |brief, _| Box::new(Guard::new(brief)),
};

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

/// max(d + 3 v_max H, d_f + 4 v_max T) and twice eps, m: nobody farther away than
/// this can matter.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let v_max = at.speed_m_s();
    let bounded = at.avoidance.distance_min_m + 3.0 * v_max * at.lifetime_s;
    let deflected = deflection_distance_m(at) + 4.0 * v_max * at.period_s;
    bounded.max(deflected) + 2.0 * at.distance_error_m()
}

/// min(d/4, ell/2) / H, m/s.
fn speed_cap_m_s(at: &Conditions<'_>) -> f64 {
    (0.25 * at.avoidance.distance_min_m).min(0.5 * at.front_point_m) / at.lifetime_s
}

/// Above the cap on v_max it brakes more than it helps.
fn braking(at: &Conditions<'_>) -> Option<Advice> {
    let (v_max, cap) = (at.avoidance.speed_max_m_s, speed_cap_m_s(at));
    let [limit, most] = told_apart(v_max, cap);
    (v_max.is_finite() && v_max > cap).then(|| Advice {
        key: "speed_max_m_s",
        message: format!(
            "the speed limit {limit} m/s is above min(d/4, ell/2) / H = {most} m/s: safe, but the \
             guard will brake a lot"
        ),
        expected: format!(
            "expected at most {most} m/s, or a shorter H (now {} s)",
            short(at.lifetime_s)
        ),
    })
}

/// State and constants of the guard of one robot.
struct Guard {
    d: f64,
    v_max: f64,
    ell: f64,
    /// T, s.
    period: f64,
    /// H, s.
    lifetime: f64,
    lifetime_ns: u64,
    /// eps, m.
    distance_error: f64,
    /// eta, rad.
    heading_error: f64,
    /// d_f, m.
    d_f: f64,
    rank: Rank,
    /// Its place is taken: it is held back, and not led around.
    stands_off: bool,
    /// Within this radius the list of the near must be complete, m.
    radius_needed: f64,
    dither_period: f64,
    dither_phase: f64,
    /// Own commands that the plant may still obey: stamp answered, twist.
    alive: VecDeque<(u64, Twist)>,
    /// In real time, commands of an earlier incarnation may act until here.
    predecessor_until_ns: Option<u64>,
    remembers_predecessor: bool,
    sides: Vec<HalfPlane>,
}

impl Avoidance for Guard {
    /// gamma, clipped to v_max: as it may be used and published.
    fn admit(&self, gamma: Vec2) -> Vec2 {
        clip(gamma, self.v_max)
    }

    /// A contained robot does not ask for a place nearer than d_f to somebody: it asks for one
    /// beside it, at d_f. Beside: where the place lies as seen from the other, and, the nearer the two
    /// are, where the robot is as seen from it. Both change without a jump as the other moves on.
    fn stand_off(&mut self, away: &[Vec2], error: Vec2) -> Vec2 {
        let gap = |z: &&Vec2| (*z - error).norm(); // |alpha* - alpha_j|
        let nearest = away.iter().min_by(|a, b| gap(a).total_cmp(&gap(b)));
        let taken = nearest.filter(|z| self.rank == Rank::Contained && gap(z) < self.d_f);
        self.stands_off = taken.is_some();
        let Some(z) = taken else { return error };
        let beside = (z - error) + (self.d_f - gap(&z)) * z / z.norm();
        let beside = self.d_f * beside / beside.norm(); // from alpha_j
        let finite = beside.x.is_finite() && beside.y.is_finite();
        if finite { z - beside } else { error }
    }

    /// The twist that moves the front point by gamma T.
    fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        exact_hold(heading_rad, self.ell, gamma * self.period, self.period)
    }

    /// The twist that answers `sample` when gamma is wanted.
    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        self.forget_the_dead(sample.stamp_ns);
        let granted = if self.is_blind(sample) {
            Twist::ZERO
        } else {
            let p = self.deflect(sample, gamma * self.period);
            let wanted = exact_hold(sample.heading_effect_rad, self.ell, p, self.period);
            let speed = front_speed(self.ell, wanted);
            let wanted =
                if speed > self.v_max { wanted.scaled(self.v_max / speed) } else { wanted };
            self.bound(sample, wanted)
        };
        self.alive.push_back((sample.stamp_ns, granted));
        granted
    }
}

impl Guard {
    fn new(brief: &AgentBrief) -> Guard {
        let avoidance = &brief.avoidance;
        let at = Conditions::of(brief);
        let (d, v_max) = (avoidance.distance_min_m, avoidance.speed_max_m_s);
        let period = brief.period_ns as f64 / 1e9;
        let lifetime = brief.command_lifetime_ns as f64 / 1e9;
        let phase = golden_phase(brief.index);
        Guard {
            d,
            v_max,
            ell: brief.front_point_m,
            period,
            lifetime,
            lifetime_ns: brief.command_lifetime_ns,
            distance_error: at.distance_error_m(),
            heading_error: avoidance.heading_error_rad,
            d_f: deflection_distance_m(&at),
            rank: brief.rank,
            stands_off: false,
            radius_needed: sensing_radius_m(&at),
            dither_period: DITHER_PERIOD_S * (1.0 + 4.0 * phase / 3.0),
            dither_phase: phase,
            alive: VecDeque::new(),
            predecessor_until_ns: None,
            remembers_predecessor: brief.pace == Pace::Realtime,
            sides: Vec::new(),
        }
    }

    /// Nothing, or not enough, is known about who is near: the proof needs all that are nearer than
    /// `proof/Guard.v::far`.
    fn is_blind(&self, sample: &Sample<'_>) -> bool {
        let farthest = sample.away.last().map_or(0.0, |z| z.norm());
        !sample.proximity_valid || sample.proximity_cut && farthest < self.radius_needed
    }

    /// What remains is what may still act: `proof/Time.v::covers_the_alive`, and
    /// `proof/Time.v::after_the_first_lifetime_no_predecessor_is_alive`.
    fn forget_the_dead(&mut self, stamp_ns: u64) {
        let lifetime_ns = self.lifetime_ns;
        self.alive.retain(|(answered_ns, _)| answered_ns + lifetime_ns > stamp_ns);
        if self.remembers_predecessor && self.predecessor_until_ns.is_none() {
            self.predecessor_until_ns = Some(stamp_ns + lifetime_ns);
        }
    }

    /// The wanted displacement `p`, led around those it would come too near. One that stands off is
    /// held back only: around others there is nothing for it, and on the way it would be in
    /// everybody else's.
    fn deflect(&self, sample: &Sample<'_>, mut p: Vec2) -> Vec2 {
        let reach = self.v_max * self.period; // V
        let excess = |r: f64| -KAPPA * (r - self.d_f);
        let blocked = sample.away.iter().any(|z| {
            let r = z.norm();
            z.dot(&p) < excess(r) * r
        });
        if blocked && !self.stands_off {
            let turns = sample.t_s / self.dither_period + self.dither_phase;
            p = rotate(DITHER_RAD * (TAU * turns).sin(), p);
        }
        for _ in 0..2 {
            for z in sample.away.iter().rev() {
                let r = z.norm();
                if -excess(r) < reach && r > 0.0 {
                    let n = z / r;
                    let lambda = (excess(r) - n.dot(&p)).max(0.0);
                    let around = if self.stands_off { 0.0 } else { 1.0 };
                    p += lambda * (n + around * Vec2::new(-n.y, n.x));
                }
            }
        }
        clip(p, reach)
    }

    /// The part of `wanted` that keeps the promise.
    fn bound(&mut self, sample: &Sample<'_>, wanted: Twist) -> Twist {
        let mut best = Twist::ZERO;
        let mut merit_best = f64::NEG_INFINITY;
        for sigma in SIGMAS {
            let tried = wanted.scaled(sigma);
            let granted = self.grant(sample, tried);
            if sigma == 1.0 && granted == tried {
                return granted;
            }
            let merit = granted.v_m_s * wanted.v_m_s
                + self.ell * self.ell * granted.w_rad_s * wanted.w_rad_s;
            if sigma == 1.0 || merit > merit_best.max(0.0) {
                (best, merit_best) = (granted, merit);
            }
        }
        best
    }

    /// The nearest to `tried` that approaches nobody faster than b while it may act.
    ///
    /// It is `proof/Time.v::certified`. That v_own and w_low to w_high stand for every command that may
    /// act, or have acted since the sample, is needed by `proof/Time.v::wheels_since_the_sample`.
    fn grant(&mut self, sample: &Sample<'_>, tried: Twist) -> Twist {
        let mut v_own = front_speed(self.ell, tried);
        let (mut w_low, mut w_high) = (tried.w_rad_s.min(0.0), tried.w_rad_s.max(0.0));
        for (_, twist) in &self.alive {
            v_own = v_own.max(front_speed(self.ell, *twist));
            w_low = w_low.min(twist.w_rad_s);
            w_high = w_high.max(twist.w_rad_s);
        }
        if self.predecessor_until_ns.is_some_and(|until_ns| sample.stamp_ns < until_ns) {
            v_own = v_own.max(self.v_max);
            w_low = w_low.min(-self.v_max / self.ell);
            w_high = w_high.max(self.v_max / self.ell);
        }
        for pass in 1..=PASSES_MAX {
            let (mid, spread) = self.headings(sample.heading_rad, w_low, w_high);
            self.collect_sides(sample.away, v_own, spread);
            let u = rotate(mid, Vec2::new(tried.v_m_s, self.ell * tried.w_rad_s));
            let Some(u) = nearest_point(u, &self.sides) else { return tried };
            let body = rotate(-mid, u);
            let w = body.y / self.ell;
            if w_low <= w && w <= w_high {
                return Twist { v_m_s: body.x, w_rad_s: w };
            }
            w_low = w_low.min(w);
            w_high = w_high.max(w);
            if pass == PASSES_MAX - 1 {
                w_low = w_low.min(-v_own / self.ell);
                w_high = w_high.max(v_own / self.ell);
            }
        }
        Twist::ZERO
    }

    /// Middle and half-width of the headings that are possible until the command dies, rad:
    /// `proof/Guard.v::middle` and `proof/Guard.v::spread`.
    fn headings(&self, heading_rad: f64, w_low: f64, w_high: f64) -> (f64, f64) {
        let half = 0.5 * self.lifetime;
        (heading_rad + half * (w_low + w_high), half * (w_high - w_low) + self.heading_error)
    }

    /// For everybody near, the half-planes that bound the approach whatever the true direction
    /// (within asin(M/r) of n) and the true heading (within `spread` of its middle).
    ///
    /// The formulas of `proof/Guard.v::respects`, which `proof/Guard.v::certificate_holds` needs; see
    /// `proof/Geometry.v::direction_within_asin` and `proof/Geometry.v::sides_bound_the_cone`.
    fn collect_sides(&mut self, away: &[Vec2], v_own: f64, spread: f64) {
        let rate = 1.0 / self.lifetime; // Lambda
        let reach = (self.v_max + v_own) * self.lifetime + self.distance_error; // M + eps
        self.sides.clear();
        for z in away {
            let r = z.norm();
            let rho = (r - self.distance_error - self.d - ROUNDING_M).max(0.0);
            let b = rate * (rho * (-2.0f64).exp()).max(rho - reach); // Lambda H = 1
            if b >= v_own {
                continue;
            }
            let swing = if reach < r { (reach / r).asin() } else { PI };
            let psi = (spread + swing).min(PI);
            let count = if psi < 1.2 { 3 } else { 5 };
            let step = 2.0 * psi / f64::from(count - 1);
            let n = if r > 0.0 { z / r } else { Vec2::new(1.0, 0.0) };
            self.sides.extend((0..count).map(|q| HalfPlane {
                normal: rotate(-psi + f64::from(q) * step, n),
                bound: b * (0.5 * step).cos(),
            }));
        }
    }
}

/// `vector`, shortened to `length_max` if it is longer.
fn clip(vector: Vec2, length_max: f64) -> Vec2 {
    let length = vector.norm();
    if length > length_max { vector * (length_max / length) } else { vector }
}

#[cfg(test)]
mod proof;

#[cfg(test)]
mod tests;
