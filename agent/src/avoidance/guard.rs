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
//! Walls and obstacles do not move, and each is the nearest point of a convex part: z, r and n as before,
//! with the clearance in place of d. The vector to that point changes by no more than the robot moves, so M
//! is (0 + v_own) H. Nobody else uses up slack, so that the robot may use up all of it: b is twice as
//! large, and E, with rho the slack to that part, does not fall by the robot alone. `proof/Walls.v` has this
//! checked by Coq.
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
//! | rho | slack r - d, m; beside a wall r - the clearance |
//! | b | how fast this robot may approach another, m/s |
//! | W-, W+ | range of turn rates that may be in force while this command acts, rad/s |

use std::collections::VecDeque;
use std::f64::consts::PI;

use formation::Vec2;
use formation::front_point::{front_speed, rotate};
use formation::pose::Twist;
use protocol::avoidance::{Advice, AvoidanceDescription, Conditions, Promise, Senses};
use protocol::brief::{AgentBrief, Pace};
use protocol::number::{short, told_apart};

use super::braking::slow_down_zone_m;
use super::braking_guard::{self, BrakingGuard};
use super::cone::{PASSES_MAX, ROUNDING_M, SIGMAS, cone_sides, direction, headings, swing};
use super::deflection::{
    ASIDE, Deflection, deflection_distance_m, wall_deflection_distance_m, wall_deflection_share,
};
use super::near::Kept;
use super::polygon::{HalfPlane, nearest_point};
use super::{Avoidance, AvoidanceRow, Sample, clip, exact_hold, within_speed};

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
        steers_within: Some(("d_f", deflection_distance_m)),
        steers_beside_walls: Some(("c_f", wall_deflection_distance_m)),
        aside: ASIDE,
        slow_down_zone_m: Some(slow_down_zone_m),
        speed_cap_m_s: Some(speed_cap_m_s),
        advice: braking,
        ..AvoidanceDescription::INERT
    },
    build: |brief, _| match brief.avoidance.braking_time_max_s > 0.0 {
        true => Box::new(BrakingGuard::new(brief)),
        false => Box::new(Guard::new(brief)),
    },
};

/// Nobody farther away than this can matter, and no wall, m. Where somebody has inertia, that of the guard
/// with inertia.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let [robots, walls] = match at.avoidance.braking_time_max_s > 0.0 {
        true => [braking_guard::robots_radius_m(at), braking_guard::walls_radius_m(at)],
        false => [robots_radius_m(at), walls_radius_m(at)],
    };
    if at.avoidance.clearance_m > 0.0 { robots.max(walls) } else { robots }
}

/// max(d + 3 v_max H, d_f + 4 v_max T) and twice eps, m.
fn robots_radius_m(at: &Conditions<'_>) -> f64 {
    let v_max = at.speed_m_s();
    let bounded = at.avoidance.distance_min_m + 3.0 * v_max * at.lifetime_s;
    let deflected = deflection_distance_m(at) + 4.0 * v_max * at.period_s;
    bounded.max(deflected) + 2.0 * at.distance_error_m()
}

/// The same for walls: max(clearance + 3/2 v_max H, c_f + v_max T / kappa) and twice eps, m.
fn walls_radius_m(at: &Conditions<'_>) -> f64 {
    let v_max = at.speed_m_s();
    let bounded = at.avoidance.clearance_m + 1.5 * v_max * at.lifetime_s;
    let deflected =
        wall_deflection_distance_m(at) + v_max * at.period_s / wall_deflection_share(at);
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
    kept: Kept,
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
    deflection: Deflection,
    /// Own commands that the plant may still obey: stamp answered, twist.
    alive: VecDeque<(u64, Twist)>,
    /// In real time, and where commands are delayed, those of an earlier incarnation may act until here.
    predecessor_until_ns: Option<u64>,
    remembers_predecessor: bool,
    sides: Vec<HalfPlane>,
}

impl Avoidance for Guard {
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
        let granted = if self.kept.is_blind(sample) {
            Twist::ZERO
        } else {
            self.bound(sample, within_speed(self.v_max, self.ell, wanted))
        };
        self.alive.push_back((sample.stamp_ns, granted));
        granted
    }
}

impl Guard {
    fn new(brief: &AgentBrief) -> Guard {
        let avoidance = &brief.avoidance;
        let at = Conditions::of(brief);
        let period = brief.period_ns as f64 / 1e9;
        let lifetime = brief.command_lifetime_ns as f64 / 1e9;
        Guard {
            kept: Kept::of(&at, [robots_radius_m(&at), walls_radius_m(&at)]),
            v_max: avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            period,
            lifetime,
            lifetime_ns: brief.command_lifetime_ns,
            distance_error: at.distance_error_m(),
            heading_error: avoidance.heading_error_rad,
            deflection: Deflection::new(brief),
            alive: VecDeque::new(),
            predecessor_until_ns: None,
            remembers_predecessor: brief.pace == Pace::Realtime || brief.late_ns > 0,
            sides: Vec::new(),
        }
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
            self.collect_sides(sample, v_own, spread);
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
        headings(heading_rad, self.lifetime, [w_low, w_high], self.heading_error)
    }

    /// For all near, the half-planes that bound the approach whatever the true direction
    /// (within asin(M/r) of n) and the true heading (within `spread` of its middle).
    ///
    /// The formulas of `proof/Guard.v::respects`, which `proof/Guard.v::certificate_holds` needs, and, beside
    /// walls, of `proof/Walls.v::respects_wall`; see
    /// `proof/Geometry.v::direction_within_asin` and `proof/Geometry.v::sides_bound_the_cone`.
    fn collect_sides(&mut self, sample: &Sample<'_>, v_own: f64, spread: f64) {
        let rate = 1.0 / self.lifetime; // Lambda
        self.sides.clear();
        for near in self.kept.near(sample) {
            let r = near.z.norm();
            let reach = (near.speed + v_own) * self.lifetime + self.distance_error; // M + eps
            let rho = (r - self.distance_error - near.kept - ROUNDING_M).max(0.0);
            let b = near.share * rate * (rho * (-2.0f64).exp()).max(rho - reach); // Lambda H = 1
            if b >= v_own {
                continue;
            }
            let psi = (spread + swing(reach, r)).min(PI);
            self.sides.extend(cone_sides(direction(near.z), psi, b));
        }
    }
}

#[cfg(test)]
mod proof;

#[cfg(test)]
pub(super) mod tests;
