//! The guard for robots with inertia: no two front points nearer than d, though nobody stops at once.
//!
//! It replaces the *bound* of the guard next door; the *deflection* is the same. It is used by all
//! robots as soon as one of them has limits, with one Lambda for all.
//!
//! What the plant promises: P1, the target of the wheels is the newest accepted command until its
//! stamp + H, else 0. P2, the twist y = (v, ell w) moves only on the straight segment towards the
//! target. P3, with the target 0 it goes to 0 on its ray, within its braking time ||y||. P4, odometry
//! reports the twist in force at its stamp.
//!
//! Why it is safe: a certificate at the sample s is about the set K = {0, the twist in force at s, own
//! commands still alive, the new one}: none of them approaches anybody faster than b, whatever
//! direction and heading become until s + H + tau_o. After the newest command that moves only members
//! of K are targets, so that y stays in their convex hull; the half-planes are linear in y, so that it
//! keeps them as well. From s + H on it brakes, and mu makes b so small that the approach shrinks at
//! least as fast as the slack may: (1 - x/tau_o) mu(2 Lambda tau_o) <= e^(-2 Lambda x). So at all
//! times the robot uses up at most its half of the slack, and E = e^(2 Lambda t) rho never falls, as
//! in the guard without inertia. `proof/Braking.v` has this checked by Coq, for any Lambda > 0 and any
//! accelerations.
//!
//! A command of 0 needs no certificate: it only brakes earlier, on a ray on which every twist keeps
//! the half-planes. That carries over what the other guard has rules for:
//!
//! - *Restart.* In real time, and where they are delayed, commands of a predecessor may act for H after the first sample. They
//!   cannot be certified, since nobody knows them, so the answer is 0 until they are dead. Then the
//!   twist in force says all about the predecessor that still matters. Else, in lockstep, no command of
//!   an earlier tick is alive at a sample.
//! - *Blind.* Who does not know all near answers 0.
//! - *Wheels* that are too weak, failing or stuck make of a command a part of it: the segment towards a
//!   part of a target lies in the hull of K as well, since 0 is in K.
//! - *Sensing error eps.* The true distance is r - eps or more: rho is taken shorter by eps. The true z
//!   stays within M + eps of what was sensed: M and M_H are longer by eps.
//! - *Heading error eta.* The path follows from y and the targets, in the robot's own frame, so that a
//!   wrong heading turns all of it as a whole: the true heading stays within delta + eta. The own
//!   front point is off by 2 ell sin(eta/2) at most, which is part of eps. y itself must be exact.
//! - *Robots without limits* among others have ||y|| = 0 and tau_o = 0, mu(0) = 1: what is left is the
//!   bound of the other guard, with the common Lambda, for which its proof asks nothing. They stop at
//!   once, so that the twist in force at a sample is that of a command alive, or 0.
//!
//! *Walls* and obstacles do not move: of the slack to one all is the robot's, so that Lambda in b is 2
//! Lambda, and the other's speed in M and M_H is 0. mu stays, since E falls at the same rate. Each convex
//! part counts by its nearest point; the vector from it changes by no more than the robot moves, and the
//! clearance is in place of d. `proof/Obstacles.v` has this checked by Coq. Lambda itself is that of all.
//!
//! Whoever has a zone of its own within which nobody is sensed twice matters: farther away than d + Z,
//! Z = v_max/(Lambda mu) min(e^(2 Lambda H), 1 + 2 Lambda H mu), b is v_max or more whatever the robot
//! does, and nobody needs to be sensed there; no wall from the clearance + Z/2 on.
//!
//! Not in the paper. Derived in `docs/explanation/inertia.md`.
//!
//! | symbol | meaning |
//! |---|---|
//! | y, \|y\| | (v, ell w), the front point's speed, m/s |
//! | \|\|y\|\| | max(\|v\|/a_v, \|w\|/a_w), how long braking takes, s |
//! | tau, tau_o | bound on \|\|y\|\| for all commands, and for those at hand, s |
//! | Y | twists with \|y\| <= v_max and \|\|y\|\| <= tau |
//! | Lambda | 1 / (H + the largest tau of all robots), 1/s |
//! | h | for how long a command may act: H, s; for the new one longer, so that it can be kept |
//! | rho, M, M_H | slack; how far z may move until all stand, and until s + h, m |
//! | b | how fast this robot may approach another, m/s |
//! | W-, W+ | range of turn rates that may be in force, rad/s |

use std::collections::VecDeque;
use std::f64::consts::PI;

