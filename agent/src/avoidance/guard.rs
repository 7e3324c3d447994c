//! The guard: no two front points nearer than d, whatever is sampled late, frozen or killed, also where
//! nobody stops at once.
//!
//! Two parts. *Deflect* keeps the chapter's unstable focus as the way around others, only as
//! strong as needed; it is comfort. *Bound* restricts the command so that the robot gives up no more
//! than its half of the slack to anybody near, for as long as the plant may obey it (the lifetime H,
//! counted from the sample's stamp) and until its wheels stand; it is the promise. Whatever *deflect*
//! wants, of whatever rank, passes through the same half-planes, which know d, v_max, H and Lambda
//! alone: the promise does not depend on who gives way to whom.
//!
//! What the plant promises: P1, the target of the wheels is the newest accepted command until its
//! stamp + H, else 0; late and old ones are refused, and no target is faster than v_max. P2, the twist
//! y = (v, ell w) moves only on the straight segment towards the target. P3, with the target 0 it goes
//! to 0 on its ray, within its braking time ||y||. P4, odometry reports the twist in force at its stamp.
//!
//! Why it is safe: a certificate at the sample s is about the set K = {0, the twist in force at s, own
//! commands still alive, the new one}: none of them approaches anybody faster than b, whatever
//! direction and heading become until s + H + tau_o. After the newest command that moves only members
//! of K are targets, so that y stays in their convex hull; the half-planes are linear in y, so that it
//! keeps them as well. From s + H on it brakes, and mu makes b so small that the approach shrinks at
//! least as fast as the slack may: (1 - x/tau_o) mu(2 Lambda tau_o) <= e^(-2 Lambda x). So at all
//! times the robot uses up at most its half of the slack, and E = e^(2 Lambda t) rho never falls.
//! Nothing about latency, phase, freezes or deaths is used: they only cause refusals and stops.
//!
//! Where everybody stops at once, tau_o = 0, mu = 1 and Lambda = 1/H, and y jumps from target to target:
//! each moment belongs to one command, which was certified at its own sample. So the certificate is about
//! the new command alone; the others alive say only how far the robot may get and turn meanwhile.
//!
//! - *Zero* needs no certificate: it only brakes earlier, on a ray on which every twist keeps the
//!   half-planes.
//! - *Restart.* In real time, and where they are delayed, commands of a predecessor may act for H after
//!   the first sample. Nobody knows them, so that with inertia none can be certified, and the answer is 0
//!   until they are dead. Then the twist in force says all about the predecessor that still matters.
//!   Without, they count as the worst that there can be, v_max and +-v_max/ell: to stand instead would
//!   cost H in every run. Else, in lockstep, no command of an earlier tick is alive at a sample.
//! - *Blind.* Who does not know all near answers 0.
//! - *Wheels* that are too weak, failing or stuck make of a command a part of it: the segment towards a
//!   part of a target lies in the hull of K as well, since 0 is in K.
//! - *Sensing error eps.* The true distance is r - eps or more: rho is taken shorter by eps. The true z
//!   stays within M + eps of what was sensed: M and M_H are longer by eps.
//! - *Heading error eta.* The path follows from y and the targets, in the robot's own frame, so that a
//!   wrong heading turns all of it as a whole: the true heading stays within delta + eta. The own
//!   front point is off by 2 ell sin(eta/2) at most, which is part of eps. y itself must be exact.
//! - *Walls* and obstacles do not move: of the slack to one all is the robot's, so that Lambda in b is 2
//!   Lambda, and the other's speed in M and M_H is 0. mu stays, since E falls at the same rate. Each convex
//!   part counts by its nearest point; the vector from it changes by no more than the robot moves, and the
//!   clearance is in place of d.
//! - *Who is far.* From d + Z on, Z = v_max/(Lambda mu) min(e^(2 Lambda H), 1 + 2 Lambda H mu), b is v_max
//!   or more whatever the robot does; from the clearance + Z/2 on beside a wall.
//!
//! The folder `proof` has this checked by Coq, for any Lambda > 0 and any accelerations; comments name its
//! lemma where a rule is needed. In words: `docs/explanation/guard.md`, `inertia.md`. Not in the paper.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n | own minus other, its length, its direction |
//! | y, \|y\| | (v, ell w), the front point's speed, m/s |
//! | \|\|y\|\| | max(\|v\|/a_v, \|w\|/a_w), how long braking takes, s; 0 for who stops at once |
//! | tau, tau_o | bound on \|\|y\|\| for all commands, and for those at hand, s |
//! | Y | twists with \|y\| <= v_max and \|\|y\|\| <= tau |
//! | Lambda | 1 / (H + the largest tau of all robots), 1/s |
//! | h | for how long a command may act: H, s; for one that is certified again longer, so that it can be |
//! | eps, eta | bounds on the errors of a sensed distance, m, and of the heading, rad |
//! | rho | slack r - d, m; beside a wall r - the clearance |
//! | M_H, M | how far z may move until s + h, and until all stand, m |
//! | b | how fast this robot may approach another, m/s |
//! | W-, W+ | range of turn rates that may be in force, rad/s |

