//! Deflection: the way around others. It keeps the chapter's unstable focus, only as strong as needed,
//! looks ahead, and gives way. It is comfort: it promises nothing.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n, t | own minus other, its length, its direction, n turned +90 degrees |
//! | p | displacement wanted within one period T, m; \|p\| <= V = v_max T |
//! | e | own front point minus the place wanted, m |
//! | d_f | distance at which the deflection begins to matter, m |
//! | d_s | the same for a robot that stands off from a place that is taken, m |
//! | c_f | the same beside a wall, m |
//! | kappa | share of the slack to d_f that a period's approach may use up |
//!
//! Who has arrived gives way to whoever comes: d_f grows by a share of itself where e is small and the
//! other approaches the place. In a formation that keeps its shape, at rest, moving or turning, nobody
//! approaches anybody's place, and d_f is what it was. In words: `docs/explanation/arrival.md`.

use std::f64::consts::TAU;

use formation::Vec2;
use formation::front_point::rotate;
use formation::real;
use protocol::avoidance::{Conditions, Gain};
use protocol::brief::{AgentBrief, Rank};
use protocol::planted;

use super::braking::rate_per_s;
use super::motion::{Motion, Mover};
use super::patience::Patience;
use super::{Sample, clip};
use crate::golden_phase;

/// How soon the way along a wall is all that is left: to a side to which a quarter of p leads.
const ALONG: f64 = 4.0;
/// The dither's shortest period, s; each robot has its own, so that no pair stays symmetric.
const DITHER_PERIOD_S: f64 = 1.5;
/// A where somebody has inertia, rad: who stands before a door must get out of the other's way.
const DITHER_OF_THE_SLOW_RAD: f64 = 0.85;
/// How far the dither swings at least for a robot that has tried for long, rad.
const DITHER_AT_LAST_RAD: f64 = 1.0;
/// The least of d_f - d, as a share of d.
const MARGIN: f64 = 0.05;
/// Who has been still for this long, s, has a place for good, as far as anybody can tell.
const TAKEN_AFTER_S: f64 = 3.0;
/// Over how long a place's velocity is smoothed, in d / v_max. While a formation forms, those whom a robot
/// hears carry its place along: they still count as coming.
const PLACE_SMOOTH: f64 = 3.0;
/// Nobody is turned aside as if whom it meets were nearer than this, s.
const SOONEST_S: f64 = 0.1;

/// The later answers act, the slower all go, and the farther from its place and the sooner a robot gives way: by
/// these for each v_max H / d.
const YIELD_EARLIER: f64 = 4.0;
const YIELD_SOONER: f64 = 5.0;

/// d_s is more than d_f by this share of how far the place wanted is within d_f of the other. Measured
/// over all single deaths and cuts of the shipped scenarios: with 0 three contained robots that have a
/// place end 2 to 8 cm off it, held up by some that have none; with 0.1 and with 0.15 nobody does.
pub const ASIDE: f64 = 0.1;

/// What the way around others is made of, found by search: `scenarios/campaigns/deflection/search.py`.
/// Nothing that the guard promises depends on them.
pub const GAINS: &[Gain] = &[
    Gain::or(
        "dither_rad",
        0.1,
        "A, how far a blocked robot's wish swings to and fro, in rad; 0.85 where somebody has inertia",
    ),
    Gain::or("around", 0.3, "how much of the approach that is taken off is put across instead"),
    Gain::or("around_at_last", 1.6, "the same for a robot that gets nowhere"),
    Gain::or("impatience_time", 0.9, "how soon a robot counts as getting nowhere, in d / v_max"),
    Gain::or(
        "slack_share",
        0.17,
        "kappa, share of the slack to d_f that a period's approach uses up",
    ),
    Gain::or("margin", 1.9, "d_f - d in v_max H, 0.05 d at least"),
    Gain::or("look_ahead", 3.3, "how far ahead a robot looks, in d / v_max"),
    Gain::or(
        "look_ahead_share",
        1.7,
        "share of what is missing to d_f by which a robot turns aside early",
    ),
    Gain::or("look_ahead_turn_rad", 0.75, "how far a robot turns aside early at most, in rad"),
    Gain::or("yield", 0.45, "by what share of itself d_f grows for a robot that gives way"),
    Gain::or("yield_speed", 1.0, "how fast the other must come for all of that, in v_max"),
    Gain::or(
        "yield_reach",
        0.45,
        "how near its place a robot is that gives way, in d, and 4 v_max H more",
    ),
];

