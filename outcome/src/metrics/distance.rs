//! How near any two robots came to each other, and when. (15)

use formation::Vec2;
use formation::closest_over_time::ClosestOverTime;
use protocol::message::TruthHeader;

use crate::metrics::closest::Closest;
use crate::metrics::pairs::Pairs;

/// The smallest distances so far.
pub(super) struct Distances {
    distance_min_m: f64,
    over_time: ClosestOverTime,
    pub(super) pairs: Pairs,
    closest: Option<Closest>,
    /// At the newest truth.
    nearest: Option<Closest>,
    /// What the plant saw last.
    seen: Option<Closest>,
    violations: u64,
    violations_plant: u64,
    newest_t_ns: Option<u64>,
}

impl Distances {
    /// Nothing measured yet; nearer than `distance_min_m` is too near.
    pub(super) fn new(robots: usize, distance_min_m: f64) -> Distances {
        Distances {
            distance_min_m,
            over_time: ClosestOverTime::default(),
            pairs: Pairs::new(robots),
            closest: None,
            nearest: None,
            seen: None,
            violations: 0,
            violations_plant: 0,
            newest_t_ns: None,
        }
    }

    /// Takes in where everybody is now. The smallest distance since the previous truth, as far as it
    /// is known, m: the plant looks at the end of every arc and counts from the start, so that
    /// neither shorter arcs nor lost truths hide anything.
    pub(super) fn truth(&mut self, header: &TruthHeader, alphas: &[Vec2]) -> f64 {
        let t_ns = header.t_ns;
        self.pairs.truth(t_ns, alphas);
        let now = self.over_time.now(alphas);
        let now = now.map(|now| Closest { distance_m: now.distance_m, pair: now.pair, t_ns });
        self.nearest = now;
        let plant = seen_by_plant(header);
        if let Some(seen) = plant
            && self.seen.replace(seen) != Some(seen)
        {
            self.pairs.seen_by_plant(seen);
        }
        for seen in [plant, now].into_iter().flatten() {
            if self.closest.is_none_or(|closest| seen.distance_m < closest.distance_m) {
                self.closest = Some(seen);
            }
        }
        let distance_m = now.map_or(f64::INFINITY, |closest| closest.distance_m);
        self.violations += u64::from(distance_m < self.distance_min_m);
        self.violations_plant = header.violations;
        let before_ns = self.newest_t_ns.replace(t_ns);
        let news = |seen: &Closest| before_ns.is_none_or(|t_ns| seen.t_ns > t_ns);
        plant.filter(news).map_or(distance_m, |seen| distance_m.min(seen.distance_m))
    }

    /// The smallest distance at the newest truth, m, and of which two.
    pub(super) fn nearest(&self) -> Option<(f64, [usize; 2])> {
        self.nearest.map(|nearest| (nearest.distance_m, nearest.pair))
    }

    /// The smallest distance of all.
    pub(super) fn closest(&self) -> Option<Closest> {
        self.closest
    }

    /// Ticks (arcs' ends, in real time) at which some pair was too near.
    pub(super) fn violations(&self) -> u64 {
        self.violations.max(self.violations_plant)
    }
}

