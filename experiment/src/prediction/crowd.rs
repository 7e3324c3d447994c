//! Who stands where somebody else wants to be, and who goes by those that therefore stand aside.
//! (Remark 1)
//!
//! Nobody comes to rest nearer to another than d_f. Where two would, everybody goes from its place
//! as planned towards the new one by the rules of the road: whoever gives way and finds its place
//! taken asks for one beside it; whoever comes too near is pushed back; who leads stays.

use std::f64::consts::FRAC_PI_2;

use formation::Vec2;
use formation::front_point::rotate;
use formation::hull::hull_distance;
use formation::laplacian::settle;
use protocol::law::Reference;

use super::{Broken, Cause, Predictor, Reduced};

/// Steps until a crowd has sorted itself out, or never will.
const STEPS: usize = 2000;
/// Share of the way to where it wants to be that a robot goes in a step.
const STEP: f64 = 0.2;
/// The longest step, as a share of d_f.
const STRIDE: f64 = 0.1;
/// Share of what is missing to d_f by which a robot moves away in a step.
const BACK: f64 = 0.25;
/// Slower than this, m per step, nobody moves.
const RESTS_M: f64 = 1e-7;
/// A place is taken if somebody is nearer to it than d_f by this much, m.
const TAKEN_M: f64 = 1e-3;

/// Where everybody ends once those have stood aside that must.
#[derive(Debug)]
pub(super) struct Crowd {
    /// Where it is, m.
    places: Vec<Vec2>,
    /// Who is not left behind.
    there: Vec<bool>,
    /// Whether anybody stood aside.
    stirred: bool,
    /// Where else everybody may be, m: a formation that moves drags one that stands off about whoever
    /// has its place, nobody can say how far.
    or_there: Vec<Vec<Vec2>>,
}

impl Crowd {
    /// Of robots that want to settle at `places`.
    pub(super) fn of(
        p: &Predictor,
        reduced: &Reduced,
        places: &[Vec2],
        behind: &[Option<Broken>],
    ) -> Crowd {
        let n = p.robots.len();
        // A formation that moves leaves bodies behind; in one that stands they stay in their places.
        let there: Vec<bool> = (0..n)
            .map(|i| if reduced.alive[i] { behind[i].is_none() } else { !reduced.moving })
            .collect();
        let mut crowd =
            Crowd { places: places.to_vec(), there, stirred: false, or_there: Vec::new() };
        let stirred = crowd.nearer_than_planned(p, reduced);
        if !stirred.is_empty() {
            crowd.stand_aside(p, reduced, &stirred);
            crowd.stirred = true;
            if reduced.moving {
                crowd.or_there = crowd.dragged_about(p, reduced);
            }
        }
        crowd
    }

    /// Where everybody is with those that stand off a quarter, half, and three quarters of a turn
    /// about whoever has their places.
    fn dragged_about(&self, p: &Predictor, reduced: &Reduced) -> Vec<Vec<Vec2>> {
        let off: Vec<(usize, usize)> = (0..p.robots.len())
            .filter(|&i| self.there[i] && yields(p, reduced, i))
            .filter_map(|i| Some((i, self.taken(p, i, self.wanted(reduced, i))?)))
            .collect();
        let stand: Vec<usize> = off.iter().map(|&(i, _)| i).collect();
        let behind = reduced.downstream(&stand);
        let free: Vec<usize> = (0..p.robots.len())
            .filter(|i| behind[*i] && self.there[*i] && !stand.contains(i))
            .collect();
        let turned = |quarters: f64| {
            let mut places = self.places.clone();
            for &(i, by) in &off {
                let apart = rotate(quarters * FRAC_PI_2, self.places[i] - self.places[by]);
                places[i] = self.places[by] + apart;
            }
            settle(&reduced.heard, &free, &mut places).map(|()| places)
        };
        [1.0, 2.0, 3.0].into_iter().filter_map(turned).collect()
    }

