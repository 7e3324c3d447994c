//! Which points are tried next: a portfolio of four searches with the same share of each batch.
//!
//! A batch depends on the seed and on what came of the batches before, never on the machine. The first ones are small, so
//! that something is learnt before much is tried; later ones keep all cores busy.

use formation::random::SplitMix64;
use formation::real;

use crate::hunt::cma::{Cma, normal, reflected};

/// Points of one member in a batch, and in one of the first.
const SHARE: usize = 16;
const SHARE_AT_FIRST: usize = 4;
/// Points of the first, small batches.
const FIRST: usize = 1024;
/// Points of a generation of CMA-ES, handed out over as many batches as it takes.
const GENERATION: usize = 16;
/// How many of the best are parents.
const PARENTS: usize = 8;
/// A search that gets no better for so many batches begins anew.
const PATIENCE: u32 = 12;
/// Steps of a restarted search, and of one that is about to give up.
const STEP: f64 = 0.2;
const STEP_MIN: f64 = 0.002;

/// Who asks for a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Member {
    /// Points anywhere.
    Uniform,
    /// Changes of the best so far.
    Mutation,
    /// CMA-ES on what changes gradually, from the best or from anywhere.
    Cma,
    /// A descent that begins anew somewhere else once it gets no better.
    Restarts,
}

impl Member {
    /// The word for it.
    pub fn word(self) -> &'static str {
        match self {
            Member::Uniform => "uniform",
            Member::Mutation => "mutation",
            Member::Cma => "cma-es",
            Member::Restarts => "restarts",
        }
    }
}

/// A point to be tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Who asks for it.
    pub by: Member,
    /// Where it is in the unit cube.
    pub point: Vec<f64>,
}

/// A search under way.
pub struct Search<'s> {
    seed: u64,
    batch: u64,
    /// Points asked for so far.
    tried: usize,
    /// Of each coordinate: whether runs change gradually with it.
    gradual: Vec<bool>,
    /// Of each coordinate of a point: whether its run would be another one with another value there.
    matters: &'s dyn Fn(&[f64]) -> Vec<bool>,
    /// Tried before all others.
    own: Vec<f64>,
    uniform_only: bool,
    /// The best so far, best first.
    best: Vec<Found>,
    descent: Option<Descent>,
    cma: Option<CmaSearch>,
    /// How often CMA-ES began.
    cma_starts: u64,
    asked: Vec<Trial>,
}

#[derive(Debug, Clone)]
struct Found {
    cost: f64,
    point: Vec<f64>,
}

struct Descent {
    at: Found,
    step: f64,
}

struct CmaSearch {
    cma: Cma,
    /// What does not change gradually is that of this point.
    from: Vec<f64>,
    best: f64,
    idle: u32,
    /// Of the generation under way: what is still to be asked for, and what the others cost.
    left: Vec<Vec<f64>>,
    costs: Vec<f64>,
}