use std::collections::VecDeque;
use std::f64::consts::PI;

use formation::Vec2;
use formation::front_point::{front_speed, rotate};
use formation::pose::Twist;
use formation::real;
use protocol::avoidance::{Advice, AvoidanceDescription, Conditions, Promise, Senses};
use protocol::brief::{AgentBrief, LimitsBrief, Pace};
use protocol::number::{short, told_apart};
use protocol::planted;

use super::braking::{Braking, rate_per_s, slow_down_zone_m};
use super::cone::{Cone, PASSES_MAX, ROUNDING_M, SIGMAS, direction, headings, swing};
use super::deflection::{
    ASIDE, Deflection, GAINS, deflection_distance_m, deflection_share, look_ahead_radius_m,
    wall_deflection_distance_m, wall_deflection_share,
};
use super::near::Vicinity;
use super::polygon::{HalfPlane, nearest_point};
use super::{Avoidance, AvoidanceRow, Sample, clip, exact_hold, within_speed};

/// Commands are kept this share within what they may be: rounding must not take them out of it.
const WITHIN: f64 = 1.0 - 1e-12;

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "guard",
        source: "not in the chapter",
        promise: Promise::Always,
        promises: "d and the clearance, whatever is sampled late, frozen, lost or killed",
        assumes: "everybody uses it, senses all near within known errors, and its wheels do no more than \
                  asked",
        clamps_speed: true,
        senses: Senses::Positions,
        minds_walls: true,
        sensing_radius_m,
        useful_radius_m: Some(look_ahead_radius_m),
        steers_within: Some(("d_f", deflection_distance_m)),
        steers_beside_walls: Some(("c_f", wall_deflection_distance_m)),
        aside: ASIDE,
        slow_down_zone_m: Some(slow_down_zone_m),
        speed_cap_m_s: Some(speed_cap_m_s),
        gains: GAINS,
        advice: brakes_a_lot,
    },
    build: |brief, _| Box::new(Guard::new(brief)),
};

/// Nobody farther away than this can matter, and no wall, m.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let [robots, walls] = [robots_radius_m(at), walls_radius_m(at)];
    if at.avoidance.clearance_m > 0.0 { robots.max(walls) } else { robots }
}

/// The larger of d + Z and of what the deflection needs, d_f + v_max T / kappa, and twice eps, m. Z is
/// 3 v_max H where everybody stops at once.
fn robots_radius_m(at: &Conditions<'_>) -> f64 {
    let bounded = at.avoidance.distance_min_m + slow_down_zone_m(at);
    let deflected = deflection_distance_m(at) + at.speed_m_s() * at.period_s / deflection_share(at);
    bounded.max(deflected) + 2.0 * at.distance_error_m()
}