/// d_f, m: the distance from which a robot is led around another; larger for one that gives way.
pub fn deflection_distance_m(at: &Conditions<'_>) -> f64 {
    let d = at.avoidance.distance_min_m;
    let d_f = d + (gain(at, "margin") * at.speed_m_s() * at.lifetime_s).max(MARGIN * d);
    larger(at.rank) * d_f
}

/// How far a robot looks for those whom it will meet, m: as far as v_max leads until then.
pub fn look_ahead_radius_m(at: &Conditions<'_>) -> f64 {
    deflection_distance_m(at) + gain(at, "look_ahead") * at.avoidance.distance_min_m
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
        true => gain(at, "slack_share").min(rate_per_s(at) * at.period_s),
        false => gain(at, "slack_share"),
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
        true => WALL_KAPPA.min(2.0 * rate_per_s(at) * at.period_s),
        false => WALL_KAPPA,
    }
}

/// kappa beside a wall.
const WALL_KAPPA: f64 = 0.25;

/// A gain as given, or as found by search.
fn gain(at: &Conditions<'_>, key: &str) -> f64 {
    at.gain(GAINS, key)
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
    motion: Motion,
    patience: Patience,
    comfort: Comfort,
    /// How its place moves in the long run, m/s.
    place_velocity: Vec2,
    /// Its place is taken: it is held back, and not led around.
    stands_off: Option<Taken>,
    limits: Vec<Limit>,
    pub(super) dither_period: f64,
    pub(super) dither_phase: f64,
}

/// The gains, in SI units.
struct Comfort {
    dither_rad: f64,
    around: f64,
    around_at_last: f64,
    look_ahead_s: f64,
    look_ahead_share: f64,
    look_ahead_turn_rad: f64,
    yields: f64,
    yield_speed_m_s: f64,
    yield_reach_m: f64,
    /// Over how long the place's velocity is smoothed, s.
    place_s: f64,
}

impl Comfort {
    /// Of a robot that leads all others, or of another.
    fn new(at: &Conditions<'_>, leads: bool) -> Comfort {
        let (d, v_max) = (at.avoidance.distance_min_m, at.speed_m_s());
        // Whoever leads keeps its way: where it turns aside, everybody does.
        let aside = |key| if leads { 0.0 } else { gain(at, key) };
        let late = v_max * at.lifetime_s / d;
        Comfort {
            dither_rad: match at.avoidance.gains.get("dither_rad") {
                None if at.avoidance.braking_time_max_s > 0.0 => DITHER_OF_THE_SLOW_RAD,
                _ => gain(at, "dither_rad"),
            },
            around: gain(at, "around"),
            around_at_last: gain(at, "around_at_last"),
            look_ahead_s: gain(at, "look_ahead") * d / v_max,
            look_ahead_share: gain(at, "look_ahead_share"),
            look_ahead_turn_rad: aside("look_ahead_turn_rad"),
            // Whoever comes to a contained robot's place may want just that, and stay there.
            yields: if at.rank == Rank::Contained { 0.0 } else { aside("yield") },
            yield_speed_m_s: gain(at, "yield_speed") * v_max / (1.0 + YIELD_SOONER * late),
            yield_reach_m: gain(at, "yield_reach") * d + YIELD_EARLIER * late * d,
            place_s: PLACE_SMOOTH * d / v_max,
        }
    }
}

/// How much of a displacement away from another is asked for.
#[derive(Debug, Clone, Copy)]
struct Limit {
    /// z, m, and r, m.
    z: Vec2,
    r: f64,
    /// The least n·p, m: below 0 where there is slack.
    excess: f64,
    /// Of a wall, which does not move aside.
    is_wall: bool,
}

impl Limit {
    /// Whether it may matter to a displacement of no more than `reach`, m.
    fn stops_within(&self, reach: f64) -> bool {
        -self.excess < reach && self.r > 0.0
    }

    /// The displacement `p`, with what it lacks away from the other, and this share of that across: beside a wall
    /// to the side to which p leads anyway.
    fn lead(&self, p: Vec2, around: f64) -> Vec2 {
        let n = self.z / self.r;
        let lambda = self.excess - n.dot(&p);
        if lambda <= 0.0 {
            return p;
        }
        let across = Vec2::new(-n.y, n.x);
        let around = match self.is_wall {
            true => (ALONG * across.dot(&p) / p.norm().max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0),
            false => around,
        };
        p + lambda * (n + around * across)
    }
}

/// Why a robot stands off.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    /// z of the other that has its place, m.
    by: Vec2,
    /// d_s, m.
    d_s: f64,
    /// Where it stands off to, as seen from its place, m.
    aside: Vec2,
}