use formation::Vec2;
use formation::front_point::{front_speed, rotate};
use formation::pose::Twist;
use protocol::avoidance::Conditions;
use protocol::brief::{AgentBrief, LimitsBrief, Pace};

use super::braking::{mu, rate_per_s, slow_down_zone_m};
use super::cone::{Cone, PASSES_MAX, ROUNDING_M, SIGMAS, direction, headings, swing};
use super::deflection::{
    Deflection, deflection_distance_m, deflection_share, wall_deflection_distance_m,
    wall_deflection_share,
};
use super::near::Kept;
use super::polygon::{HalfPlane, nearest_point};
use super::{Avoidance, Sample, clip, exact_hold, within_speed};

/// Commands are kept this share within what they may be: rounding must not take them out of it.
const WITHIN: f64 = 1.0 - 1e-12;

/// The larger of d + Z and of what the deflection needs, d_f + v_max T / kappa, and twice eps, m:
/// nobody farther away than this can matter.
pub fn robots_radius_m(at: &Conditions<'_>) -> f64 {
    let bounded = at.avoidance.distance_min_m + slow_down_zone_m(at);
    let deflected = deflection_distance_m(at) + at.speed_m_s() * at.period_s / deflection_share(at);
    bounded.max(deflected) + 2.0 * at.distance_error_m()
}

/// The same for walls: the clearance + Z/2, since twice as much is granted and they do not come, or
/// c_f + v_max T / kappa, and twice eps, m.
pub fn walls_radius_m(at: &Conditions<'_>) -> f64 {
    let bounded = at.avoidance.clearance_m + 0.5 * slow_down_zone_m(at);
    let along = at.speed_m_s() * at.period_s / wall_deflection_share(at);
    let deflected = wall_deflection_distance_m(at) + along;
    bounded.max(deflected) + 2.0 * at.distance_error_m()
}

/// State and constants of the guard of one robot.
pub struct BrakingGuard {
    kept: Kept,
    v_max: f64,
    ell: f64,
    /// T, s.
    period: f64,
    /// H, s.
    lifetime: f64,
    lifetime_ns: u64,
    /// Lambda, 1/s.
    rate: f64,
    limits: Option<LimitsBrief>,
    /// eps, m.
    distance_error: f64,
    /// eta, rad.
    heading_error: f64,
    deflection: Deflection,
    /// Own commands that the plant may still obey: stamp answered, twist.
    alive: VecDeque<(u64, Twist)>,
    /// In real time, and where commands are delayed, those of an earlier incarnation may act until here.
    predecessor_until_ns: Option<u64>,
    remembers_predecessor: bool,
    cones: Vec<Cone>,
    sides: Vec<HalfPlane>,
    without: Without,
}

/// What tests leave out, to show that it is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Without {
    Nothing,
    /// The twist in force is not certified.
    TwistInForce,
    /// Own commands that may still act are not certified.
    AliveCommands,
    /// M ends when the command dies.
    BrakingWay,
    /// The heading stays as it is when the command dies.
    BrakingTurn,
    /// mu = 1.
    Mu,
}

/// Bounds on all twists that a certificate is about.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    v_own: f64,
    tau_o: f64,
    /// W-, W+, rad/s.
    w: [f64; 2],
}

impl Avoidance for BrakingGuard {
    /// gamma, clipped to v_max: as it may be used and published.
    fn admit(&self, gamma: Vec2) -> Vec2 {
        clip(gamma, self.v_max)
    }

    fn stand_off(&mut self, away: &[Vec2], error: Vec2) -> Vec2 {
        self.deflection.stand_off(away, error)
    }

    /// The twist that moves the front point by gamma T.
    fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        exact_hold(heading_rad, self.ell, gamma * self.period, self.period)
    }

    /// The twist that answers `sample` when gamma is wanted.
    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        let p = self.deflection.deflect(sample, gamma * self.period);
        let wanted = exact_hold(sample.heading_effect_rad, self.ell, p, self.period);
        self.restrain(sample, wanted, gamma)
    }

    /// The part of `wanted` that keeps the promise: nothing leads it around others.
    fn restrain(&mut self, sample: &Sample<'_>, wanted: Twist, _: Vec2) -> Twist {
        self.forget_the_dead(sample.stamp_ns);
        let granted = if self.kept.is_blind(sample) || self.has_predecessor(sample.stamp_ns) {
            Twist::ZERO
        } else {
            self.bound(sample, within_speed(self.v_max, self.ell, wanted))
        };
        self.alive.push_back((sample.stamp_ns, granted));
        granted
    }
}

