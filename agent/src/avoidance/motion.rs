//! How those near move: the proximity sensor tells where they are, not who they are, nor how fast.
//!
//! Robots are d or more apart, and none goes farther than v_max dt between two samples. So whoever is
//! within d/4 of where somebody was is the same robot, as long as v_max dt is less than that; after a
//! longer gap nothing is known. Comfort alone rests on it: no promise about distances knows of it.

use formation::Vec2;
use formation::real;
use protocol::avoidance::Conditions;

use super::{Sample, clip};

/// Shortest time over which velocities are smoothed, s.
const SMOOTH_S: f64 = 0.05;
/// Velocities are smoothed for as long as v_max needs for this many times the error of a position.
const SMOOTH_ERRORS: f64 = 10.0;
/// Whoever stays within this share of d of a place is still.
const STILL: f64 = 0.05;

/// No more than this many of the nearest are watched: who is behind them is met later.
const WATCHED_MAX: usize = 6;

/// One of those near.
#[derive(Debug, Clone, Copy)]
pub struct Mover {
    /// Own front point - its, m.
    pub z: Vec2,
    /// How it moves in `map`, m/s; 0 where nothing is known yet.
    pub velocity: Vec2,
    /// For how long it has been still, s.
    pub still_s: f64,
    /// Where it is, m, and where it was when it moved last.
    at: Vec2,
    anchor: Vec2,
}

/// From one sample to the next.
#[derive(Debug, Clone, Copy)]
struct Step {
    /// How long it takes, s, and how often that is in a second.
    dt: f64,
    rate: f64,
    /// What share of a velocity is taken over from it.
    share: f64,
    v_max: f64,
    /// Nobody else comes as near to where somebody was, m^2.
    same2: f64,
    /// Whoever is nearer than this to its anchor is still, m^2.
    still2: f64,
}

impl Mover {
    /// Seen for the first time.
    fn new(z: Vec2, at: Vec2) -> Mover {
        Mover { z, velocity: Vec2::zeros(), still_s: 0.0, at, anchor: at }
    }

    /// Seen again.
    fn moved(self, z: Vec2, at: Vec2, step: &Step) -> Mover {
        let now = (at - self.at) * step.rate;
        let velocity = self.velocity + (now - self.velocity) * step.share;
        let (anchor, still_s) = match (at - self.anchor).norm_squared() < step.still2 {
            true => (self.anchor, self.still_s + step.dt),
            false => (at, 0.0),
        };
        Mover { z, velocity: clip(velocity, step.v_max), still_s, at, anchor }
    }
}

/// Those near, from sample to sample.
#[derive(Debug)]
pub struct Motion {
    smooth_s: f64,
    stamp_ns: Option<u64>,
    /// Between the last two samples.
    step: Step,
    movers: Vec<Mover>,
    before: Vec<Mover>,
}

impl Motion {
    /// Nobody seen yet.
    pub fn new(at: &Conditions<'_>) -> Motion {
        let (d, error) = (at.avoidance.distance_min_m, at.distance_error_m());
        let v_max = at.speed_m_s();
        let (same, still) = (0.25 * d, (STILL * d).max(3.0 * error));
        Motion {
            smooth_s: SMOOTH_S.max(SMOOTH_ERRORS * error / v_max),
            stamp_ns: None,
            step: Step {
                dt: 0.0,
                rate: f64::INFINITY,
                share: 0.0,
                v_max,
                same2: same * same,
                still2: still * still,
            },
            movers: Vec::new(),
            before: Vec::new(),
        }
    }

    /// Takes a sample in, once.
    pub fn observe(&mut self, sample: &Sample<'_>) {
        let nearest = &sample.away[..sample.away.len().min(WATCHED_MAX)];
        let first = self.movers.first().map(|mover| &mover.z);
        let same = first == nearest.first() && self.movers.len() == nearest.len();
        if same && self.stamp_ns == Some(sample.stamp_ns) {
            return;
        }
        let earlier_ns = self.stamp_ns.replace(sample.stamp_ns).unwrap_or(sample.stamp_ns);
        let dt = sample.stamp_ns.saturating_sub(earlier_ns) as f64 / 1e9;
        if self.step.dt != dt {
            let share = dt / (dt + self.smooth_s);
            self.step = Step { dt, rate: 1.0 / dt, share, ..self.step };
        }
        let step = &self.step;
        if real::square(step.v_max * dt) >= step.same2 || dt == 0.0 {
            self.movers.clear();
        }
        std::mem::swap(&mut self.movers, &mut self.before);
        self.movers.clear();
        self.movers.extend(nearest.iter().enumerate().map(|(place, &z)| {
            let at = sample.front_point - z;
            let same = |mover: &&Mover| (mover.at - at).norm_squared() < step.same2;
            // The list seldom changes its order.
            let known = self.before.get(place).filter(same);
            match known.or_else(|| self.before.iter().find(same)) {
                Some(mover) => mover.moved(z, at, step),
                None => Mover::new(z, at),
            }
        }));
    }

