//! Portfolio of five search strategies that propose the points to try next. Each strategy gets one point in 25; the
//! rest goes to those whose recent points were among the best, and if there are none, mostly to uniform random points.
//!
//! A batch depends only on the seed and the results of earlier batches, never on the machine. The first batches are
//! small, so that the search learns early; later ones keep all CPU cores busy.
//!
//! Uniform random points are those of a purely random search, in the same order. A result that such a search finds in
//! its first 96 points is found as early here; a later one is delayed by the points of the other strategies.

use std::collections::BTreeMap;

use formation::portable_math;
use formation::random::SplitMix64;

use crate::hunt::cma::{Cma, draw_standard_normal, reflect_into_unit_interval};
use crate::hunt::space::CoordinateLayout;

/// Number of uniform random points at the start.
const UNIFORM_POINTS: usize = 96;
/// Batch sizes: the number of points tried so far, and the size from there on.
const BATCH_SIZES: [(usize, usize); 4] = [(0, 16), (UNIFORM_POINTS, 4), (256, 16), (1024, 64)];
/// Probability that a changed coordinate is set to an end of its range, where delays and losses have most effect.
const RANGE_END_PROBABILITY: f64 = 0.25;
/// Minimum fraction of the points of each strategy.
const STRATEGY_FRACTION_MIN: f64 = 0.04;
/// Cost resolution. Smaller differences do not count as progress.
const COST_RESOLUTION: f64 = 1e-3;
/// Decay factor of the success statistics of a strategy per point that it tries.
const SUCCESS_DECAY: f64 = 0.95;
/// Population size of CMA-ES. A generation can span several batches.
const CMA_POPULATION_SIZE: usize = 16;
/// Number of best points that serve as parents.
const PARENT_COUNT: usize = 8;
/// Number of generations without progress after which CMA-ES restarts.
const STALLED_GENERATIONS_MAX: u32 = 12;
/// Initial step of a restarted search. It gives up below [`DESCENT_STEP_MIN`].
const DESCENT_STEP_INITIAL: f64 = 0.2;
const DESCENT_STEP_MIN: f64 = 0.002;

/// Search strategy that proposes points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strategy {
    /// Uniform random points.
    Uniform,
    /// Mutations of the best points.
    Mutation,
    /// CMA-ES on the continuous coordinates, started at the best point or at a random one.
    Cma,
    /// Local descent that restarts elsewhere when it makes no progress.
    RestartedDescent,
    /// Mutations of runs with rare events.
    Novelty,
}

const STRATEGIES: [Strategy; 5] = [
    Strategy::Uniform,
    Strategy::Mutation,
    Strategy::Cma,
    Strategy::RestartedDescent,
    Strategy::Novelty,
];

impl Strategy {
    /// Returns the name of the strategy.
    pub fn keyword(self) -> &'static str {
        match self {
            Strategy::Uniform => "uniform",
            Strategy::Mutation => "mutation",
            Strategy::Cma => "cma-es",
            Strategy::RestartedDescent => "restarts",
            Strategy::Novelty => "novelty",
        }
    }
}

/// A point to try.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Strategy that proposed the point.
    pub proposed_by: Strategy,
    /// Coordinates in the unit cube.
    pub point: Vec<f64>,
}

/// Evaluation of a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Cost; smaller is better.
    pub cost: f64,
    /// Observed events, as numbers.
    pub observed_events: Vec<u16>,
}

impl Evaluation {
    /// Returns the cost, rounded up to the cost resolution.
    fn rounded_cost(&self) -> f64 {
        (self.cost / COST_RESOLUTION).ceil() * COST_RESOLUTION
    }
}