impl Deflection {
    /// That of the robot of this brief.
    pub fn new(brief: &AgentBrief) -> Deflection {
        let at = Conditions::of(brief);
        let phase = golden_phase(brief.index);
        let (d, v_max) = (at.avoidance.distance_min_m, at.speed_m_s());
        Deflection {
            v_max: brief.avoidance.speed_max_m_s,
            period: brief.period_ns as f64 / 1e9,
            kappa: deflection_share(&at),
            d_f: deflection_distance_m(&at),
            wall: (wall_deflection_share(&at), wall_deflection_distance_m(&at)),
            rank: brief.rank,
            motion: Motion::new(&at),
            patience: Patience::new(d, v_max, gain(&at, "impatience_time")),
            comfort: Comfort::new(&at, brief.lead.is_some()),
            place_velocity: Vec2::zeros(),
            stands_off: None,
            limits: Vec::new(),
            dither_period: DITHER_PERIOD_S * (1.0 + 4.0 * phase / 3.0),
            dither_phase: phase,
        }
    }

    /// e, m, as the law is to see it. A robot does not ask for a place nearer than d_f to somebody
    /// who has it: it asks for one beside it, at d_s. Beside: where the place lies as seen from the other, and,
    /// the nearer the two are, where the robot is as seen from it. All change without a jump as the
    /// other moves on. A contained robot's place is anybody's; any other's is taken only by who has
    /// been still for long.
    pub fn stand_off(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        self.motion.observe(sample);
        let gap2 = |z: &Vec2| (z - error).norm_squared(); // |alpha* - alpha_j|^2
        let at_once = self.rank == Rank::Contained || self.patience.rests();
        let has_it = |mover: &&Mover| {
            gap2(&mover.z) < self.d_f * self.d_f && (at_once || mover.still_s >= TAKEN_AFTER_S)
        };
        let movers = self.motion.movers().iter().filter(has_it);
        let nearest = movers.map(|mover| mover.z).min_by(|a, b| gap2(a).total_cmp(&gap2(b)));
        let nearest = nearest
            .filter(|_| self.rank == Rank::Contained || self.patience.stands_off(self.motion.dt()));
        self.stands_off = nearest.map(|z| {
            let lacking = self.d_f - gap2(&z).sqrt();
            let d_s = self.d_f + ASIDE * lacking;
            let beside = (z - error) + lacking * z / z.norm();
            let beside = d_s * beside / beside.norm(); // from alpha_j
            let aside = beside - (z - error);
            let finite = aside.x.is_finite() && aside.y.is_finite();
            Taken { by: z, d_s, aside: if finite { aside } else { Vec2::zeros() } }
        });
        self.stands_off.map_or(error, |taken| error - taken.aside)
    }

    /// The distance from which the robot is led around another, m: d_f, or d_s while it stands off, but for
    /// whoever has its place.
    fn distance_from(&self, mover: &Mover) -> f64 {
        match self.stands_off {
            Some(taken) if taken.by != mover.z => taken.d_s,
            _ => self.d_f,
        }
    }

    /// What may stop the robot within this period, walls first, the nearest of each first.
    fn limits(&mut self, sample: &Sample<'_>) -> Vec<Limit> {
        let mut limits = std::mem::take(&mut self.limits);
        limits.clear();
        let reach = self.v_max * self.period;
        let (kappa, c_f) = self.wall;
        let walls = sample.walls.iter().map(|&z| {
            let r = z.norm();
            Limit { z, r, excess: -kappa * (r - c_f), is_wall: true }
        });
        let farthest = self.stands_off.map_or(self.d_f, |taken| taken.d_s.max(self.d_f));
        let farthest = farthest * (1.0 + self.comfort.yields) + reach / self.kappa;
        let movers = self.motion.movers().iter().filter_map(|mover| {
            let r2 = mover.z.norm_squared();
            (r2 < farthest * farthest).then(|| self.limit(mover, r2.sqrt(), sample))
        });
        limits.extend(walls.chain(movers).filter(|limit| limit.stops_within(reach)));
        limits
    }

    /// How much is asked for beside another, r m away, by whom the robot may be stopped within this
    /// period: it is led around it from farther away where it is near its place, the faster the other comes.
    fn limit(&self, mover: &Mover, r: f64, sample: &Sample<'_>) -> Limit {
        let d_f = self.distance_from(mover);
        let comes_m_s = (mover.velocity - self.place_velocity).dot(&mover.z) / r;
        let share = match planted::is("yield-stays") {
            true => 1.0,
            false => (comes_m_s / self.comfort.yield_speed_m_s).clamp(0.0, 1.0),
        };
        let beside = |yields: f64| {
            let excess = -self.kappa * (r - d_f * (1.0 + yields));
            Limit { z: mover.z, r, excess, is_wall: false }
        };
        // Where two are at the same place there is no direction to come from.
        let most = if share > 0.0 { self.comfort.yields * share } else { 0.0 };
        match most > 0.0 && beside(most).stops_within(self.v_max * self.period) {
            true => beside(most * self.at_its_place(sample)),
            false => beside(most),
        }
    }

