//! The formation graph as matrices: what the chapter's proofs, and its iteration, rest on. (4)-(6)
//! (31)
//!
//! W = Lambda A_d, the mean over those heard, is a matrix without negative elements. So its
//! spectral radius rho is itself an eigenvalue, the largest in modulus and in real part; that of
//! A = I - W with the smallest real part is 1 - rho, and rho(A^-1) = 1 / (1 - rho).

use nalgebra::DVector;

use crate::Vec2;
use crate::graph::FormationGraph;
use crate::real;

/// A square matrix; row and column i belong to the robot at place i.
pub type Matrix = nalgebra::DMatrix<f64>;

/// How often [`spectral_radius`] squares: 2^50 in the exponent leaves no more than rounding.
const SQUARINGS: i32 = 50;

/// L = Delta - A_d. (4) (5) (6)
pub fn laplacian(graph: &FormationGraph) -> Matrix {
    let mut l = Matrix::zeros(graph.robots(), graph.robots());
    for edge in graph.edges() {
        l[(edge.to, edge.to)] += 1.0; // (5)
        l[(edge.to, edge.from)] -= 1.0; // (6)
    }
    l
}

/// A = Lambda L + Gamma: of the leader the unit row, of whoever else hears somebody I minus the
/// mean over those heard, of others a row of zeros. (31)
pub fn system(graph: &FormationGraph, leader: Option<usize>) -> Matrix {
    let mut a = laplacian(graph);
    for i in 0..graph.robots() {
        if leader == Some(i) {
            a.row_mut(i).fill(0.0);
            a[(i, i)] = 1.0; // Gamma
        } else if a[(i, i)] > 0.0 {
            let g = a[(i, i)];
            a.row_mut(i).scale_mut(1.0 / g); // Lambda
        }
    }
    a
}

/// How velocities feed on velocities from one tick to the next: the mean over those heard, for
/// each robot whose law uses its desired velocity, and a row of zeros for the others.
pub fn iteration(graph: &FormationGraph, feed_forward: &[bool]) -> Matrix {
    let mut w = Matrix::zeros(graph.robots(), graph.robots());
    for (i, _) in feed_forward.iter().enumerate().filter(|(_, uses)| **uses) {
        let g = graph.heard_by(i).count() as f64;
        graph.heard_by(i).for_each(|edge| w[(i, edge.from)] += 1.0 / g);
    }
    w
}

/// Robots in which velocities echo for ever, in order: the information of no robot reaches them
/// that goes by anything but the velocities of others. The radius of [`iteration`] is 1 if there
/// are any, and less if there are none.
pub fn echoing(graph: &FormationGraph, feed_forward: &[bool]) -> Vec<usize> {
    let mut damped: Vec<bool> =
        (0..graph.robots()).map(|i| !feed_forward[i] || graph.heard_by(i).count() == 0).collect();
    let mut open: Vec<usize> = (0..graph.robots()).filter(|&i| damped[i]).collect();
    while let Some(robot) = open.pop() {
        for edge in graph.hearers_of(robot) {
            if !std::mem::replace(&mut damped[edge.to], true) {
                open.push(edge.to);
            }
        }
    }
    (0..graph.robots()).filter(|&i| !damped[i]).collect()
}

/// rho of a square matrix without negative elements (Definition 7), by Gelfand's formula: the
/// limit of |M^m|^(1/m). Squaring such a matrix cancels nothing, so that rounding stays small, and
/// neither cycles nor repeated eigenvalues slow it down, as they do the QR algorithm.
pub fn spectral_radius(matrix: &Matrix) -> f64 {
    let (mut power, mut log_radius) = (matrix.clone(), 0.0);
    for squared in 0..=SQUARINGS {
        let norm = power.row_iter().map(|row| row.sum()).fold(0.0, f64::max);
        if norm == 0.0 {
            return 0.0;
        }
        power /= norm;
        log_radius += real::ln(norm) / real::exp2(f64::from(squared));
        power = &power * &power;
    }
    real::exp(log_radius)
}

/// |M|_2 of a matrix without negative elements: sqrt(rho(M^T M)).
pub fn norm_2(matrix: &Matrix) -> f64 {
    spectral_radius(&(matrix.transpose() * matrix)).sqrt()
}

/// Where the robots settle, seen from `pinned`, m, at heading 0 and scale 1: the alpha that solves
/// A alpha = C with the row of `pinned` replaced by the unit row. (29) (30) (33)
///
/// `None` unless the information of `pinned` reaches everybody.
pub fn settled(graph: &FormationGraph, pinned: usize) -> Option<Vec<Vec2>> {
    if !graph.reachability()[pinned].iter().all(|&reached| reached) {
        return None;
    }
    let heard: Vec<Vec<(usize, Vec2)>> = (0..graph.robots())
        .map(|i| graph.heard_by(i).map(|edge| (edge.from, edge.offset_m)).collect())
        .collect();
    let mut places = vec![Vec2::zeros(); graph.robots()];
    let others: Vec<usize> = (0..graph.robots()).filter(|&i| i != pinned).collect();
    settle(&heard, &others, &mut places)?;
    Some(places)
}

