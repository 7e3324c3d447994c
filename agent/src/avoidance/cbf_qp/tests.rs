//! What the paper promises; and the same projections by another solver.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
};
use formation::random::SplitMix64;

use super::super::guard::tests::brief;
use super::super::ideal::{Crowd, scattered};
use super::*;

const D: f64 = 0.2;

fn cbf_qp(rate: f64) -> CbfQp {
    CbfQp { d: D, clearance: 0.1, v_max: 0.5, rate, sides: Vec::new() }
}

fn polar(angle: f64, length: f64) -> Vec2 {
    length * Vec2::new(angle.cos(), angle.sin())
}

/// What another solver says of a program.
enum Said {
    Solved(Vec2),
    HasNoSolution,
    Undecided,
}

/// min |u - gamma|^2 with 2 z . u >= -a h / 2 for all z, |u| <= v_max, as Clarabel solves it.
fn by_clarabel(gamma: Vec2, v_max: f64, rate: f64, away: &[Vec2]) -> Said {
    // s = b - A u: in the positive orthant, then in the second-order cone (v_max, u).
    let rows = away.len() + 3;
    let mut columns = [Vec::new(), Vec::new()];
    let mut b = Vec::new();
    for (row, z) in away.iter().enumerate() {
        for (column, part) in columns.iter_mut().zip([z.x, z.y]) {
            column.push((row, -2.0 * part));
        }
        b.push(0.5 * rate * (z.norm_squared() - D * D));
    }
    b.extend([v_max, 0.0, 0.0]);
    for (axis, column) in columns.iter_mut().enumerate() {
        column.push((away.len() + 1 + axis, -1.0));
    }
    let entries = columns.iter().flatten();
    let starts = vec![0, columns[0].len(), columns[0].len() + columns[1].len()];
    let a = CscMatrix::new(
        rows,
        2,
        starts,
        entries.clone().map(|(row, _)| *row).collect(),
        entries.map(|(_, value)| *value).collect(),
    );
    let p = CscMatrix::identity(2);
    let cones = [NonnegativeConeT(away.len()), SecondOrderConeT(3)];
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let q = [-gamma.x, -gamma.y];
    let mut solver = DefaultSolver::new(&p, &q, &a, &b, &cones, settings);
    solver.solve();
    let solution = &solver.solution;
    match solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => {
            Said::Solved(Vec2::new(solution.x[0], solution.x[1]))
        }
        SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
            Said::HasNoSolution
        }
        _ => Said::Undecided,
    }
}

#[test]
fn another_solver_finds_the_same_velocity_and_the_same_programs_without_one() {
    let mut random = SplitMix64::new(17);
    let (mut solved, mut unsolved, mut undecided) = (0, 0, 0);
    for scene in 0..3000 {
        let rate = 0.5 + 20.0 * random.unit();
        let too_near = random.chance(0.5);
        let least = if too_near { 0.5 * D } else { D };
        let away: Vec<Vec2> = (0..random.between(1, 7))
            .map(|_| polar(6.3 * random.unit(), least + 0.3 * random.unit()))
            .collect();
        let gamma = polar(6.3 * random.unit(), 0.6 * random.unit());
        let mut ours = cbf_qp(rate);
        let found = ours.velocity(&Sample { away: &away, ..Sample::default() }, gamma).unwrap();
        let missed = ours.sides.iter().map(|side| side.excess(found)).fold(0.0, f64::max);
        match by_clarabel(gamma, 0.5, rate, &away) {
            Said::Solved(theirs) => {
                solved += 1;
                assert!(missed < 1e-6, "scene {scene}: {found:?}, {theirs:?}");
                let off = (found - theirs).norm();
                assert!(off < 1e-4, "scene {scene}: {found:?}, {theirs:?}");
            }
            Said::HasNoSolution => {
                unsolved += 1;
                assert!(too_near && missed > 1e-6, "scene {scene}: {found:?}");
            }
            Said::Undecided => undecided += 1,
        }
    }
    let enough = solved > 1500 && unsolved > 300 && undecided < 30;
    assert!(enough, "{solved}, {unsolved}, {undecided}");
}