    /// How much the robot gives way: 1 at its place, or where it has given up; 0 far away, or where it has nothing
    /// to go by: it stands.
    fn at_its_place(&self, sample: &Sample<'_>) -> f64 {
        let aside = self.stands_off.map_or(Vec2::zeros(), |taken| taken.aside);
        let Some(error) = sample.error.map(|error| error - aside) else { return 0.0 };
        match self.patience.rests() {
            true => 1.0,
            false => real::exp(-error.norm_squared() / real::square(self.comfort.yield_reach_m)),
        }
    }

    /// The wanted displacement `p`, led around those it would come too near. One that stands off, or has
    /// given up, is held back only: around others there is nothing for it, and on the way it would be in
    /// everybody else's. From all but whoever has its place it stays d_s away.
    ///
    /// Along a wall it is led to the side to which p leads anyway: a wall does not move aside.
    pub fn deflect(&mut self, sample: &Sample<'_>, mut p: Vec2) -> Vec2 {
        let reach = self.v_max * self.period; // V
        self.motion.observe(sample);
        let length = p.norm();
        let got_m_s = if length > 0.0 { sample.front_velocity.dot(&p) / length } else { 0.0 };
        let wanted_m_s = length / self.period;
        let shares = [wanted_m_s, wanted_m_s - got_m_s].map(|speed| speed / self.v_max);
        let dt = self.motion.dt();
        self.patience.observe(dt, sample, shares);
        let led_around = self.stands_off.is_none() && !self.patience.rests();
        let place = sample.place_velocity - self.place_velocity;
        self.place_velocity += place * (dt / (dt + self.comfort.place_s));
        let limits = self.limits(sample);
        let mut around = 0.0;
        if led_around {
            p = self.look_ahead(p);
            if limits.iter().any(|limit| !limit.is_wall && limit.z.dot(&p) < limit.excess * limit.r)
            {
                let turns = sample.t_s / self.dither_period + self.dither_phase;
                let usual = self.comfort.dither_rad;
                let at_last = self.patience.has_tried();
                let most = usual + (DITHER_AT_LAST_RAD - usual).max(0.0) * at_last;
                p = rotate(most * real::sin(TAU * turns), p);
            }
            let Comfort { around: usual, around_at_last, .. } = self.comfort;
            around = usual + (around_at_last - usual) * self.patience.lost();
        }
        for _ in 0..2 {
            p = limits.iter().rev().fold(p, |p, limit| limit.lead(p, around));
        }
        self.limits = limits;
        clip(p, reach)
    }

    /// `p`, turned aside early from those that it would pass nearer than d_f if all went on as they do: to the
    /// side on which it passes anyway, the more the sooner.
    fn look_ahead(&self, p: Vec2) -> Vec2 {
        let length = p.norm();
        if length == 0.0 {
            return p;
        }
        let (wish, speed) = (p / self.period, length / self.period);
        let (within_s, d_f2) = (self.comfort.look_ahead_s, self.d_f * self.d_f);
        let turn_from = |mover: &Mover| {
            let relative = wish - mover.velocity;
            let (way, speed2) = (-mover.z.dot(&relative), relative.norm_squared());
            // Nobody that is passed already, that is met later, or that moves alike.
            if !(way > 0.0 && way < within_s * speed2) {
                return 0.0;
            }
            // How far to the left of the other's way it passes, m, times the relative speed.
            let left = mover.z.y * relative.x - mover.z.x * relative.y;
            if left * left >= d_f2 * speed2 {
                return 0.0;
            }
            let (soon_s, offset) = (way / speed2, left / speed2.sqrt());
            // Who passes on the left of the other's way turns on to the left.
            let side = if (left >= 0.0) == (relative.dot(&wish) >= 0.0) { 1.0 } else { -1.0 };
            let lacking = self.d_f - offset.abs();
            let lateral_m_s = self.comfort.look_ahead_share * lacking / soon_s.max(SOONEST_S);
            side * lateral_m_s * (1.0 - soon_s / within_s) / speed
        };
        let turn: f64 = self.motion.movers().iter().map(turn_from).sum();
        let most = self.comfort.look_ahead_turn_rad;
        if turn == 0.0 { p } else { rotate(turn.clamp(-most, most), p) }
    }
}

#[cfg(test)]
mod tests;