impl BrakingGuard {
    /// The guard of the robot of this brief.
    pub fn new(brief: &AgentBrief) -> BrakingGuard {
        let avoidance = &brief.avoidance;
        let at = Conditions::of(brief);
        BrakingGuard {
            kept: Kept::of(&at, [robots_radius_m(&at), walls_radius_m(&at)]),
            v_max: avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            period: at.period_s,
            lifetime: at.lifetime_s,
            lifetime_ns: brief.command_lifetime_ns,
            rate: rate_per_s(&at),
            limits: brief.limits,
            distance_error: at.distance_error_m(),
            heading_error: avoidance.heading_error_rad,
            deflection: Deflection::new(brief),
            alive: VecDeque::new(),
            predecessor_until_ns: None,
            remembers_predecessor: brief.pace == Pace::Realtime || brief.late_ns > 0,
            cones: Vec::new(),
            sides: Vec::new(),
            without: Without::Nothing,
        }
    }

    /// What remains is what may still act: `proof/Inertia.v::what_acts_since_the_last_sample`.
    fn forget_the_dead(&mut self, stamp_ns: u64) {
        let lifetime_ns = self.lifetime_ns;
        self.alive.retain(|(answered_ns, _)| answered_ns + lifetime_ns > stamp_ns);
        if self.remembers_predecessor && self.predecessor_until_ns.is_none() {
            self.predecessor_until_ns = Some(stamp_ns + lifetime_ns);
        }
    }

    /// Commands of an earlier incarnation may act.
    fn has_predecessor(&self, stamp_ns: u64) -> bool {
        self.predecessor_until_ns.is_some_and(|until_ns| stamp_ns < until_ns)
    }

    /// ||y||, s: `proof/Inertia.v::braking_time`.
    fn braking_time(&self, twist: Twist) -> f64 {
        self.limits.map_or(0.0, |limits| limits.accelerations().time_s(twist))
    }

    /// `twist`, slowed down on its path into Y.
    fn within_y(&self, twist: Twist) -> Twist {
        let twist = within_speed(self.v_max, self.ell, twist);
        let (time, most) =
            (self.braking_time(twist), self.limits.map_or(0.0, |limits| limits.braking_time_s));
        if time > WITHIN * most { twist.scaled(WITHIN * most / time) } else { twist }
    }

    /// What the wheels can do of it within H, on the segment from `now`.
    fn within_reach(&self, now: Twist, tried: Twist) -> Twist {
        let change = Twist { v_m_s: tried.v_m_s - now.v_m_s, w_rad_s: tried.w_rad_s - now.w_rad_s };
        let time = self.braking_time(change);
        if time <= self.lifetime {
            return tried;
        }
        let part = change.scaled(self.lifetime / time);
        Twist { v_m_s: now.v_m_s + part.v_m_s, w_rad_s: now.w_rad_s + part.w_rad_s }
    }

    /// The part of `wanted` that keeps the promise; without one that does, the brakes for one sample.
    fn bound(&mut self, sample: &Sample<'_>, wanted: Twist) -> Twist {
        // Who stops at once has no twist of its own at a sample.
        let now = if self.limits.is_some() { sample.twist } else { Twist::ZERO };
        let mut best: Option<(f64, Twist)> = None;
        for sigma in SIGMAS {
            let tried = self.within_reach(now, self.within_y(wanted.scaled(sigma)));
            let Some(granted) = self.grant(sample, now, tried) else { continue };
            if sigma == 1.0 && granted == tried {
                return granted;
            }
            let merit = granted.v_m_s * wanted.v_m_s
                + self.ell * self.ell * granted.w_rad_s * wanted.w_rad_s;
            if best.is_none_or(|(merit_best, _)| merit > merit_best.max(0.0)) {
                best = Some((merit, granted));
            }
        }
        let kept = |guard: &mut BrakingGuard| guard.grant(sample, now, guard.within_y(now));
        best.map(|(_, granted)| granted).or_else(|| kept(self)).unwrap_or(Twist::ZERO)
    }