    /// Robots nearer to somebody than they come to rest, and nearer than planned.
    fn nearer_than_planned(&self, p: &Predictor, reduced: &Reduced) -> Vec<usize> {
        let n = p.robots.len();
        let mut stirred = Vec::new();
        for i in (0..n).filter(|&i| self.there[i]) {
            for j in (i + 1..n).filter(|&j| self.there[j]) {
                let keep_m = p.robots[i].stands_off_m.max(p.robots[j].stands_off_m);
                let near_m = p.scale[1] * (self.places[i] - self.places[j]).norm();
                let planned_m = p.scale[1] * (p.planned[i] - p.planned[j]).norm();
                if near_m < keep_m && near_m < planned_m - RESTS_M {
                    stirred.extend([i, j].into_iter().filter(|&i| yields(p, reduced, i)));
                }
            }
        }
        stirred
    }

    /// Everybody whom that stirs goes where it wants to be, from where it was.
    fn stand_aside(&mut self, p: &Predictor, reduced: &Reduced, stirred: &[usize]) {
        let n = p.robots.len();
        let stirred = reduced.downstream(stirred);
        let moves = |&i: &usize| self.there[i] && stirred[i] && yields(p, reduced, i);
        let movers: Vec<usize> = (0..n).filter(moves).collect();
        movers.iter().for_each(|&i| self.places[i] = p.planned[i]);
        for _ in 0..STEPS {
            let before = self.places.clone();
            let step = |&i: &usize| self.step(p, reduced, i);
            let steps: Vec<Vec2> = movers.iter().map(step).collect();
            for (&i, step) in movers.iter().zip(&steps) {
                self.places[i] = before[i] + step;
            }
            if steps.iter().all(|step| step.norm() < RESTS_M) {
                break;
            }
        }
    }

    /// A robot's next step.
    fn step(&self, p: &Predictor, reduced: &Reduced, i: usize) -> Vec2 {
        let here = self.places[i];
        let d_f = p.robots[i].stands_off_m / p.scale[1];
        let wanted = self.wanted(reduced, i);
        let taken = self.taken(p, i, wanted);
        let gap = taken.map(|j| wanted - self.places[j]);
        let d_s = gap.map_or(d_f, |gap| d_f + p.robots[i].aside * (d_f - gap.norm()));
        let aim = taken.zip(gap).map_or(wanted, |(j, gap)| {
            let other = self.places[j];
            let beside = gap + (d_f - gap.norm()) * direction(here - other);
            other + d_s * direction(beside)
        });
        let mut step = STEP * (aim - here);
        for j in (0..p.robots.len()).filter(|&j| j != i && self.there[j]) {
            let apart = here - self.places[j];
            let n = direction(apart);
            let keep = if taken == Some(j) { d_f } else { d_s };
            let lacking = BACK * (keep - apart.norm()) - n.dot(&step);
            // Around it, unless there is nothing for the robot there.
            let around = if taken.is_some() { Vec2::zeros() } else { Vec2::new(-n.y, n.x) };
            step += lacking.max(0.0) * (n + around);
        }
        let length = step.norm();
        step * (STRIDE * d_f / length.max(STRIDE * d_f))
    }

    /// Where a robot wants to be: the mean of what those ask for whom it goes by.
    fn wanted(&self, reduced: &Reduced, i: usize) -> Vec2 {
        let heard = &reduced.heard[i];
        let asked: Vec2 = heard.iter().map(|&(from, c)| self.places[from] + c).sum();
        if heard.is_empty() { self.places[i] } else { asked / heard.len() as f64 }
    }

    /// Who has the place that a robot wants, if it is one that stands off then.
    fn taken(&self, p: &Predictor, i: usize, wanted: Vec2) -> Option<usize> {
        let others = (0..p.robots.len()).filter(|&j| j != i && self.there[j]);
        let gap = |j: usize| p.scale[1] * (wanted - self.places[j]).norm();
        let nearest = others.min_by(|&a, &b| gap(a).total_cmp(&gap(b)));
        nearest.filter(|&j| p.robots[i].gives_way && gap(j) < p.robots[i].stands_off_m - TAKEN_M)
    }

    /// Whoever is nearest to a robot.
    fn nearest(&self, i: usize) -> Option<usize> {
        let gap = |j: usize| (self.places[i] - self.places[j]).norm();
        let others = (0..self.there.len()).filter(|&j| j != i && self.there[j]);
        others.min_by(|&a, &b| gap(a).total_cmp(&gap(b)))
    }