/// State of a search.
pub struct Search<'s> {
    seed: u64,
    batch_count: u64,
    /// Number of points proposed so far.
    proposed_count: usize,
    coordinate_layout: CoordinateLayout,
    /// Returns for each coordinate of a point whether its run depends on it.
    used_coordinates: &'s dyn Fn(&[f64]) -> Vec<bool>,
    /// First point to try.
    first_point: Vec<f64>,
    is_uniform_only: bool,
    /// Random numbers of the uniform points.
    uniform_random: SplitMix64,
    /// For each strategy, the accumulated fractions of batches minus the points that it got.
    strategy_credit: [f64; STRATEGIES.len()],
    /// Best points found, best first.
    best_points: Vec<EvaluatedPoint>,
    /// For each strategy, the decayed numbers of points that were among the best, and of points tried.
    strategy_success: [(f64, f64); STRATEGIES.len()],
    /// For each observed event, the number of points with it and the best of them.
    best_by_event: BTreeMap<u16, (u32, EvaluatedPoint)>,
    descent: Option<Descent>,
    cma: Option<CmaSearch>,
    /// Number of starts of CMA-ES.
    cma_starts: u64,
    pending_trials: Vec<Trial>,
}

#[derive(Debug, Clone)]
struct EvaluatedPoint {
    cost: f64,
    point: Vec<f64>,
}

struct Descent {
    current_point: EvaluatedPoint,
    step: f64,
}

struct CmaSearch {
    cma: Cma,
    /// Point that supplies the discrete coordinates.
    discrete_source: Vec<f64>,
    best_cost: f64,
    stalled_generations: u32,
    /// Points of the current generation that are not yet proposed.
    remaining_points: Vec<Vec<f64>>,
    costs: Vec<f64>,
}