    /// Time between the last two samples, s.
    pub fn dt(&self) -> f64 {
        self.step.dt
    }

    /// The nearest, nearest first.
    pub fn movers(&self) -> &[Mover] {
        &self.movers
    }
}

#[cfg(test)]
mod tests {
    use super::super::guard::tests::{brief, sample};
    use super::*;

    /// d = 0.2 m, v_max = 0.5 m/s.
    fn motion(sensing_error_m: f64) -> Motion {
        let mut brief = brief();
        brief.avoidance.sensing_error_m = sensing_error_m;
        Motion::new(&Conditions::of(&brief))
    }

    /// The robot goes along x at 0.1 m/s; others are at these places in `map`, seen every 10 ms.
    fn watch(motion: &mut Motion, steps: u64, places: impl Fn(u64, f64) -> Vec<Vec2>) {
        for step in 0..steps {
            let t_s = 0.01 * step as f64;
            let front_point = Vec2::new(0.1 * t_s, 0.0);
            let away: Vec<Vec2> = places(step, t_s).iter().map(|at| front_point - at).collect();
            motion.observe(&Sample { front_point, ..sample(10_000_000 * step, 0.0, &away) });
        }
    }

    #[test]
    fn how_others_move_is_seen_whatever_the_order_in_which_they_are_listed() {
        let mut motion = motion(0.0);
        let (still, goes) = (Vec2::new(1.0, 0.2), Vec2::new(0.0, -0.4));
        watch(&mut motion, 101, |step, t_s| {
            let two = [still, Vec2::new(1.0, 0.0) + t_s * goes];
            if step % 3 == 0 { two.to_vec() } else { vec![two[1], two[0]] }
        });
        let [moves, stays] = motion.movers() else { panic!("two are near") };
        assert!((moves.velocity - goes).norm() < 1e-6, "{moves:?}");
        assert!(moves.still_s < 0.05, "{moves:?}");
        assert!(stays.velocity.norm() < 1e-9 && (stays.still_s - 1.0).abs() < 1e-9, "{stays:?}");
    }

    #[test]
    fn nothing_is_known_of_who_was_not_seen_nor_after_a_gap_in_which_two_could_be_taken_for_each_other()
     {
        let mut motion = motion(0.0);
        let one = |step: u64, t_s: f64| {
            let first = Vec2::new(1.0, 0.3 * t_s);
            if step < 20 { vec![first] } else { vec![first, Vec2::new(0.5, 0.3 * t_s)] }
        };
        watch(&mut motion, 21, one);
        let [known, new] = motion.movers() else { panic!("two are near") };
        assert!(known.velocity.y > 0.2 && new.velocity == Vec2::zeros() && new.still_s == 0.0);
        // v_max goes d/4 in 100 ms: at 99 ms whoever is near is known again, at 100 ms nobody is.
        for (gap_ns, is_known) in [(99_999_999, true), (100_000_000, false)] {
            let mut motion = super::tests::motion(0.0);
            watch(&mut motion, 21, |_, t_s| vec![Vec2::new(1.0, 0.3 * t_s)]);
            let away = [Vec2::new(-0.98, -0.06)];
            let front_point = Vec2::new(0.02, 0.0);
            motion.observe(&Sample { front_point, ..sample(200_000_000 + gap_ns, 0.0, &away) });
            assert_eq!(motion.movers()[0].velocity != Vec2::zeros(), is_known, "{gap_ns} ns");
        }
    }

    #[test]
    fn no_more_than_the_six_nearest_are_watched() {
        let mut motion = motion(0.0);
        let row = |count: u32| (1..=count).map(|j| Vec2::new(0.3 * f64::from(j), 0.0)).collect();
        watch(&mut motion, 1, |_, _| row(8));
        let watched: Vec<f64> = motion.movers().iter().map(|mover| -mover.z.x).collect();
        let nearest: Vec<f64> = row(6).iter().map(|at: &Vec2| at.x).collect();
        assert_eq!(watched, nearest);
    }

    #[test]
    fn errors_of_sensed_places_make_nobody_move() {
        let mut motion = motion(0.01);
        watch(&mut motion, 500, |step, _| {
            let error = if step % 2 == 0 { 0.01 } else { -0.01 };
            vec![Vec2::new(1.0 + error, 0.5)]
        });
        let [stays] = motion.movers() else { panic!("one is near") };
        assert!(stays.velocity.norm() < 0.06 && stays.still_s > 4.9, "{stays:?}");
    }
}