/// Puts the robots `free` where they settle, m, while all the others stay at their `places`: each
/// at the mean of what those ask for that it hears (with their offsets). (24) (46)
///
/// A robot that stays must reach each of them. `None`, and nothing moves, where the system that
/// follows otherwise is singular to the last bit.
pub fn settle(heard: &[Vec<(usize, Vec2)>], free: &[usize], places: &mut [Vec2]) -> Option<()> {
    if free.is_empty() {
        return Some(());
    }
    let mut row = vec![None; places.len()];
    free.iter().enumerate().for_each(|(k, &i)| row[i] = Some(k));
    let mut system = Matrix::identity(free.len(), free.len());
    let (mut x, mut y) = (DVector::zeros(free.len()), DVector::zeros(free.len()));
    for (k, &i) in free.iter().enumerate() {
        let share = 1.0 / heard[i].len() as f64;
        for &(from, offset_m) in &heard[i] {
            let mut asked = offset_m;
            match row[from] {
                Some(column) => system[(k, column)] -= share,
                None => asked += places[from],
            }
            (x[k], y[k]) = (x[k] + share * asked.x, y[k] + share * asked.y);
        }
    }
    let lu = system.lu();
    let (x, y) = (lu.solve(&x)?, lu.solve(&y)?);
    if x.iter().chain(&y).any(|coordinate| !coordinate.is_finite()) {
        return None;
    }
    free.iter().zip(x.iter().zip(&y)).for_each(|(&i, (&x, &y))| places[i] = Vec2::new(x, y));
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Edge;
    use crate::reachability::Reachability;
    use proptest::prelude::*;

    fn edge(from: usize, to: usize) -> Edge {
        // Any offsets, each edge another one.
        let offset_m = Vec2::new(from as f64 - 0.3 * to as f64, 0.1 * from as f64 + to as f64);
        Edge { from, to, offset_m }
    }

    fn graph(robots: usize, edges: &[[usize; 2]]) -> FormationGraph {
        FormationGraph::new(robots, edges.iter().map(|&[from, to]| edge(from, to)).collect())
    }

    fn ring(robots: usize) -> FormationGraph {
        let edges: Vec<[usize; 2]> = (0..robots).map(|i| [i, (i + 1) % robots]).collect();
        graph(robots, &edges)
    }

    prop_compose! {
        /// Up to 8 robots; the first hears nobody if `leads`.
        fn graphs(leads: bool)(
            n in 1..9usize,
            pairs in proptest::collection::btree_set((0..9usize, 0..9usize), 0..30),
        ) -> FormationGraph {
            let ends = pairs.into_iter().map(|(from, to)| [from % n, to % n]);
            let kept = ends.filter(|[from, to]| from != to && !(leads && *to == 0));
            let kept: std::collections::BTreeSet<[usize; 2]> = kept.collect();
            graph(n, &kept.into_iter().collect::<Vec<_>>())
        }
    }

    /// The largest modulus of the eigenvalues, by the QR algorithm.
    fn by_qr(matrix: &Matrix) -> f64 {
        let schur = nalgebra::Schur::try_new(matrix.clone(), 1e-14, 10_000).unwrap();
        schur.complex_eigenvalues().iter().map(|z| z.re.hypot(z.im)).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn the_laplacian_and_the_system_are_element_by_element_as_defined(
            graph in graphs(true), leads in any::<bool>(),
        ) {
            let n = graph.robots();
            let leader = leads.then_some(0);
            let (l, a) = (laplacian(&graph), system(&graph, leader));
            for i in 0..n {
                let heard: Vec<usize> = graph.heard_by(i).map(|e| e.from).collect();
                let g = heard.len() as f64;
                for j in 0..n {
                    let unit = f64::from(u8::from(i == j));
                    let a_d = f64::from(u8::from(heard.contains(&j))); // (6)
                    prop_assert_eq!(l[(i, j)], g * unit - a_d); // (4) (5)
                    let lambda = if g > 0.0 && leader != Some(i) { 1.0 / g } else { 0.0 };
                    let gamma = if leader == Some(i) { unit } else { 0.0 };
                    prop_assert!((a[(i, j)] - (lambda * l[(i, j)] + gamma)).abs() < 1e-15); // (31)
                }
                prop_assert_eq!(l.row(i).sum(), 0.0);
            }
        }

        #[test]
        fn the_leader_reaches_all_if_and_only_if_the_system_is_an_m_matrix(
            graph in graphs(true),
        ) {
            let n = graph.robots();
            let reached = Reachability::new(&graph, Some(0), &[], &[]).intact().unled.is_empty();
            let a = system(&graph, Some(0));
            let radius = spectral_radius(&iteration(&graph, &vec![true; n]));
            let hearing = (1..n).all(|i| graph.heard_by(i).count() > 0);
            prop_assert_eq!(reached, hearing && radius < 1.0 - 1e-9);
            match a.try_inverse().filter(|_| reached) {
                Some(inverse) => {
                    prop_assert!(inverse.iter().all(|&element| element >= -1e-12));
                    let expected = 1.0 / (1.0 - radius);
                    let found = spectral_radius(&inverse);
                    prop_assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
                }
                None => prop_assert!(!reached),
            }
        }

        #[test]
        fn the_spectral_radius_is_that_of_the_qr_algorithm(
            n in 1..7usize, elements in proptest::collection::vec(0.0..1.0f64, 36),
        ) {
            let matrix = Matrix::from_fn(n, n, |i, j| elements[6 * i + j]);
            let radius = by_qr(&matrix);
            prop_assert!((spectral_radius(&matrix) / radius - 1.0).abs() < 1e-9);
            let singular = matrix.singular_values().max();
            prop_assert!((norm_2(&matrix) / singular - 1.0).abs() < 1e-9);
        }

        #[test]
        fn velocities_echo_exactly_where_the_iterations_radius_is_1(
            graph in graphs(false), feed_forward in proptest::collection::vec(any::<bool>(), 9),
        ) {
            let feed_forward = &feed_forward[..graph.robots()];
            let radius = spectral_radius(&iteration(&graph, feed_forward));
            prop_assert!(radius < 1.0 + 1e-12);
            prop_assert_eq!(echoing(&graph, feed_forward).is_empty(), radius < 1.0 - 1e-9);
        }

        /// Those that stay may stand anywhere.
        #[test]
        fn whoever_is_free_settles_where_those_it_hears_ask_for_and_nobody_else_moves(
            graph in graphs(true), stays in proptest::collection::vec(any::<bool>(), 9),
            at in proptest::collection::vec((-9.0..9.0f64, -9.0..9.0f64), 9),
        ) {
            let n = graph.robots();
            let reached = graph.reachability();
            let stays = |i: usize| i == 0 || stays[i];
            let led = |i: usize| (0..n).any(|from| stays(from) && reached[from][i]);
            let free: Vec<usize> = (0..n).filter(|&i| !stays(i)).collect();
            prop_assume!(free.iter().all(|&i| led(i)));
            let heard: Vec<Vec<(usize, Vec2)>> = (0..n)
                .map(|i| graph.heard_by(i).map(|edge| (edge.from, edge.offset_m)).collect())
                .collect();
            let start: Vec<Vec2> = at[..n].iter().map(|&(x, y)| Vec2::new(x, y)).collect();
            let mut places = start.clone();
            prop_assert_eq!(settle(&heard, &free, &mut places), Some(()));
            for (i, start) in start.iter().enumerate() {
                if stays(i) {
                    prop_assert_eq!(&places[i], start);
                    continue;
                }
                let asked: Vec2 = graph.heard_by(i).map(|e| places[e.from] + e.offset_m).sum();
                let asked = asked / graph.heard_by(i).count() as f64; // (24)
                prop_assert!((places[i] - asked).norm() < 1e-9, "robot {i}");
            }
        }

        #[test]
        fn settled_robots_stand_where_the_mean_over_those_they_hear_asks_for(
            graph in graphs(true),
        ) {
            let reached = Reachability::new(&graph, Some(0), &[], &[]).intact().unled.is_empty();
            let places = settled(&graph, 0);
            prop_assert_eq!(places.is_some(), reached);
            let Some(places) = places else { return Ok(()) };
            prop_assert_eq!(places[0], Vec2::zeros());
            for i in 1..graph.robots() {
                let asked: Vec2 = graph.heard_by(i).map(|e| places[e.from] + e.offset_m).sum();
                let asked = asked / graph.heard_by(i).count() as f64; // (24)
                prop_assert!((places[i] - asked).norm() < 1e-9, "robot {i}");
            }
        }
    }

    #[test]
    fn a_directed_ring_has_radius_1_and_so_echoes_unless_its_law_uses_no_velocities() {
        for robots in [2, 3, 7, 64] {
            let ring = ring(robots);
            let all = vec![true; robots];
            assert!((spectral_radius(&iteration(&ring, &all)) - 1.0).abs() < 1e-12);
            assert_eq!(echoing(&ring, &all).len(), robots);
            let none = vec![false; robots];
            assert_eq!(spectral_radius(&iteration(&ring, &none)), 0.0);
            assert!(echoing(&ring, &none).is_empty());
        }
    }
}