/// The same for walls: the clearance + Z/2, since twice as much is granted and they do not come, or
/// c_f + v_max T / kappa, and twice eps, m.
fn walls_radius_m(at: &Conditions<'_>) -> f64 {
    let bounded = at.avoidance.clearance_m + 0.5 * slow_down_zone_m(at);
    let along = at.speed_m_s() * at.period_s / wall_deflection_share(at);
    let deflected = wall_deflection_distance_m(at) + along;
    bounded.max(deflected) + 2.0 * at.distance_error_m()
}

/// min(d/4, ell/2) / H, m/s.
fn speed_cap_m_s(at: &Conditions<'_>) -> f64 {
    (0.25 * at.avoidance.distance_min_m).min(0.5 * at.front_point_m) / at.lifetime_s
}

/// Above the cap on v_max it brakes more than it helps.
fn brakes_a_lot(at: &Conditions<'_>) -> Option<Advice> {
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
    vicinity: Vicinity,
    v_max: f64,
    ell: f64,
    /// T, s.
    period: f64,
    /// H, s.
    lifetime: f64,
    lifetime_ns: u64,
    /// Lambda, 1/s.
    rate: f64,
    /// Somebody has inertia: on the way to a command's twist, others are in force.
    gradual: bool,
    /// The robot's own inertia; `None`: it stops at once.
    limits: Option<LimitsBrief>,
    braking: Braking,
    /// For a command as it is, and for one that is certified again.
    horizons: [Horizon; 2],
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
}

/// How far ahead a certificate looks.
#[derive(Debug, Clone, Copy)]
struct Horizon {
    /// h, s.
    h: f64,
    /// e^(-2 Lambda h).
    lasting: f64,
}

impl Horizon {
    fn new(rate: f64, h: f64) -> Horizon {
        Horizon { h, lasting: real::exp(-2.0 * rate * h) }
    }
}

/// Bounds on all twists that may be in force until the robot stands.
#[derive(Debug, Clone, Copy, Default)]
struct Bounds {
    v_own: f64,
    tau_o: f64,
    /// W-, W+, rad/s.
    w: [f64; 2],
}

impl Bounds {
    /// Of whatever a robot that stops at once may do.
    fn worst(v_max: f64, ell: f64) -> Bounds {
        let w_max = v_max / ell;
        Bounds { v_own: v_max, tau_o: 0.0, w: [-w_max, w_max] }
    }
}

impl Avoidance for Guard {
    /// gamma, clipped to v_max: as it may be used and published.
    fn admit(&self, gamma: Vec2) -> Vec2 {
        clip(gamma, self.v_max)
    }

    fn stand_off(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        self.deflection.stand_off(sample, error)
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
        let unknown = self.gradual && self.has_predecessor(sample.stamp_ns);
        let granted = match unknown || self.vicinity.is_blind(sample) {
            true => Twist::ZERO,
            false => self.bound(sample, within_speed(self.v_max, self.ell, wanted)),
        };
        if !planted::is("alive-forgotten") {
            self.alive.push_back((sample.stamp_ns, granted));
        }
        granted
    }
}

impl Guard {
    fn new(brief: &AgentBrief) -> Guard {
        let avoidance = &brief.avoidance;
        let at = Conditions::of(brief);
        let (rate, gradual) = (rate_per_s(&at), avoidance.braking_time_max_s > 0.0);
        let again = at.lifetime_s + if gradual { at.period_s } else { 0.0 };
        Guard {
            vicinity: Vicinity::new(&at, [robots_radius_m(&at), walls_radius_m(&at)]),
            v_max: avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            period: at.period_s,
            lifetime: at.lifetime_s,
            lifetime_ns: brief.command_lifetime_ns,
            rate,
            gradual,
            limits: brief.limits,
            braking: Braking::default(),
            horizons: [at.lifetime_s, again].map(|h| Horizon::new(rate, h)),
            distance_error: at.distance_error_m(),
            heading_error: avoidance.heading_error_rad,
            deflection: Deflection::new(brief),
            alive: VecDeque::new(),
            predecessor_until_ns: None,
            remembers_predecessor: brief.pace == Pace::Realtime || brief.late_ns > 0,
            cones: Vec::new(),
            sides: Vec::new(),
        }
    }