/// Forward invariance, sampled as slowly as it may be, whatever everybody wants.
#[test]
fn ideal_robots_never_come_nearer_than_d_whatever_they_want() {
    let period = 0.05;
    for seed in 0..30 {
        let mut random = SplitMix64::new(seed);
        let robots = random.between(2, 9) as usize;
        let at = scattered(&mut random, robots, 1.2, D);
        let goals = scattered(&mut random, robots, 1.2, 0.0);
        let methods = (0..robots).map(|_| cbf_qp(1.0 / period)).collect();
        let mut crowd = Crowd::new(methods, at, goals, 0.5, period);
        for k in 0..400 {
            let closest = match k % 40 {
                // Now and then all want something else.
                0..20 => {
                    let gammas: Vec<Vec2> =
                        (0..robots).map(|_| polar(6.3 * random.unit(), 0.5)).collect();
                    crowd.step_wanting(&gammas)
                }
                _ => crowd.step(),
            };
            assert!(closest > D - 1e-9, "seed {seed}: {closest} in period {k}");
        }
    }
}

/// Known of it: what is nearest to what is wanted may be to stand.
#[test]
fn robots_that_swap_places_exactly_deadlock() {
    let at = vec![Vec2::new(0.5, 0.0), Vec2::new(-0.5, 0.0)];
    let goals = at.iter().map(|at| -at).collect();
    let mut crowd = Crowd::new(vec![cbf_qp(5.0), cbf_qp(5.0)], at, goals, 0.5, 0.01);
    let closest = (0..3000).map(|_| crowd.step()).fold(f64::INFINITY, f64::min);
    assert!(closest > D - 1e-9 && closest < D + 1e-3, "{closest}");
    assert!(crowd.farthest() > 0.5, "{}", crowd.farthest());
}

#[test]
fn a_wall_leaves_all_of_the_rate_to_the_robot() {
    let walls = [Vec2::new(-0.2, 0.0)];
    let sample = Sample { walls: &walls, ..Sample::default() };
    let u = cbf_qp(1.0).velocity(&sample, Vec2::new(0.5, 0.1)).unwrap();
    // a (r^2 - clearance^2) / (2 r)
    assert!((u - Vec2::new(0.03 / 0.4, 0.1)).norm() < 1e-12, "{u:?}");
}

#[test]
fn too_near_to_many_it_leaves_them_as_fast_as_it_can() {
    // Between three that are too near to it, evenly: nowhere is better than here.
    let away = [0.3, 2.394_395_102_393_2, 4.488_790_204_786_4].map(|angle| polar(angle, 0.15));
    let sample = Sample { away: &away, ..Sample::default() };
    let u = cbf_qp(1.0).velocity(&sample, Vec2::new(0.5, 0.0)).unwrap();
    assert!(u.norm() < 1e-9, "{u:?}");
    // At the same place as another it leaves at v_max.
    let same = [Vec2::zeros()];
    let sample = Sample { away: &same, ..Sample::default() };
    let u = cbf_qp(1.0).velocity(&sample, Vec2::zeros()).unwrap();
    assert!((u.norm() - 0.5).abs() < 1e-12, "{u:?}");
}

#[test]
fn beyond_the_needed_radius_nobody_matters_and_a_period_too_long_is_advised_against() {
    let mut brief = brief();
    brief.avoidance.gains = [("barrier_per_s".to_owned(), 2.0)].into();
    let at = Conditions::of(&brief);
    let needed = sensing_radius_m(&at);
    let towards = |r: f64| {
        let away = [Vec2::new(-r, 0.0)];
        let sample = Sample { away: &away, ..Sample::default() };
        cbf_qp(2.0).velocity(&sample, Vec2::new(0.5, 0.0)).unwrap().x
    };
    assert_eq!(towards(1.000_001 * needed), 0.5);
    assert!(towards(0.99 * needed) < 0.5);
    assert!(sampled_too_slowly(&at).is_none());
    let slow = Conditions { period_s: 0.6, ..at };
    let advice = sampled_too_slowly(&slow).unwrap();
    assert!(advice.message.starts_with("barrier_per_s T = 1.2: "), "{}", advice.message);
}