    /// The nearest to `tried` for which there is a certificate: `proof/Braking.v::certified`.
    fn grant(&mut self, sample: &Sample<'_>, now: Twist, tried: Twist) -> Option<Twist> {
        let mut bounds = Bounds { v_own: 0.0, tau_o: 0.0, w: [0.0; 2] };
        self.cover(&mut bounds, tried);
        if self.without != Without::TwistInForce {
            self.cover(&mut bounds, now);
        }
        if self.without != Without::AliveCommands {
            for k in 0..self.alive.len() {
                self.cover(&mut bounds, self.alive[k].1);
            }
        }
        for pass in 1..=PASSES_MAX {
            let mid = self.collect_cones(sample, self.lifetime, bounds);
            let holds = |twist: Twist| {
                let u = rotate(mid, Vec2::new(twist.v_m_s, self.ell * twist.w_rad_s));
                self.cones.iter().all(|cone| cone.permits(u))
            };
            let in_force = self.without == Without::TwistInForce || holds(now);
            let alive = self.without == Without::AliveCommands
                || self.alive.iter().all(|(_, twist)| holds(*twist));
            if !(in_force && alive) {
                return None;
            }
            let granted = self.nearest(sample, tried, bounds);
            let [w_low, w_high] = bounds.w;
            let fits = (w_low..=w_high).contains(&granted.w_rad_s)
                && self.braking_time(granted) <= bounds.tau_o;
            if fits {
                return Some(granted);
            }
            self.cover(&mut bounds, granted);
            if pass == PASSES_MAX - 1 {
                let most = bounds.v_own / self.ell;
                bounds.w = [bounds.w[0].min(-most), bounds.w[1].max(most)];
                bounds.tau_o =
                    bounds.tau_o.max(self.limits.map_or(0.0, |limits| limits.braking_time_s));
            }
        }
        None
    }

    /// Widens `bounds` to hold for `twist`: `proof/Inertia.v::fits`.
    fn cover(&self, bounds: &mut Bounds, twist: Twist) {
        bounds.v_own = bounds.v_own.max(front_speed(self.ell, twist));
        bounds.tau_o = bounds.tau_o.max(self.braking_time(twist));
        bounds.w = [bounds.w[0].min(twist.w_rad_s), bounds.w[1].max(twist.w_rad_s)];
    }

    /// `tried`, or what is nearest to it and approaches nobody faster than b. For H + T: what is
    /// granted now can then still be certified, as the twist in force, at the next sample.
    fn nearest(&mut self, sample: &Sample<'_>, tried: Twist, bounds: Bounds) -> Twist {
        let mid = self.collect_cones(sample, self.lifetime + self.period, bounds);
        let u = rotate(mid, Vec2::new(tried.v_m_s, self.ell * tried.w_rad_s));
        if self.cones.iter().all(|cone| cone.permits(u)) {
            return tried;
        }
        self.sides.clear();
        self.sides.extend(self.cones.iter().flat_map(Cone::sides));
        let Some(u) = nearest_point(u, &self.sides) else { return tried };
        let body = rotate(-mid, u);
        self.within_y(Twist { v_m_s: body.x, w_rad_s: body.y / self.ell })
    }

    /// For all near, the directions that are possible until all stand, and the approach that is
    /// permitted in them; and the middle of the headings that are possible until then, rad.
    ///
    /// The formulas of `proof/Braking.v::certified_against`: `proof/Braking.v::swept`,
    /// `proof/Braking.v::turning_time` and `proof/Braking.v::braking_bound`.
    fn collect_cones(&mut self, sample: &Sample<'_>, h: f64, bounds: Bounds) -> f64 {
        let Bounds { v_own, tau_o, w } = bounds;
        let turning = if self.without == Without::BrakingTurn { h } else { h + 0.5 * tau_o };
        let (mid, spread) = headings(sample.heading_rad, turning, w, self.heading_error);
        let way = if self.without == Without::BrakingWay { 0.0 } else { tau_o };
        let less = if self.without == Without::Mu { 1.0 } else { mu(2.0 * self.rate * tau_o) };
        self.cones.clear();
        for near in self.kept.near(sample) {
            let r = near.z.norm();
            let rho = (r - self.distance_error - near.kept - ROUNDING_M).max(0.0);
            let reach_h = (v_own + near.speed) * h + self.distance_error; // M_H + eps
            let reach = v_own * (h + 0.5 * way) + near.speed * (h + way) + self.distance_error; // M + eps
            let rate = near.share * self.rate;
            let b = rate * less * ((-2.0 * self.rate * h).exp() * rho).max(rho - reach_h);
            if b < v_own {
                let psi = (spread + swing(reach, r)).min(PI);
                self.cones.push(Cone { n: direction(near.z), psi, b });
            }
        }
        mid
    }
}

#[cfg(test)]
mod lemma;
#[cfg(test)]
mod proof;
#[cfg(test)]
mod tests;