impl Search<'_> {
    /// Creates a search over points of this layout. It tries `first_point` first. `used_coordinates` returns for each
    /// coordinate of a point whether its run depends on it. With `is_uniform_only` all points are uniform and nothing
    /// is learned.
    pub fn new(
        coordinate_layout: CoordinateLayout,
        used_coordinates: &dyn Fn(&[f64]) -> Vec<bool>,
        first_point: Vec<f64>,
        seed: u64,
        is_uniform_only: bool,
    ) -> Search<'_> {
        Search {
            seed,
            batch_count: 0,
            proposed_count: 0,
            coordinate_layout,
            used_coordinates,
            first_point,
            is_uniform_only,
            uniform_random: SplitMix64::new(SplitMix64::new(seed).next_u64()),
            strategy_credit: Default::default(),
            best_points: Vec::new(),
            strategy_success: Default::default(),
            best_by_event: BTreeMap::new(),
            descent: None,
            cma: None,
            cma_starts: 0,
            pending_trials: Vec::new(),
        }
    }

    /// Returns the next batch of points.
    pub fn propose_batch(&mut self) -> &[Trial] {
        let mut random = SplitMix64::new(
            SplitMix64::new(self.seed ^ self.batch_count.rotate_left(32)).next_u64(),
        );
        self.batch_count += 1;
        let only_uniform = self.is_uniform_only
            || self.best_points.is_empty()
            || self.proposed_count < UNIFORM_POINTS;
        let is_due = |(from, size): &&(usize, usize)| {
            *from <= self.proposed_count && !(only_uniform && *size < BATCH_SIZES[0].1)
        };
        let size = BATCH_SIZES.iter().rfind(is_due).map_or(1, |(_, size)| *size);
        let counts = match only_uniform {
            true => [size, 0, 0, 0, 0],
            false => self.allocate_batch(size),
        };
        self.pending_trials.clear();
        for (proposed_by, count) in STRATEGIES.into_iter().zip(counts) {
            let points = self.propose_points(proposed_by, count, &mut random);
            self.pending_trials
                .extend(points.into_iter().map(|point| Trial { proposed_by, point }));
        }
        // Replaces points that the generation lacks.
        for _ in self.pending_trials.len()..size {
            let point = self.mutate_best_point(&mut random);
            self.pending_trials.push(Trial { proposed_by: Strategy::Mutation, point });
        }
        if self.batch_count == 1 {
            self.pending_trials[0].point.clone_from(&self.first_point);
        }
        self.proposed_count += self.pending_trials.len();
        &self.pending_trials
    }

    /// Returns the number of points of a batch for each strategy.
    fn allocate_batch(&mut self, size: usize) -> [usize; STRATEGIES.len()] {
        // Prior successes keep every strategy alive. Without any success uniform points are the best choice, because
        // margins can mislead. If all of the best are equal, they give no information.
        let all_equal = self.best_points.len() == PARENT_COUNT
            && self.best_points[0].cost == self.best_points[PARENT_COUNT - 1].cost;
        let rates =
            STRATEGIES.map(|member| match (self.strategy_success[member as usize], member) {
                ((found, tried), Strategy::Uniform) => (found + 1.0) / (tried + 10.0),
                _ if all_equal => 0.0,
                ((found, tried), Strategy::Novelty) => (found + 0.5) / (tried + 10.0),
                ((found, tried), _) => (found + 0.1) / (tried + 10.0),
            });
        let rate_sum: f64 = rates.iter().sum();
        let rest = 1.0 - STRATEGY_FRACTION_MIN * STRATEGIES.len() as f64;
        let mut counts = [0; STRATEGIES.len()];
        for _ in 0..size {
            for (owed, rate) in self.strategy_credit.iter_mut().zip(rates) {
                *owed += STRATEGY_FRACTION_MIN + rest * rate / rate_sum;
            }
            let by_credit = |a: &usize, b: &usize| {
                self.strategy_credit[*a].total_cmp(&self.strategy_credit[*b])
            };
            let chosen = (0..STRATEGIES.len()).max_by(by_credit).unwrap_or_default();
            self.strategy_credit[chosen] -= 1.0;
            counts[chosen] += 1;
        }
        counts
    }

    fn propose_points(
        &mut self,
        strategy: Strategy,
        count: usize,
        random: &mut SplitMix64,
    ) -> Vec<Vec<f64>> {
        if strategy == Strategy::Cma {
            return self.propose_cma_points(count, random);
        }
        let n = self.coordinate_layout.is_continuous.len();
        let point = |_| match strategy {
            Strategy::Mutation => self.mutate_best_point(random),
            Strategy::RestartedDescent => self.propose_descent_point(random),
            Strategy::Novelty => self.mutate_rare_event_point(random),
            Strategy::Uniform | Strategy::Cma => {
                (0..n).map(|_| self.uniform_random.draw_unit()).collect()
            }
        };
        (0..count).map(point).collect()
    }

    /// Records the evaluations of the last batch. `None`: the point could not be tried.
    pub fn record_evaluations(&mut self, evaluations: &[Option<Evaluation>]) {
        if self.is_uniform_only {
            return;
        }
        let evaluated_point = |(trial, evaluation): (&Trial, &Option<Evaluation>)| EvaluatedPoint {
            cost: evaluation.as_ref().map_or(f64::INFINITY, Evaluation::rounded_cost),
            point: trial.point.clone(),
        };
        let evaluated: Vec<EvaluatedPoint> =
            self.pending_trials.iter().zip(evaluations).map(evaluated_point).collect();
        let points_of = |member: Strategy| {
            let points = self
                .pending_trials
                .iter()
                .zip(&evaluated)
                .filter(|(trial, _)| trial.proposed_by == member);
            points.map(|(_, point)| point.clone()).collect::<Vec<_>>()
        };
        let [uniform, descent, cma] =
            [Strategy::Uniform, Strategy::RestartedDescent, Strategy::Cma].map(points_of);
        let worst =
            self.best_points.get(PARENT_COUNT - 1).map_or(f64::INFINITY, |point| point.cost);
        for ((trial, evaluation), candidate) in
            self.pending_trials.iter().zip(evaluations).zip(evaluated)
        {
            let (found, tried) = &mut self.strategy_success[trial.proposed_by as usize];
            *found = SUCCESS_DECAY * *found + f64::from(candidate.cost < worst);
            *tried = SUCCESS_DECAY * *tried + 1.0;
            let Some(evaluation) = evaluation else { continue };
            for event in &evaluation.observed_events {
                let (count, best) =
                    self.best_by_event.entry(*event).or_insert((0, candidate.clone()));
                *count += 1;
                // Among equals the last one is taken, so that the descent continues on a plateau.
                if candidate.cost <= best.cost {
                    best.clone_from(&candidate);
                }
            }
            self.best_points.insert(0, candidate);
        }
        // The sort is stable: among equals, the last one tried.
        self.best_points.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        self.best_points.truncate(PARENT_COUNT);
        self.update_descent(&uniform, &descent);
        self.update_cma(&cma);
    }

    /// Returns a mutation of one of the best points.
    fn mutate_best_point(&self, random: &mut SplitMix64) -> Vec<f64> {
        self.mutate_point(self.choose_parent(random), random)
    }

    /// Returns a mutation of the best point with a rare event. Rarer events are more likely to be chosen.
    fn mutate_rare_event_point(&self, random: &mut SplitMix64) -> Vec<f64> {
        let all: f64 = self.best_by_event.values().map(|(count, _)| 1.0 / f64::from(*count)).sum();
        let mut left = random.draw_unit() * all;
        let chosen = self.best_by_event.values().find(|(count, _)| {
            left -= 1.0 / f64::from(*count);
            left < 0.0
        });
        let parent = chosen.map_or_else(|| self.choose_parent(random), |(_, found)| found);
        self.mutate_point(parent, random)
    }

    /// Chooses one of the best points. Better ones are more likely.
    fn choose_parent(&self, random: &mut SplitMix64) -> &EvaluatedPoint {
        &self.best_points
            [(random.draw_unit() * random.draw_unit() * self.best_points.len() as f64) as usize]
    }

    /// Returns a mutation of `from`: sometimes with parts of another parent or another fault, and with a few
    /// coordinates changed.
    fn mutate_point(&self, from: &EvaluatedPoint, random: &mut SplitMix64) -> Vec<f64> {
        let mut point = from.point.clone();
        if random.draw_bool(0.5) {
            let other = &self.choose_parent(random).point;
            for part in
                self.coordinate_layout.coordinate_groups.iter().filter(|_| random.draw_bool(0.5))
            {
                point[part.clone()].copy_from_slice(&other[part.clone()]);
            }
        }
        if random.draw_bool(0.4) {
            self.mutate_faults(&mut point, random);
        }
        let changes = 5.0 * random.draw_unit() * random.draw_unit();
        // Step sizes from the whole cube to a thirtieth of it.
        let step = 0.5 * portable_math::pow(0.03, random.draw_unit());
        self.change_coordinates(&mut point, changes, step, random);
        point
    }

    /// Adds or replaces a fault by a random one or one of a parent.
    fn mutate_faults(&self, point: &mut [f64], random: &mut SplitMix64) {
        let (Some(count_index), slots) =
            (self.coordinate_layout.fault_count_index, self.coordinate_layout.fault_groups.len())
        else {
            return;
        };
        let pick_index =
            |count: usize, random: &mut SplitMix64| (random.draw_unit() * count as f64) as usize;
        let fault_count =
            |point: &[f64]| ((point[count_index] * (slots + 1) as f64) as usize).min(slots);
        let fault_coordinates = |fault: usize| {
            self.coordinate_layout.coordinate_groups
                [self.coordinate_layout.fault_groups.start + fault]
                .clone()
        };
        let (own_count, other) = (fault_count(point), self.choose_parent(random));
        let mut target = pick_index(own_count, random);
        if own_count < slots && (own_count == 0 || random.draw_bool(0.5)) {
            target = own_count;
            point[count_index] = (own_count as f64 + 1.5) / (slots + 1) as f64;
        }
        match fault_count(&other.point) {
            other_count if other_count > 0 && random.draw_bool(0.5) => {
                let source = fault_coordinates(pick_index(other_count, random));
                point[fault_coordinates(target)].copy_from_slice(&other.point[source]);
            }
            _ => fault_coordinates(target).for_each(|coordinate| {
                point[coordinate] = match self.coordinate_layout.is_continuous[coordinate] {
                    true if random.draw_bool(RANGE_END_PROBABILITY) => draw_range_end(random),
                    _ => random.draw_unit(),
                }
            }),
        }
    }

    /// Changes one coordinate that matters, and `changes` others on average, by a step or to a random value.
    fn change_coordinates(
        &self,
        point: &mut [f64],
        changes: f64,
        step: f64,
        random: &mut SplitMix64,
    ) {
        let is_used = (self.used_coordinates)(point);
        let count = is_used.iter().filter(|is_used| **is_used).count();
        let always_changed = (random.draw_unit() * count as f64) as usize;
        let used = (0..point.len()).filter(|&index| is_used[index]).enumerate();
        for (position, index) in used {
            if position == always_changed || random.draw_bool(changes / count as f64) {
                let x = point[index];
                point[index] = match self.coordinate_layout.is_continuous[index] {
                    true if random.draw_bool(RANGE_END_PROBABILITY) => draw_range_end(random),
                    true if random.draw_bool(0.8) => {
                        reflect_into_unit_interval(x + step * draw_standard_normal(random))
                    }
                    _ => random.draw_unit(),
                };
            }
        }
    }

    fn propose_descent_point(&self, random: &mut SplitMix64) -> Vec<f64> {
        let Some(Descent { current_point, step }) = &self.descent else {
            return self.mutate_best_point(random);
        };
        let mut point = current_point.point.clone();
        self.change_coordinates(&mut point, 1.0, *step, random);
        point
    }

    /// Continues the descent from a better point, or with smaller steps if there is none. Finally restarts from the
    /// best uniform point.
    fn update_descent(&mut self, uniform: &[EvaluatedPoint], descent_points: &[EvaluatedPoint]) {
        let best = |found: &[EvaluatedPoint]| {
            found.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).cloned()
        };
        match (&mut self.descent, best(descent_points)) {
            (Some(descent), Some(best_point)) if best_point.cost < descent.current_point.cost => {
                descent.current_point = best_point
            }
            (Some(descent), _) => {
                descent.step *= portable_math::pow(
                    0.7,
                    descent_points.len() as f64 / CMA_POPULATION_SIZE as f64,
                );
            }
            (None, _) => {}
        }
        if self.descent.as_ref().is_none_or(|descent| descent.step < DESCENT_STEP_MIN) {
            self.descent = best(uniform)
                .map(|current_point| Descent { current_point, step: DESCENT_STEP_INITIAL });
        }
    }

    /// Returns at most `count_max` points of the current generation of CMA-ES, of a new generation, or of a new search.
    fn propose_cma_points(&mut self, count_max: usize, random: &mut SplitMix64) -> Vec<Vec<f64>> {
        if count_max == 0 || !self.coordinate_layout.is_continuous.contains(&true) {
            return Vec::new();
        }
        let (n, is_continuous) =
            (self.coordinate_layout.is_continuous.len(), &self.coordinate_layout.is_continuous);
        let (starts, best) = (&mut self.cma_starts, &self.best_points[0].point);
        let search = self.cma.get_or_insert_with(|| {
            // Alternately started at the best point and at a random one.
            *starts += 1;
            let start = match *starts % 2 {
                1 => best.clone(),
                _ => (0..n).map(|_| random.draw_unit()).collect(),
            };
            let mean = start
                .iter()
                .zip(is_continuous)
                .filter(|(_, is_continuous)| **is_continuous)
                .map(|(x, _)| *x);
            let cma = Cma::new(mean.collect(), DESCENT_STEP_INITIAL);
            let (remaining_points, costs) = (Vec::new(), Vec::new());
            CmaSearch {
                cma,
                discrete_source: start,
                best_cost: f64::INFINITY,
                stalled_generations: 0,
                remaining_points,
                costs,
            }
        });
        if search.remaining_points.is_empty() {
            search.remaining_points = search.cma.sample_points(random, CMA_POPULATION_SIZE);
        }
        let complete_point = |sampled: Vec<f64>| {
            let mut sampled = sampled.into_iter();
            let coordinates = search.discrete_source.iter().zip(is_continuous);
            coordinates
                .map(
                    |(x, is_continuous)| {
                        if *is_continuous { sampled.next().unwrap_or(*x) } else { *x }
                    },
                )
                .collect()
        };
        let count = count_max.min(search.remaining_points.len());
        search.remaining_points.drain(..count).map(complete_point).collect()
    }

    fn update_cma(&mut self, cma_points: &[EvaluatedPoint]) {
        let Some(search) = &mut self.cma else { return };
        search.costs.extend(cma_points.iter().map(|found| found.cost));
        if search.costs.len() < CMA_POPULATION_SIZE {
            return;
        }
        search.cma.update_from_costs(&search.costs);
        let best_cost = search.costs.drain(..).fold(f64::INFINITY, f64::min);
        search.stalled_generations =
            if best_cost < search.best_cost { 0 } else { search.stalled_generations + 1 };
        search.best_cost = search.best_cost.min(best_cost);
        if search.stalled_generations >= STALLED_GENERATIONS_MAX
            || search.cma.sigma < DESCENT_STEP_MIN
        {
            self.cma = None;
        }
    }
}

