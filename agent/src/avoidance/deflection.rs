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

    /// The distance from which the robot is led around the other at `z`, m: d_f, or d_s while it stands
    /// off, but for whoever has its place.
    fn distance_from(&self, z: &Vec2) -> f64 {
        match self.stands_off {
            Some(taken) if taken.by != *z => taken.d_s,
            _ => self.d_f,
        }
    }

    /// The wanted displacement `p`, led around those it would come too near. One that stands off is
    /// held back only: around others there is nothing for it, and on the way it would be in
    /// everybody else's. From all but whoever has its place it stays d_s away.
    ///
    /// Along a wall it is led to the side to which p leads anyway: a wall does not move aside.
    pub fn deflect(&self, sample: &Sample<'_>, mut p: Vec2) -> Vec2 {
        let reach = self.v_max * self.period; // V
        let excess = |z: &Vec2| -self.kappa * (z.norm() - self.distance_from(z));
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

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::guard::tests::brief;
    use super::*;

    #[test]
    fn along_a_wall_a_robot_is_led_to_the_side_that_it_wants_and_no_nearer_than_c_f() {
        let mut brief = brief();
        brief.avoidance.clearance_m = 0.1;
        let deflection = Deflection::new(&brief);
        let c_f = 0.109375; // 0.75 v_max H
        let led = |far: f64, p: Vec2| {
            let walls = [rotate(0.7, Vec2::new(-far, 0.0))]; // ahead, turned by 0.7
            let beside = Sample { walls: &walls, ..Sample::default() };
            rotate(-0.7, deflection.deflect(&beside, rotate(0.7, p)))
        };
        let near = |found: Vec2, x: f64, y: f64| {
            assert!((found - Vec2::new(x, y)).norm() < 1e-12, "{found:?} is not {x}, {y}");
        };
        // At c_f nothing is left of what leads into it; to the side, all that it lost.
        near(led(c_f, Vec2::new(3e-3, 2e-3)), 0.0, 5e-3);
        near(led(c_f, Vec2::new(3e-3, -2e-3)), 0.0, -5e-3);
        near(led(c_f, Vec2::new(4e-3, 0.0)), 0.0, 0.0);
        // Hardly to a side: more of it, without a jump.
        let side = 1e-4 / (16e-6f64 + 1e-8).sqrt();
        near(led(c_f, Vec2::new(4e-3, 1e-4)), 0.0, 1e-4 + 4e-3 * 4.0 * side);
        // Nearer, away from it, whatever is wanted; farther away, a quarter of the rest is left.
        near(led(c_f - 4e-3, Vec2::zeros()), -1e-3, 0.0);
        near(led(c_f + 4e-3, Vec2::new(3e-3, 1e-3)), 1e-3, 3e-3);
        near(led(c_f + 4e-3, Vec2::new(1e-3, 2e-3)), 1e-3, 2e-3);
        near(led(c_f + 4e-3, Vec2::new(-4e-3, 2e-3)), -4e-3, 2e-3);
    }

    /// All of it turned by an angle at which no component is 0.
    #[test]
    fn one_in_the_way_is_gone_around_by_a_focus_that_is_as_strong_as_needed() {
        let deflection = Deflection::new(&AgentBrief { index: 2, ..brief() });
        assert!((deflection.dither_phase - 0.236_067_977_4).abs() < 1e-9);
        let period_s = 1.5 * (1.0 + 4.0 * 0.236_067_977_4 / 3.0);
        assert!((deflection.dither_period - period_s).abs() < 1e-9);
        let turned = |x: f64, y: f64| rotate(0.7, Vec2::new(x, y));
        // The instant at which the dither has gone through this many of its periods.
        let at = |turns: f64| (turns - deflection.dither_phase) * deflection.dither_period;
        let deflect = |turns: f64, away: &[Vec2], p: Vec2| {
            deflection.deflect(&Sample { t_s: at(turns), away, ..Sample::default() }, p)
        };
        let near = |found: Vec2, expected: Vec2| {
            assert!((found - expected).norm() < 1e-12, "{found:?} is not {expected:?}");
        };
        let (d_f, reach) = (0.21875, 0.005); // V
        let other = [turned(-0.212, 0.0)]; // ahead: n = (-1, 0), t = (0, -1)
        let excess = 0.25 * (d_f - 0.212);
        let clipped = |x: f64, y: f64| turned(x, y) * (reach / x.hypot(y));

        // Straight at it, while the dither turns by nothing.
        near(deflect(3.0, &other, turned(reach, 0.0)), clipped(-excess, -(excess + reach)));
        // While the dither turns by 1 rad: less straight at it, and less is added.
        let (sin, cos) = 1f64.sin_cos();
        let lambda = excess + reach * cos;
        let expected = turned(reach * cos - lambda, reach * sin - lambda);
        near(deflect(3.25, &other, turned(reach, 0.0)), expected);
        // Away from it faster than its share: nothing turns or pushes.
        near(deflect(3.25, &other, turned(-0.004, 0.001)), turned(-0.004, 0.001));
        // One that is too far to be reached in a period does not count, even where nearer ones push
        // towards it by more than a period's way.
        let deep = turned(-0.2, 0.0);
        let excess = 0.25 * (d_f - 0.2);
        let expected = clipped(-excess, -(excess + reach));
        near(deflect(3.0, &[deep], turned(reach, 0.0)), expected);
        near(deflect(3.0, &[deep, turned(0.0, 0.24)], turned(reach, 0.0)), expected);
        // At the same place there is no direction to go around by.
        assert!(deflect(3.0, &[Vec2::zeros()], turned(reach, 0.0)).norm() <= reach);
    }

    #[test]
    fn one_that_gives_way_is_led_around_from_farther_away_and_asks_for_a_wider_view() {
        let [keeps, gives] = [Rank::First, Rank::Contained].map(of_rank);
        let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
        assert!((keeps.d_f - expected_d_f).abs() < 1e-12, "{}", keeps.d_f);
        assert!((of_rank(Rank::Follower).d_f - 1.1 * expected_d_f).abs() < 1e-12);
        assert!((gives.d_f - 1.12 * expected_d_f).abs() < 1e-12, "{}", gives.d_f);

        // The other stands ahead, between the two d_f; both want to go there.
        let (ahead, away) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
        let sample = Sample { away: &away, ..Sample::default() };
        assert_eq!(keeps.deflect(&sample, ahead), ahead);
        let led = gives.deflect(&sample, ahead);
        assert!(led.x < 0.0 && led.y.abs() > 0.0, "back, and around: {led:?}");
    }

    /// d_f = 0.21 m for the first rank, 0.231 m for followers, 0.2352 m for contained robots.
    fn of_rank(rank: Rank) -> Deflection {
        let mut brief = AgentBrief { rank, ..brief() };
        (brief.period_ns, brief.command_lifetime_ns) = (5_000_000, 5_000_000);
        brief.avoidance.speed_max_m_s = 0.3;
        Deflection::new(&brief)
    }

    #[test]
    fn a_place_that_is_taken_is_not_asked_for_but_one_beside_it() {
        let mut robot = of_rank(Rank::Contained);
        let other = Vec2::new(1.0, 0.0); // seen from the robot
        let mut asked = |place: Vec2| -robot.stand_off(&[-other], -place); // alpha* - alpha
        let close = |found: Vec2, expected: Vec2| (found - expected).norm() < 1e-9;
        // Farther from the other than d_f, all is as it was.
        let free = other + Vec2::new(0.0, 0.2362);
        assert!(close(asked(free), free));
        // Right where the other stands: in line with it, a tenth farther away than d_f.
        assert!(close(asked(other), Vec2::new(1.0 - 1.1 * 0.2352, 0.0)));
        // Near it: on the side where the place is, without a jump where it becomes free.
        let aside = asked(other + Vec2::new(0.0, 0.1176));
        assert!(
            close(aside - other, rotate(0.25 * PI, Vec2::new(0.0, 1.05 * 0.2352))),
            "{aside:?}"
        );
        let nearly = other + Vec2::new(0.0, 0.2352 - 1e-6);
        assert!((asked(nearly) - nearly).norm() < 1e-5, "{:?}", asked(nearly));
        // Of two the one nearer to the place counts.
        let two = [-other, -other - Vec2::new(0.0, 0.1)];
        let asked = -of_rank(Rank::Contained).stand_off(&two, -(other + Vec2::new(0.0, 0.1)));
        assert!(((asked - other).y - 0.1).abs() < 0.2352 && asked.x < 1.0, "{asked:?}");
        let from_second = asked + two[1];
        assert!((from_second.norm() - 1.1 * 0.2352).abs() < 1e-9, "{asked:?}");
        // Two sensed at one point, which d forbids, leave what was asked.
        let place = Vec2::new(0.1, 0.0);
        assert_eq!(of_rank(Rank::Contained).stand_off(&[Vec2::zeros()], -place), -place);
    }

    #[test]
    fn whoever_leads_or_keeps_a_place_asks_for_it_whoever_stands_there() {
        let other = Vec2::new(1.0, 0.0);
        for rank in [Rank::First, Rank::Follower] {
            assert_eq!(of_rank(rank).stand_off(&[-other], -other), -other);
        }
    }

    #[test]
    fn who_stands_off_is_held_back_and_not_led_around_until_its_place_is_free() {
        let mut robot = of_rank(Rank::Contained);
        let (ahead, away) = (Vec2::new(1.5e-3, 0.0), [Vec2::new(-0.233, 0.0)]);
        let at = |t_s| Sample { t_s, away: &away, ..Sample::default() };
        let around = robot.deflect(&at(0.0), ahead);
        assert!(around.y.abs() > 1e-4, "{around:?}");
        robot.stand_off(&away, Vec2::new(-0.233, 0.0));
        // Neither around nor, while the dither's clock goes round, to either side.
        for t_s in [0.0, 0.3, 0.9] {
            let back = robot.deflect(&at(t_s), ahead);
            assert!(back.x < 0.0 && back.y == 0.0, "{back:?}");
        }
        robot.stand_off(&away, Vec2::new(-1.0, 0.0));
        assert_eq!(robot.deflect(&at(0.0), ahead), around);
    }

    #[test]
    fn who_stands_off_gives_way_to_others_from_farther_away_than_to_whoever_has_its_place() {
        let mut robot = of_rank(Rank::Contained);
        let taker = Vec2::new(-0.25, 0.0); // ahead; both nearer than d_s, and farther away than d_f
        let beside = Vec2::new(0.0, -0.257);
        let moved = |robot: &Deflection, away: &[Vec2]| {
            robot.deflect(&Sample { away, ..Sample::default() }, Vec2::zeros())
        };
        robot.stand_off(&[taker, beside], taker);
        assert_eq!(moved(&robot, &[taker]), Vec2::zeros());
        let back = 0.25 * (1.1 * 0.2352 - 0.257);
        assert!((moved(&robot, &[taker, beside]) - Vec2::new(0.0, -back)).norm() < 1e-12);
        robot.stand_off(&[taker, beside], Vec2::new(1.0, 1.0));
        assert_eq!(moved(&robot, &[taker, beside]), Vec2::zeros());
    }
}