impl Search<'_> {
    /// A search of a cube with these coordinates, which tries `own` first. `matters` says of a point which of its
    /// coordinates its run depends on. `uniform_only`: points anywhere, and nothing is learnt.
    pub fn new(
        gradual: Vec<bool>,
        matters: &dyn Fn(&[f64]) -> Vec<bool>,
        own: Vec<f64>,
        seed: u64,
        uniform_only: bool,
    ) -> Search<'_> {
        Search {
            seed,
            batch: 0,
            tried: 0,
            gradual,
            matters,
            own,
            uniform_only,
            best: Vec::new(),
            descent: None,
            cma: None,
            cma_starts: 0,
            asked: Vec::new(),
        }
    }

    /// The next batch.
    pub fn ask(&mut self) -> &[Trial] {
        let mut random =
            SplitMix64::new(SplitMix64::new(self.seed ^ self.batch.rotate_left(32)).word());
        self.batch += 1;
        let n = self.gradual.len();
        let mut anywhere = || -> Vec<f64> { (0..n).map(|_| random.unit()).collect() };
        let alone = self.uniform_only || self.best.is_empty();
        let share = if self.tried < FIRST { SHARE_AT_FIRST } else { SHARE };
        let count = if alone { 4 * share } else { share };
        let mut points: Vec<Vec<f64>> = (0..count).map(|_| anywhere()).collect();
        if self.batch == 1 {
            points[0].clone_from(&self.own);
        }
        let by = |by| move |point| Trial { by, point };
        self.asked = points.into_iter().map(by(Member::Uniform)).collect();
        if !alone {
            let drawn = self.cma_points(share, &mut random);
            // In place of what a generation lacks.
            let mutated = (drawn.len()..2 * share).map(|_| self.mutated(&mut random));
            let mutated: Vec<Trial> = mutated.map(by(Member::Mutation)).collect();
            let stepped = (0..share).map(|_| self.stepped(&mut random));
            let stepped: Vec<Trial> = stepped.map(by(Member::Restarts)).collect();
            self.asked.extend(mutated);
            self.asked.extend(drawn.into_iter().map(by(Member::Cma)));
            self.asked.extend(stepped);
        }
        self.tried += self.asked.len();
        &self.asked
    }

    /// What came of the batch asked for last: the smaller, the better; `None` could not be tried.
    pub fn tell(&mut self, costs: &[Option<f64>]) {
        let costs: Vec<f64> = costs.iter().map(|cost| cost.unwrap_or(f64::INFINITY)).collect();
        if self.uniform_only {
            return;
        }
        let of = |member: Member| {
            let trials = self.asked.iter().zip(&costs).filter(move |(trial, _)| trial.by == member);
            trials
                .map(|(trial, &cost)| Found { cost, point: trial.point.clone() })
                .collect::<Vec<_>>()
        };
        let [uniform, stepped] = [Member::Uniform, Member::Restarts].map(of);
        let drawn: Vec<f64> = of(Member::Cma).iter().map(|found| found.cost).collect();
        let all = self.asked.iter().zip(&costs).filter(|(_, cost)| cost.is_finite());
        self.best.extend(all.map(|(trial, &cost)| Found { cost, point: trial.point.clone() }));
        // A stable sort: of equals, the first.
        self.best.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        self.best.truncate(PARENTS);
        self.learn_descent(&uniform, &stepped);
        self.learn_cma(&drawn);
    }

    /// One of the best, crossed with another one now and then, changed in a few coordinates.
    fn mutated(&self, random: &mut SplitMix64) -> Vec<f64> {
        let parent = |random: &mut SplitMix64| {
            // The better, the more likely.
            let place = (random.unit() * random.unit() * self.best.len() as f64) as usize;
            &self.best[place].point
        };
        let mut point = parent(random).clone();
        if random.chance(0.3) {
            let other = parent(random);
            point.iter_mut().zip(other).filter(|_| random.chance(0.5)).for_each(|(x, y)| *x = *y);
        }
        let changes = 5.0 * random.unit() * random.unit();
        // From steps of all the cube to a thirtieth of it.
        let step = 0.5 * real::pow(0.03, random.unit());
        self.change(&mut point, changes, step, random);
        point
    }

    /// Changes one coordinate that matters, and so many others: by a step, or to anywhere.
    fn change(&self, point: &mut [f64], changes: f64, step: f64, random: &mut SplitMix64) {
        let matters = (self.matters)(point);
        let count = matters.iter().filter(|matters| **matters).count();
        let forced = (random.unit() * count as f64) as usize;
        let places = (0..point.len()).filter(|&place| matters[place]).enumerate();
        for (nth, place) in places {
            if nth == forced || random.chance(changes / count as f64) {
                let steps = self.gradual[place] && random.chance(0.8);
                let x = &mut point[place];
                *x = if steps { reflected(*x + step * normal(random)) } else { random.unit() };
            }
        }
    }

    fn stepped(&self, random: &mut SplitMix64) -> Vec<f64> {
        let Some(Descent { at, step }) = &self.descent else { return self.mutated(random) };
        let mut point = at.point.clone();
        self.change(&mut point, 1.0, *step, random);
        point
    }

    /// Goes on from what was better, with smaller steps where nothing was; at last from the best of the uniform.
    fn learn_descent(&mut self, uniform: &[Found], stepped: &[Found]) {
        let least =
            |found: &[Found]| found.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).cloned();
        let Some(descent) = &mut self.descent else {
            self.descent = least(uniform).map(|at| Descent { at, step: STEP });
            return;
        };
        match least(stepped) {
            Some(better) if better.cost < descent.at.cost => descent.at = better,
            _ => descent.step *= real::pow(0.7, stepped.len() as f64 / SHARE as f64),
        }
        if descent.step < STEP_MIN {
            self.descent = least(uniform).map(|at| Descent { at, step: STEP });
        }
    }

    /// The next points of the generation under way, of a new one, or of a new search: at most so many.
    fn cma_points(&mut self, most: usize, random: &mut SplitMix64) -> Vec<Vec<f64>> {
        if !self.gradual.contains(&true) {
            return Vec::new();
        }
        let (n, gradual) = (self.gradual.len(), &self.gradual);
        let (starts, best) = (&mut self.cma_starts, &self.best[0].point);
        let search = self.cma.get_or_insert_with(|| {
            // By turns from the best and from anywhere.
            *starts += 1;
            let from = match *starts % 2 {
                1 => best.clone(),
                _ => (0..n).map(|_| random.unit()).collect(),
            };
            let mean = from.iter().zip(gradual).filter(|(_, gradual)| **gradual).map(|(x, _)| *x);
            let cma = Cma::new(mean.collect(), STEP);
            let (left, costs) = (Vec::new(), Vec::new());
            CmaSearch { cma, from, best: f64::INFINITY, idle: 0, left, costs }
        });
        if search.left.is_empty() {
            search.left = search.cma.ask(random, GENERATION);
        }
        let whole = |drawn: Vec<f64>| {
            let mut drawn = drawn.into_iter();
            let both = search.from.iter().zip(gradual);
            both.map(|(x, gradual)| if *gradual { drawn.next().unwrap_or(*x) } else { *x })
                .collect()
        };
        let count = most.min(search.left.len());
        search.left.drain(..count).map(whole).collect()
    }

    fn learn_cma(&mut self, costs: &[f64]) {
        let Some(search) = &mut self.cma else { return };
        search.costs.extend(costs);
        if search.costs.len() < GENERATION {
            return;
        }
        search.cma.tell(&search.costs);
        let least = search.costs.drain(..).fold(f64::INFINITY, f64::min);
        search.idle = if least < search.best { 0 } else { search.idle + 1 };
        search.best = search.best.min(least);
        if search.idle >= PATIENCE || search.cma.sigma < STEP_MIN {
            self.cma = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many points are tried until one costs less than 0: all of eight coordinates must be near 0.8, and one
    /// that is not gradual in its last tenth.
    fn trials_to_find(seed: u64, uniform_only: bool, most: usize) -> usize {
        let gradual: Vec<bool> = (0..9).map(|place| place < 8).collect();
        let all = |point: &[f64]| vec![true; point.len()];
        let mut search = Search::new(gradual, &all, vec![0.5; 9], seed, uniform_only);
        let mut tried = 0;
        while tried < most {
            let cost = |trial: &Trial| {
                let off = trial.point[..8].iter().map(|x| (x - 0.8).abs()).fold(0.0, f64::max);
                off - 0.15 + if trial.point[8] < 0.9 { 0.5 } else { 0.0 }
            };
            let costs: Vec<f64> = search.ask().iter().map(cost).collect();
            if let Some(first) = costs.iter().position(|cost| *cost < 0.0) {
                return tried + first + 1;
            }
            tried += costs.len();
            search.tell(&costs.into_iter().map(Some).collect::<Vec<_>>());
        }
        most
    }

    #[test]
    fn the_portfolio_finds_in_a_few_thousand_trials_what_chance_finds_in_no_hundred_thousand() {
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
    fn each_member_has_the_same_share_and_what_cannot_be_tried_is_no_parent() {
        let all = |point: &[f64]| vec![true; point.len()];
        let mut search = Search::new(vec![true; 4], &all, vec![0.5; 4], 1, false);
        assert_eq!(search.ask()[0].point, [0.5; 4]);
        search.tell(&[None; 4 * SHARE_AT_FIRST]);
        assert!(search.ask().iter().all(|trial| trial.by == Member::Uniform), "nothing is learnt");
        let mut told = 4 * SHARE_AT_FIRST;
        for (batch, share) in [4; 62].into_iter().chain([16; 20]).enumerate() {
            search.tell(&vec![Some(1.0); told]);
            let asked = search.ask();
            told = asked.len();
            assert_eq!(told, 4 * share);
            for member in [Member::Uniform, Member::Mutation, Member::Cma, Member::Restarts] {
                let count = asked.iter().filter(|trial| trial.by == member).count();
                // Where the batches grow, a generation of CMA-ES ends with fewer.
                assert!(count == share || batch == 62, "{member:?} in batch {batch}: {count}");
            }
        }
    }

    #[test]
    fn what_does_not_matter_is_left_as_it_is() {
        let first = |point: &[f64]| (0..point.len()).map(|place| place == 0).collect();
        let mut search = Search::new(vec![true; 4], &first, vec![0.5; 4], 1, false);
        search.ask();
        search.tell(&[Some(1.0)]);
        let asked = search.ask();
        let mutated: Vec<_> = asked.iter().filter(|trial| trial.by == Member::Mutation).collect();
        assert!(!mutated.is_empty());
        assert!(mutated.iter().all(|trial| trial.point[1..] == [0.5; 3] && trial.point[0] != 0.5));
    }
}