    /// For each living robot that ends off its place, why and by how much, m.
    pub(super) fn causes(&self, p: &Predictor, reduced: &Reduced) -> Vec<Option<(Cause, f64)>> {
        let n = p.robots.len();
        let lives = |i: &usize| reduced.alive[*i] && self.there[*i];
        let mut off: Vec<Vec2> =
            (0..n).map(|i| p.scale[0] * (self.places[i] - p.planned[i])).collect();
        if p.leader.is_none() {
            // The formation is where most of those are that keep a place.
            let keeps = |i: &usize| p.robots[*i].reference == Reference::Offsets;
            let kept: Vec<Vec2> = (0..n).filter(lives).filter(keeps).map(|i| off[i]).collect();
            let middle = median(&kept);
            off.iter_mut().for_each(|off| *off -= middle);
        }
        let off_m = |i: usize| off[i].norm();
        let farthest_m = |i: usize| {
            let others = self.or_there.iter().map(|places| (places[i] - p.planned[i]).norm());
            others.map(|off_m| p.scale[0] * off_m).fold(off_m(i), f64::max)
        };
        let cause = |i: usize| {
            let wanted = self.wanted(reduced, i);
            let pushed = p.scale[0] * (wanted - self.places[i]).norm() > TAKEN_M;
            let elsewhere = |j: usize| farthest_m(j) > TAKEN_M;
            // Without those that it has lost, would it have to go if nobody else did?
            let same: Vec2 = reduced.heard[i].iter().map(|&(j, c)| p.place_of(j) + c).sum();
            let same = same / reduced.heard[i].len().max(1) as f64;
            let lost = reduced.lost[i].filter(|_| (same - p.planned[i]).norm() > 1e-9);
            let whom = reduced.heard[i].iter().map(|&(j, _)| j).find(|&j| j < n && elsewhere(j));
            match (self.taken(p, i, wanted), self.nearest(i), lost, whom) {
                (Some(by), ..) if self.stirred => Cause::Taken { by },
                (_, Some(by), ..) if self.stirred && pushed => Cause::Crowded { by },
                (_, _, Some(lost), _) => match reduced.takes[i] {
                    Some(of) => Cause::TakesPlace { of },
                    None => Cause::Without { lost },
                },
                (.., Some(whom)) => Cause::Follows { whom },
                _ => Cause::Uncontained,
            }
        };
        let about_m = |i: usize| if off_m(i) > p.bound_m { off_m(i) } else { farthest_m(i) };
        let broken =
            |i: usize| (lives(&i) && farthest_m(i) > p.bound_m).then(|| (cause(i), about_m(i)));
        (0..n).map(broken).collect()
    }

    /// How far a contained robot is outside the hull of the living that lead or keep a place, m.
    pub(super) fn outside_m(&self, p: &Predictor, reduced: &Reduced, i: usize) -> Option<f64> {
        let contained =
            |i: usize| p.robots[i].reference == Reference::Middle && reduced.takes[i].is_none();
        let corners: Vec<Vec2> = (0..p.robots.len())
            .filter(|&j| reduced.alive[j] && self.there[j] && !contained(j))
            .map(|j| self.places[j])
            .collect();
        let outside_m = p.scale[0] * hull_distance(self.places[i], &corners);
        (contained(i) && outside_m > TAKEN_M && outside_m.is_finite()).then_some(outside_m)
    }
}

/// Whether a robot goes anywhere for others: not the main leader, the dead, and who hears nobody.
fn yields(p: &Predictor, reduced: &Reduced, i: usize) -> bool {
    reduced.alive[i] && !reduced.heard[i].is_empty() && !p.robots[i].reference.is_local()
}

/// A vector's direction; of none, along x.
fn direction(vector: Vec2) -> Vec2 {
    let length = vector.norm();
    if length > 1e-12 { vector / length } else { Vec2::new(1.0, 0.0) }
}

/// Of each coordinate on its own, so that one that strays moves it little.
fn median(points: &[Vec2]) -> Vec2 {
    let middle = |coordinate: usize| {
        let mut sorted: Vec<f64> = points.iter().map(|point| point[coordinate]).collect();
        sorted.sort_by(f64::total_cmp);
        match sorted.len() {
            0 => 0.0,
            n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
        }
    };
    Vec2::new(middle(0), middle(1))
}