/// Returns one of the ends of a coordinate's range.
pub(super) fn draw_range_end(random: &mut SplitMix64) -> f64 {
    f64::from(u8::from(random.draw_bool(0.5)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test_layout(n: usize) -> CoordinateLayout {
        CoordinateLayout { is_continuous: vec![true; n], ..CoordinateLayout::default() }
    }

    fn all_coordinates_used(point: &[f64]) -> Vec<bool> {
        vec![true; point.len()]
    }

    fn evaluation_of_cost(cost: f64) -> Option<Evaluation> {
        Some(Evaluation { cost, observed_events: Vec::new() })
    }

    /// Returns the number of points tried until one costs less than 0: all of eight coordinates must be near 0.8, and
    /// one is discontinuous in its last tenth.
    fn trials_to_find(seed: u64, uniform_only: bool, trials_max: usize) -> usize {
        let is_continuous: Vec<bool> = (0..9).map(|index| index < 8).collect();
        let layout = CoordinateLayout { is_continuous, ..CoordinateLayout::default() };
        let mut search =
            Search::new(layout, &all_coordinates_used, vec![0.5; 9], seed, uniform_only);
        let mut tried = 0;
        while tried < trials_max {
            let cost = |trial: &Trial| {
                let deviation =
                    trial.point[..8].iter().map(|x| (x - 0.8).abs()).fold(0.0, f64::max);
                deviation - 0.15 + if trial.point[8] < 0.9 { 0.5 } else { 0.0 }
            };
            let costs: Vec<f64> = search.propose_batch().iter().map(cost).collect();
            if let Some(first) = costs.iter().position(|cost| *cost < 0.0) {
                return tried + first + 1;
            }
            tried += costs.len();
            search
                .record_evaluations(&costs.into_iter().map(evaluation_of_cost).collect::<Vec<_>>());
        }
        trials_max
    }

    #[test]
    fn portfolio_search_beats_uniform_search() {
        for seed in 1..=5 {
            let portfolio = trials_to_find(seed, false, 6_400);
            assert!(portfolio < 6_400, "seed {seed}");
            assert_eq!(portfolio, trials_to_find(seed, false, 6_400), "the same again");
            assert!(
                trials_to_find(seed, true, 64_000) > 10 * portfolio,
                "seed {seed}: {portfolio}"
            );
        }
    }

    #[test]
    fn best_strategy_gets_most_trials_and_invalid_is_no_parent() {
        let mut search = Search::new(test_layout(4), &all_coordinates_used, vec![0.5; 4], 1, false);
        assert_eq!(search.propose_batch()[0].point, [0.5; 4]);
        for _ in 0..UNIFORM_POINTS / 8 {
            search.record_evaluations(&[const { None }; 16]);
            let trials = search.propose_batch();
            assert!(
                trials.iter().all(|trial| trial.proposed_by == Strategy::Uniform),
                "nothing is learnt"
            );
        }
        search.record_evaluations(&vec![evaluation_of_cost(1.0); 16]);
        let mut counts = [0; STRATEGIES.len()];
        let mut cost = 1.0;
        for _ in 0..300 {
            let by: Vec<Strategy> =
                search.propose_batch().iter().map(|trial| trial.proposed_by).collect();
            let mut costs = Vec::new();
            for by in by {
                counts[by as usize] += 1;
                cost -= 1e-3;
                costs.push(evaluation_of_cost(if by == Strategy::RestartedDescent {
                    cost
                } else {
                    2.0
                }));
            }
            search.record_evaluations(&costs);
        }
        let all: usize = counts.iter().sum();
        assert!(counts[Strategy::RestartedDescent as usize] > all / 3, "{counts:?}");
        assert!(counts.iter().all(|count| *count > all / 40), "{counts:?}");
    }

    /// Only the observed events guide the search: each of eight coordinates above 0.75, one after the other, adds an
    /// event.
    #[test]
    fn search_follows_rare_events_on_a_flat_cost() {
        let trials = |uniform_only| {
            let mut search =
                Search::new(test_layout(8), &all_coordinates_used, vec![0.5; 8], 7, uniform_only);
            let mut tried = 0;
            while tried < 6_000 {
                let event_count = |point: &[f64]| point.iter().take_while(|x| **x > 0.75).count();
                let evaluate = |trial: &Trial| {
                    let observed_events = (0..=event_count(&trial.point) as u16).collect();
                    Some(Evaluation { cost: 1.0, observed_events })
                };
                let evaluations: Vec<_> = search.propose_batch().iter().map(evaluate).collect();
                if evaluations
                    .iter()
                    .flatten()
                    .any(|evaluation| evaluation.observed_events.len() == 9)
                {
                    return tried;
                }
                tried += evaluations.len();
                search.record_evaluations(&evaluations);
            }
            tried
        };
        assert!(trials(false) < 6_000 && trials(true) >= 6_000);
    }

    #[test]
    fn mutation_inherits_whole_faults() {
        // Faults of two coordinates each.
        let coordinate_groups = vec![0..1, 1..3, 3..5];
        let layout = CoordinateLayout {
            is_continuous: vec![true; 5],
            coordinate_groups,
            fault_count_index: Some(0),
            fault_groups: 1..3,
        };
        let mut search = Search::new(layout, &all_coordinates_used, vec![0.5; 5], 1, false);
        search.best_points.push(EvaluatedPoint { cost: 1.0, point: vec![0.5, 0.1, 0.2, 0.3, 0.4] });
        let mut random = SplitMix64::new(1);
        let (mut added, mut inherited) = (0, 0);
        for _ in 0..100 {
            let mut point = search.best_points[0].point.clone();
            search.mutate_faults(&mut point, &mut random);
            let first = if point[0] > 2.0 / 3.0 { 3 } else { 1 };
            added += usize::from(first == 3);
            inherited += usize::from(point[first..first + 2] == [0.1, 0.2]);
            assert!(first == 1 || point[1..3] == [0.1, 0.2], "{point:?}");
        }
        assert!((30..70).contains(&added) && (30..70).contains(&inherited), "{added} {inherited}");
    }

    #[test]
    fn tiny_improvement_is_no_progress_and_last_equal_is_parent() {
        let mut search = Search::new(test_layout(2), &all_coordinates_used, vec![0.5; 2], 1, false);
        search.propose_batch();
        search.record_evaluations(&vec![evaluation_of_cost(0.31); 16]);
        let found = search.strategy_success[Strategy::Uniform as usize].0;
        let last = search.propose_batch().last().expect("a batch").point.clone();
        search.record_evaluations(&vec![evaluation_of_cost(0.31 - 1e-9); 16]);
        assert!(search.strategy_success[Strategy::Uniform as usize].0 < found);
        assert_eq!(search.best_points[0].point, last);
        search.propose_batch();
        search.record_evaluations(&vec![evaluation_of_cost(0.30); 16]);
        assert!(search.strategy_success[Strategy::Uniform as usize].0 > found);
    }

    /// Without any gradient no strategy is better than chance. The portfolio must not be much worse.
    #[test]
    fn flat_cost_needs_at_most_1_2_times_the_trials_of_chance() {
        let uniform_trials = |uniform_only| {
            let mut search =
                Search::new(test_layout(4), &all_coordinates_used, vec![0.5; 4], 3, uniform_only);
            let mut trials: Vec<Trial> = Vec::new();
            while trials.len() < 2_500 {
                let batch = search.propose_batch().to_vec();
                search.record_evaluations(&vec![evaluation_of_cost(0.0); batch.len()]);
                trials.extend(batch);
            }
            let is_uniform = |(_, trial): &(usize, Trial)| trial.proposed_by == Strategy::Uniform;
            trials.into_iter().enumerate().filter(is_uniform).take(2_000).collect::<Vec<_>>()
        };
        for ((alone_index, alone), (portfolio_index, portfolio)) in
            uniform_trials(true).into_iter().zip(uniform_trials(false))
        {
            assert_eq!(alone.point, portfolio.point);
            assert!(10 * portfolio_index <= 12 * alone_index, "{alone_index} {portfolio_index}");
        }
    }

    #[test]
    fn continuous_variables_sometimes_jump_to_a_range_limit() {
        let layout =
            CoordinateLayout { is_continuous: vec![true, false], ..CoordinateLayout::default() };
        let search = Search::new(layout, &all_coordinates_used, vec![0.5; 2], 1, false);
        let mut random = SplitMix64::new(1);
        let mut limit_counts = [0; 2];
        for _ in 0..400 {
            let mut point = vec![0.5; 2];
            search.change_coordinates(&mut point, 2.0, 0.01, &mut random);
            for (count, x) in limit_counts.iter_mut().zip(point) {
                *count += u32::from(x == 0.0 || x == 1.0);
            }
        }
        assert!((70..130).contains(&limit_counts[0]) && limit_counts[1] == 0, "{limit_counts:?}");
    }

    #[test]
    fn unused_coordinates_are_not_mutated() {
        let is_first = |point: &[f64]| (0..point.len()).map(|index| index == 0).collect();
        let mut search = Search::new(test_layout(4), &is_first, vec![0.5; 4], 1, false);
        for _ in 0..UNIFORM_POINTS / 16 {
            search.propose_batch();
        }
        search.best_points.push(EvaluatedPoint { cost: 1.0, point: vec![0.5; 4] });
        let trials: Vec<Trial> = (0..20).flat_map(|_| search.propose_batch().to_vec()).collect();
        let mutated: Vec<_> =
            trials.iter().filter(|trial| trial.proposed_by == Strategy::Mutation).collect();
        assert!(!mutated.is_empty());
        assert!(mutated.iter().all(|trial| trial.point[1..] == [0.5; 3] && trial.point[0] != 0.5));
    }
}