/// What the plant saw so far, at the end of an arc that no truth may tell of.
fn seen_by_plant(header: &TruthHeader) -> Option<Closest> {
    let seen = Closest {
        distance_m: header.closest_m,
        pair: header.closest_pair.map(|place| place as usize),
        t_ns: header.closest_t_ns,
    };
    seen.distance_m.is_finite().then_some(seen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::examples::header;
    use formation::closest::closest_pair;
    use formation::seconds;
    use proptest::prelude::*;

    /// What looking at all pairs at every truth gives.
    struct AllPairs(Vec<(f64, u64)>);

    impl AllPairs {
        fn truth(&mut self, t_ns: u64, alphas: &[Vec2]) {
            let mut least = self.0.iter_mut();
            for (i, a) in alphas.iter().enumerate() {
                for (b, least) in alphas[i + 1..].iter().zip(&mut least) {
                    let square = (a - b).norm_squared();
                    if square < least.0 {
                        *least = (square, t_ns);
                    }
                }
            }
        }

        fn seen_by_plant(&mut self, place: usize, closest: &Closest) {
            let square = closest.distance_m * closest.distance_m;
            if square < self.0[place].0 * (1.0 - 1e-12) {
                self.0[place] = (square, closest.t_ns);
            }
        }
    }

    /// One robot's way: it stands, sways, approaches and leaves, with all others or alone; now and
    /// then it jumps, and where things are badly broken it is nowhere.
    #[derive(Debug, Clone)]
    struct Way {
        start_m: (f64, f64),
        step_m: (f64, f64),
        sway_m: f64,
        stops: u64,
        jumps: u64,
        broken_m: f64,
    }

    impl Way {
        fn at(&self, tick: u64) -> Vec2 {
            let moving = tick.min(self.stops) as f64;
            let mut alpha = Vec2::new(self.start_m.0, self.start_m.1)
                + Vec2::new(self.step_m.0, self.step_m.1) * moving
                + Vec2::new(0.02 * tick as f64, self.sway_m * (0.1 * moving).sin());
            if (self.jumps..self.jumps + 2).contains(&tick) {
                alpha.x += 0.5 + self.broken_m;
            }
            alpha
        }
    }

    fn robot() -> impl Strategy<Value = Way> {
        let start = prop_oneof![Just((0.0, 0.0)), (-9.0..9.0f64, -9.0..9.0f64), Just((3e8, -1e9))];
        let step = prop_oneof![Just((0.0, 0.0)), (-0.1..0.1f64, -0.1..0.1f64)];
        let sway = prop_oneof![Just(0.0), Just(1e-16), 1e-3..1.0f64];
        let broken = prop::sample::select(vec![0.0, 0.0, 0.0, f64::NAN, f64::INFINITY, 1e200]);
        (start, step, sway, 0..300_u64, 0..300_u64, broken).prop_map(
            |(start_m, step_m, sway_m, stops, jumps, broken_m)| Way {
                start_m,
                step_m,
                sway_m,
                stops,
                jumps,
                broken_m,
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn every_pair_keeps_its_own_smallest_distance_and_its_time_bit_by_bit(
            robots in prop::collection::vec(robot(), 0..12),
            truths in 0..300_u64,
            plant in prop::collection::vec((0..300_u64, any::<prop::sample::Index>(), 0.0..9.0f64), 0..5),
        ) {
            let mut distances = Distances::new(robots.len(), 0.0);
            let pairs = robots.len() * robots.len().saturating_sub(1) / 2;
            let mut expected = AllPairs(vec![(f64::INFINITY, 0); pairs]);
            let names: Vec<String> = (0..robots.len()).map(|i| i.to_string()).collect();
            let mut seen = header(0);
            for tick in 0..truths {
                let alphas: Vec<Vec2> = robots.iter().map(|robot| robot.at(tick)).collect();
                let t_ns = 1000 * tick;
                for (at, pair, distance_m) in plant.iter().filter(|_| robots.len() > 1) {
                    if *at == tick && *distance_m < seen.closest_m {
                        seen.closest_m = *distance_m;
                        seen.closest_t_ns = t_ns.saturating_sub(1);
                        let i = pair.index(robots.len() - 1);
                        seen.closest_pair = [i as u32, i as u32 + 1];
                    }
                }
                distances.truth(&TruthHeader { t_ns, ..seen }, &alphas);
                expected.truth(t_ns, &alphas);
                if let Some(seen) = seen_by_plant(&seen) {
                    expected.seen_by_plant(distances.pairs.place(seen.pair), &seen);
                }
                let (nearest, all) = (distances.nearest(), closest_pair(&alphas));
                prop_assert_eq!(nearest.map(|(_, pair)| pair), all.map(|c| c.pair));
                prop_assert_eq!(
                    nearest.map(|(m, _)| m.to_bits()), all.map(|c| c.distance_m.to_bits())
                );
            }
            let expected = expected.0.iter().filter(|(square, _)| square.is_finite());
            let expected: Vec<_> = expected.map(|&(square, t_ns)| (square.sqrt(), seconds(t_ns))).collect();
            let pairs = distances.pairs.report(&names).into_iter();
            let pairs: Vec<_> = pairs.map(|pair| (pair.min_distance_m, pair.t_s)).collect();
            prop_assert_eq!(pairs, expected);
        }
    }
}
