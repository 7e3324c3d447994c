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
//!
//! Right of way is part of *deflect* alone: a robot that gives way has a larger d_f, so that it is
//! led around the others before they are led around it. *Bound* knows d, v_max and H, which are
//! the same for all, and takes nothing from d_f: whatever *deflect* wants, of however many ranks,
//! passes through the same half-planes. So the promise does not depend on who gives way to whom.
//!
//! Everything is computed from one odometry sample. Not in the paper.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n, t | own minus other, its length, its direction, n turned +90 degrees |
//! | p | displacement wanted within one period T, m; \|p\| <= V = v_max T |
//! | d_f | distance at which the deflection begins to matter, m |
//! | M | how far two robots can move relative to each other while a command acts, m |
//! | rho | slack r - d, m |
//! | b | how fast this robot may approach another, m/s |
//! | W-, W+ | range of turn rates that may be in force while this command acts, rad/s |

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use formation::Vec2;
use formation::front_point::{front_speed, rotate};
use formation::pose::Twist;
use protocol::avoidance::{Advice, AvoidanceDescription, Conditions, Promise, Senses};
use protocol::brief::{AgentBrief, Pace};
use protocol::number::short;

use super::polygon::{HalfPlane, nearest_point};
use super::{Avoidance, AvoidanceRow, Sample, exact_hold};
use crate::golden_phase;

/// kappa: the deflection begins where a period's approach exceeds this share of the slack to d_f.
const KAPPA: f64 = 0.25;
/// A: how far the dither turns the wanted displacement, rad.
const DITHER_RAD: f64 = 1.0;
/// The dither's shortest period, s; each robot has its own, so that no pair stays symmetric.
const DITHER_PERIOD_S: f64 = 1.5;
/// d_f of a robot that gives way, as a multiple of the others'. Measured over all single deaths and
/// cuts of the shipped scenarios: with 1.2 nobody that leads or keeps a place is held up by one that
/// gives way; from 1.8 on those that give way disturb each other.
const GIVES_WAY: f64 = 1.2;
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
    if at.gives_way { GIVES_WAY * d_f } else { d_f }
}

/// max(d + 3 v_max H, d_f + 4 v_max T) and twice the sensing error, m: nobody farther away than
/// this can matter.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let v_max = at.speed_m_s();
    let bounded = at.avoidance.distance_min_m + 3.0 * v_max * at.lifetime_s;
    let deflected = deflection_distance_m(at) + 4.0 * v_max * at.period_s;
    bounded.max(deflected) + 2.0 * at.avoidance.sensing_error_m
}

/// min(d/4, ell/2) / H, m/s.
fn speed_cap_m_s(at: &Conditions<'_>) -> f64 {
    (0.25 * at.avoidance.distance_min_m).min(0.5 * at.front_point_m) / at.lifetime_s
}