    /// What remains is what may still act: `proof/Time.v::covers_the_alive`,
    /// `proof/Inertia.v::what_acts_since_the_last_sample`.
    fn forget_the_dead(&mut self, stamp_ns: u64) {
        let lifetime_ns = self.lifetime_ns;
        self.alive.retain(|(answered_ns, _)| answered_ns + lifetime_ns > stamp_ns);
        if self.remembers_predecessor && self.predecessor_until_ns.is_none() {
            self.predecessor_until_ns = Some(stamp_ns + lifetime_ns);
        }
    }

    /// Commands of an earlier incarnation may act:
    /// `proof/Time.v::after_the_first_lifetime_no_predecessor_is_alive`.
    fn has_predecessor(&self, stamp_ns: u64) -> bool {
        self.predecessor_until_ns.is_some_and(|until_ns| stamp_ns < until_ns)
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
        if let Some((_, granted)) = best {
            return granted;
        }
        self.grant(sample, now, self.within_y(now)).unwrap_or(Twist::ZERO)
    }

    /// ||y||, s: `proof/Inertia.v::braking_time`.
    fn braking_time(&self, twist: Twist) -> f64 {
        self.limits.map_or(0.0, |limits| limits.accelerations().time_s(twist))
    }

    /// `twist`, slowed down on its path into Y.
    fn within_y(&self, twist: Twist) -> Twist {
        let Some(limits) = self.limits else { return twist };
        let twist = within_speed(self.v_max, self.ell, twist);
        let (time, most) = (self.braking_time(twist), WITHIN * limits.braking_time_s);
        if time > most { twist.scaled(most / time) } else { twist }
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

    /// The nearest to `tried` for which there is a certificate: `proof/Time.v::certified`, or, where
    /// somebody has inertia, `proof/Braking.v::certified`.
    ///
    /// The bounds hold for every command that may act, or have acted since the sample:
    /// `proof/Time.v::wheels_since_the_sample`, `proof/Inertia.v::fits`.
    fn grant(&mut self, sample: &Sample<'_>, now: Twist, tried: Twist) -> Option<Twist> {
        let remembered = !planted::is("predecessor-forgotten");
        let mut bounds = match remembered && self.has_predecessor(sample.stamp_ns) {
            true => Bounds::worst(self.v_max, self.ell),
            false => Bounds::default(),
        };
        let alive = self.alive.iter().map(|(_, twist)| *twist);
        for twist in alive.chain([now, tried]) {
            self.cover(&mut bounds, twist);
        }
        for pass in 1..=PASSES_MAX {
            if self.gradual && !self.is_certified_still(sample, now, bounds) {
                return None;
            }
            let granted = self.nearest(sample, tried, bounds);
            let [w_low, w_high] = bounds.w;
            let in_range = (w_low..=w_high).contains(&granted.w_rad_s);
            if in_range && self.braking_time(granted) <= bounds.tau_o {
                return Some(granted);
            }
            self.cover(&mut bounds, granted);
            if pass == PASSES_MAX - 1 {
                let most = bounds.v_own / self.ell;
                bounds.w = [bounds.w[0].min(-most), bounds.w[1].max(most)];
                let tau = self.limits.map_or(0.0, |limits| limits.braking_time_s);
                bounds.tau_o = bounds.tau_o.max(tau);
            }
        }
        None
    }

    /// Widens `bounds` to hold for `twist`.
    fn cover(&self, bounds: &mut Bounds, twist: Twist) {
        bounds.v_own = bounds.v_own.max(front_speed(self.ell, twist));
        bounds.tau_o = bounds.tau_o.max(self.braking_time(twist));
        bounds.w = [bounds.w[0].min(twist.w_rad_s), bounds.w[1].max(twist.w_rad_s)];
    }

    /// The twist in force and the commands alive approach nobody faster than b.
    fn is_certified_still(&mut self, sample: &Sample<'_>, now: Twist, bounds: Bounds) -> bool {
        let mid = self.collect_cones(sample, self.horizons[0], bounds);
        let mut certified = self.alive.iter().map(|(_, twist)| *twist).chain([now]);
        certified.all(|twist| {
            let u = rotate(mid, Vec2::new(twist.v_m_s, self.ell * twist.w_rad_s));
            self.cones.iter().all(|cone| cone.permits(u))
        })
    }

    /// `tried`, or what is nearest to it and approaches nobody faster than b. What has to be certified
    /// again at the next sample, as the twist in force, is bounded for H + T, so that it can be.
    fn nearest(&mut self, sample: &Sample<'_>, tried: Twist, bounds: Bounds) -> Twist {
        let mut horizon = self.horizons[1];
        if planted::is("alive-forgotten")
            || planted::is("predecessor-forgotten") && self.has_predecessor(sample.stamp_ns)
        {
            horizon = Horizon::new(self.rate, horizon.h - self.lifetime + self.period);
        }
        let mid = self.collect_cones(sample, horizon, bounds);
        let u = rotate(mid, Vec2::new(tried.v_m_s, self.ell * tried.w_rad_s));
        if self.gradual && self.cones.iter().all(|cone| cone.permits(u)) {
            return tried;
        }
        self.sides.clear();
        self.sides.extend(self.cones.iter().flat_map(Cone::sides));
        if planted::is("half-plane-dropped") {
            self.sides.drain(..self.sides.len().saturating_sub(32));
        }
        let Some(u) = nearest_point(u, &self.sides) else { return tried };
        let body = rotate(-mid, u);
        self.within_y(Twist { v_m_s: body.x, w_rad_s: body.y / self.ell })
    }

    /// For all near, the directions that are possible until all stand, and the approach that is
    /// permitted in them; and the middle of the headings that are possible until then, rad.
    ///
    /// The formulas of `proof/Braking.v::certified_against`: `proof/Braking.v::swept`,
    /// `proof/Braking.v::turning_time` and `proof/Braking.v::braking_bound`; for tau_o = 0 those of
    /// `proof/Guard.v::respects` and `proof/Walls.v::respects_wall`.
    fn collect_cones(&mut self, sample: &Sample<'_>, horizon: Horizon, bounds: Bounds) -> f64 {
        let Bounds { v_own, tau_o, w } = bounds;
        let Horizon { h, lasting } = horizon;
        let Braking { way, turn, mu } = self.braking;
        let (mid, spread) = headings(sample.heading_rad, h + turn * tau_o, w, self.heading_error);
        let brakes_for = way * tau_o;
        let less = mu(2.0 * self.rate * tau_o);
        self.cones.clear();
        for near in self.vicinity.near(sample) {
            let r = near.z.norm();
            let rho = (r - self.distance_error - near.distance_min - ROUNDING_M).max(0.0);
            let reach_h = (near.speed + v_own) * h + self.distance_error; // M_H + eps
            let b = near.share * self.rate * less * (lasting * rho).max(rho - reach_h);
            if b >= v_own {
                continue;
            }
            let reach = match brakes_for > 0.0 {
                true => {
                    let own = v_own * (h + 0.5 * brakes_for);
                    own + near.speed * (h + brakes_for) + self.distance_error // M + eps
                }
                false => reach_h,
            };
            let psi = (spread + swing(reach, r)).min(PI);
            self.cones.push(Cone { n: direction(near.z), psi, b });
        }
        mid
    }
}

#[cfg(test)]
mod formulas;
#[cfg(test)]
mod lemma;
#[cfg(test)]
mod proof;
#[cfg(test)]
pub(super) mod tests;