/// Above the cap on v_max it brakes more than it helps.
fn braking(at: &Conditions<'_>) -> Option<Advice> {
    let (v_max, cap) = (at.avoidance.speed_max_m_s, speed_cap_m_s(at));
    (v_max.is_finite() && v_max > cap).then(|| Advice {
        key: "speed_max_m_s",
        message: format!(
            "the speed limit {} m/s is above min(d/4, ell/2) / H = {} m/s: safe, but the guard \
             will brake a lot",
            short(v_max),
            short(cap)
        ),
        expected: format!(
            "expected at most {} m/s, or a shorter H (now {} s)",
            short(cap),
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
    /// Bound on the error of a reported position, m.
    sensing_error: f64,
    /// d_f, m.
    d_f: f64,
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
            sensing_error: avoidance.sensing_error_m,
            d_f: deflection_distance_m(&at),
            radius_needed: sensing_radius_m(&at),
            dither_period: DITHER_PERIOD_S * (1.0 + 4.0 * phase / 3.0),
            dither_phase: phase,
            alive: VecDeque::new(),
            predecessor_until_ns: None,
            remembers_predecessor: brief.pace == Pace::Realtime,
            sides: Vec::new(),
        }
    }

    /// Nothing, or not enough, is known about who is near.
    fn is_blind(&self, sample: &Sample<'_>) -> bool {
        let farthest = sample.away.last().map_or(0.0, |z| z.norm());
        !sample.proximity_valid || sample.proximity_cut && farthest < self.radius_needed
    }

    fn forget_the_dead(&mut self, stamp_ns: u64) {
        let lifetime_ns = self.lifetime_ns;
        self.alive.retain(|(answered_ns, _)| answered_ns + lifetime_ns > stamp_ns);
        if self.remembers_predecessor && self.predecessor_until_ns.is_none() {
            self.predecessor_until_ns = Some(stamp_ns + lifetime_ns);
        }
    }

    /// The wanted displacement `p`, led around those it would come too near.
    fn deflect(&self, sample: &Sample<'_>, mut p: Vec2) -> Vec2 {
        let reach = self.v_max * self.period; // V
        let excess = |r: f64| -KAPPA * (r - self.d_f);
        let blocked = sample.away.iter().any(|z| {
            let r = z.norm();
            z.dot(&p) < excess(r) * r
        });
        if blocked {
            let turns = sample.t_s / self.dither_period + self.dither_phase;
            p = rotate(DITHER_RAD * (TAU * turns).sin(), p);
        }
        for _ in 0..2 {
            for z in sample.away.iter().rev() {
                let r = z.norm();
                if -excess(r) < reach && r > 0.0 {
                    let n = z / r;
                    let lambda = (excess(r) - n.dot(&p)).max(0.0);
                    p += lambda * (n + Vec2::new(-n.y, n.x));
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
            let mid = sample.heading_rad + 0.5 * self.lifetime * (w_low + w_high);
            let spread = 0.5 * self.lifetime * (w_high - w_low);
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

    /// For everybody near, the half-planes that bound the approach whatever the true direction
    /// (within asin(M/r) of n) and the true heading (within `spread` of its middle).
    fn collect_sides(&mut self, away: &[Vec2], v_own: f64, spread: f64) {
        let rate = 1.0 / self.lifetime; // Lambda
        let reach = (self.v_max + v_own) * self.lifetime + self.sensing_error; // M
        self.sides.clear();
        for z in away {
            let r = z.norm();
            let rho = (r - self.sensing_error - self.d - ROUNDING_M).max(0.0);
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
mod tests {
    use super::*;
    use formation::front_point::{front_point, front_velocity};
    use formation::pose::Pose;
    use formation::unicycle::arc;
    use proptest::prelude::*;
    use protocol::brief::{AvoidanceBrief, Format, PublishedVelocity, SilenceBrief, SilencePolicy};

    fn guard(d: f64, v_max: f64, ell: f64, period_ns: u64, lifetime_ns: u64) -> Guard {
        Guard::new(&brief(d, v_max, ell, period_ns, lifetime_ns))
    }

    fn brief(d: f64, v_max: f64, ell: f64, period_ns: u64, lifetime_ns: u64) -> AgentBrief {
        AgentBrief {
            format: Format,
            name: "r1".into(),
            index: 1,
            run_root: "/nowhere".into(),
            pace: Pace::Realtime,
            period_ns,
            plant_tick_ns: 1_000_000,
            command_lifetime_ns: lifetime_ns,
            front_point_m: ell,
            law: String::new(),
            gains: Default::default(),
            led: false,
            gives_way: false,
            lead: None,
            published_velocity: PublishedVelocity::Gamma,
            avoidance: AvoidanceBrief {
                kind: "guard".into(),
                distance_min_m: d,
                speed_max_m_s: v_max,
                sensing_radius_m: f64::INFINITY,
                sensing_error_m: 0.0,
                gains: Default::default(),
            },
            silence: SilenceBrief {
                stale_after_ns: 1,
                lost_after_ns: 1,
                policy: SilencePolicy::Ignore,
            },
            slow: Vec::new(),
            links_by_hand: false,
            neighbors: Vec::new(),
        }
    }

    fn sample<'a>(stamp_ns: u64, pose: Pose, away: &'a [Vec2]) -> Sample<'a> {
        Sample {
            stamp_ns,
            t_s: stamp_ns as f64 / 1e9,
            heading_rad: pose.heading_rad,
            heading_effect_rad: pose.heading_rad,
            away,
            proximity_valid: true,
            proximity_cut: false,
            velocities: &[],
        }
    }

    #[test]
    fn one_that_gives_way_is_led_around_from_farther_away_and_asks_for_a_wider_view() {
        let (d, v_max, period_ns) = (0.2, 0.3, 5_000_000);
        let brief = brief(d, v_max, 0.045, period_ns, period_ns);
        let gives_way = AgentBrief { gives_way: true, ..brief.clone() };
        let [keeps, gives] = [&brief, &gives_way].map(Guard::new);
        let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
        assert!((keeps.d_f - expected_d_f).abs() < 1e-12, "{}", keeps.d_f);
        assert!((gives.d_f - 1.2 * expected_d_f).abs() < 1e-12, "{}", gives.d_f);
        assert!((gives.radius_needed - (gives.d_f + 4.0 * v_max * 0.005)).abs() < 1e-12);

        // The other stands ahead, between the two d_f; both want to go there.
        let (ahead, away) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
        let sample = sample(0, Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 }, &away);
        assert_eq!(keeps.deflect(&sample, ahead), ahead);
        let led = gives.deflect(&sample, ahead);
        assert!(led.x < 0.0 && led.y.abs() > 0.0, "back, and around: {led:?}");
    }

    proptest! {
        /// The promise is the same for every rank: whatever is wanted, both are granted the same.
        #[test]
        fn the_bound_does_not_know_who_gives_way(
            near in others(), wish in (-3.2..3.2f64, 0.0..1.0f64),
        ) {
            let (d, v_max, ell, period_ns) = (0.2, 0.3, 0.1, 5_000_000);
            let brief = brief(d, v_max, ell, period_ns, period_ns);
            let gives_way = AgentBrief { gives_way: true, ..brief.clone() };
            let step = v_max * 0.005;
            let away: Vec<Vec2> = { near }
                .iter()
                .map(|&(far, direction, _)| rotate(direction, Vec2::new(d + far * step, 0.0)))
                .collect();
            let sample = sample(0, Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.4 }, &away);
            let wanted = Twist {
                v_m_s: v_max * wish.1 * wish.0.cos(),
                w_rad_s: v_max * wish.1 * wish.0.sin() / ell,
            };
            let [keeps, gives] =
                [&brief, &gives_way].map(|brief| Guard::new(brief).bound(&sample, wanted));
            prop_assert_eq!(keeps, gives);
        }
    }

    /// Another robot: its distance beyond d in units of v_max H, its direction, where it drives at
    /// v_max, rad.
    fn others() -> impl Strategy<Value = Vec<(f64, f64, f64)>> {
        proptest::collection::vec((0.0..3.0f64, -3.2..3.2f64, -3.2..3.2f64), 1..5)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        /// The lemma that the proof rests on. Two samples less than H apart; the plant obeys the
        /// answer to the first one until that to the second takes effect, at whatever moment. After
        /// a restart it obeys some command of the robot's predecessor before.
        #[test]
        fn while_a_command_acts_it_approaches_nobody_faster_than_its_share_of_the_slack(
            d in 0.1..0.4f64,
            steps in 0.05..1.0f64, // v_max H in units of min(d/4, ell/2), the advised limit
            ell in 0.03..0.2f64,
            period_share in 0.1..0.9f64,
            others in others(),
            heading_rad in -3.1..3.1f64,
            wishes in [(-3.2..3.2f64, 0.0..1.0f64), (-3.2..3.2f64, 0.0..1.0f64)],
            bounds_alone in any::<bool>(),
            predecessor in proptest::option::of((-3.2..3.2f64, 0.0..1.0f64)),
            second in 0.05..0.95f64,   // the second sample's stamp, in H after the first
            effects in [0.0..1.0f64, 0.0..1.0f64], // when each takes effect, in H after its stamp
        ) {
            let lifetime_ns = 20_000_000;
            let lifetime = 0.02;
            let v_max = steps * (0.25 * d).min(0.5 * ell) / lifetime;
            let period_ns = (period_share * 2e7) as u64;
            let mut guard = guard(d, v_max, ell, period_ns, lifetime_ns);
            let first_ns = 1_000_000_000;
            let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad };
            let driven = |(angle, share): (f64, f64)| {
                let body = rotate(angle, Vec2::new(share * v_max, 0.0));
                Twist { v_m_s: body.x, w_rad_s: body.y / ell }
            };
            let before = predecessor.map_or(Twist::ZERO, driven);
            if predecessor.is_none() {
                // Long in the air: no predecessor's command is alive.
                guard.steer(&sample(0, start, &[]), Vec2::zeros());
            }

            let alpha = front_point(start, ell);
            let others: Vec<(Vec2, Vec2)> = others
                .iter()
                .map(|&(far, direction, course)| {
                    let r = d + far * v_max * lifetime;
                    let place = alpha + rotate(direction, Vec2::new(r, 0.0));
                    (place, rotate(course, Vec2::new(v_max, 0.0)))
                })
                .collect();
            let other_at = |(place, velocity): &(Vec2, Vec2), t: f64| place + t * velocity;
            let mut answer = |stamp_ns: u64, t: f64, pose: Pose, wish: (f64, f64)| {
                let alpha = front_point(pose, ell);
                let mut away: Vec<Vec2> =
                    others.iter().map(|other| alpha - other_at(other, t)).collect();
                away.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
                let sample = sample(stamp_ns, pose, &away);
                if bounds_alone {
                    // As if all that leads around others had failed.
                    guard.forget_the_dead(stamp_ns);
                    let granted = guard.bound(&sample, driven(wish));
                    guard.alive.push_back((stamp_ns, granted));
                    granted
                } else {
                    guard.steer(&sample, rotate(wish.0, Vec2::new(wish.1 * v_max, 0.0)))
                }
            };

            let one = answer(first_ns, 0.0, start, wishes[0]);
            let t_one = effects[0] * second * lifetime;
            let t_second = second * lifetime;
            let moved = arc(start, before, t_one);
            let turned = arc(moved, one, t_second - t_one);
            let second_ns = first_ns + (t_second * 1e9) as u64;
            let two = answer(second_ns, t_second, turned, wishes[1]);

            let dies_one = lifetime;
            let t_two = t_second + effects[1] * lifetime;
            let dies_two = t_second + lifetime;
            let stands_from = dies_one.min(t_two);
            let before_two = arc(turned, one, stands_from - t_second);

            // (pose and twist at t, and its command's sample: stamp and pose, fastest own command)
            let fastest_one = front_speed(ell, one).max(front_speed(ell, before));
            let fastest_two = front_speed(ell, one).max(front_speed(ell, two));
            let acting = [
                (t_one, stands_from, moved, one, 0.0, start, fastest_one),
                (t_two, dies_two, before_two, two, t_second, turned, fastest_two),
            ];
            for (from, until, pose, twist, sampled, sampled_pose, v_own) in acting {
                for k in 0..=20 {
                    let t = from + (until - from) * f64::from(k) / 20.0;
                    let now = arc(pose, twist, t - from);
                    let velocity = front_velocity(now.heading_rad, ell, twist);
                    for other in &others {
                        let r = (front_point(sampled_pose, ell) - other_at(other, sampled)).norm();
                        let rho = (r - d).max(0.0);
                        let reach = (v_max + v_own) * lifetime; // M
                        let b = (rho * (-2.0f64).exp()).max(rho - reach) / lifetime;
                        let z = front_point(now, ell) - other_at(other, t);
                        let approach = -z.normalize().dot(&velocity);
                        prop_assert!(approach <= b + 1e-9, "{approach} > {b} at {t}");
                    }
                }
            }
        }
    }
}
