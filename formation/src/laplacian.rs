//! Matrices of the formation graph, on which the chapter's proofs and its iteration are based. (4)-(6) (31)
//!
//! W = Lambda A_d, the mean over the in-neighbors, is a non-negative matrix. By Perron-Frobenius its spectral
//! radius rho is an eigenvalue, the largest in modulus and in real part. Hence the eigenvalue of A = I - W with
//! the smallest real part is 1 - rho, and rho(A^-1) = 1 / (1 - rho).

use nalgebra::DVector;

use crate::Vec2;
use crate::graph::FormationGraph;
use crate::portable_math;

/// A square matrix whose row and column i belong to the robot with index i.
pub type Matrix = nalgebra::DMatrix<f64>;

/// Number of squarings in [`spectral_radius`]. An exponent of 2^50 leaves only rounding errors.
const SQUARINGS: i32 = 50;

/// Returns the graph Laplacian L = Delta - A_d. (4) (5) (6)
pub fn laplacian(graph: &FormationGraph) -> Matrix {
    let mut l = Matrix::zeros(graph.robots(), graph.robots());
    for edge in graph.edges() {
        l[(edge.to, edge.to)] += 1.0; // (5)
        l[(edge.to, edge.from)] -= 1.0; // (6)
    }
    l
}

/// Returns A = Lambda L + Gamma (31): the unit row for the leader, I minus the mean over the in-neighbors for
/// every other robot with in-neighbors, and a row of zeros for a robot without.
pub fn formation_matrix(graph: &FormationGraph, leader: Option<usize>) -> Matrix {
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

/// Returns the iteration matrix of the velocities from one tick to the next: the mean over the in-neighbors for
/// each robot whose control law uses its desired velocity (`feed_forward`), and a row of zeros for the others.
pub fn iteration(graph: &FormationGraph, feed_forward: &[bool]) -> Matrix {
    let mut w = Matrix::zeros(graph.robots(), graph.robots());
    for (i, _) in feed_forward.iter().enumerate().filter(|(_, uses)| **uses) {
        let g = graph.incoming_edges(i).count() as f64;
        graph.incoming_edges(i).for_each(|edge| w[(i, edge.from)] += 1.0 / g);
    }
    w
}

/// Returns the robots, ascending, in which velocities feed back forever: none of their ancestors in the graph
/// depends on anything but the velocities of others. The spectral radius of [`iteration`] is 1 if there are
/// such robots, and less than 1 otherwise.
pub fn velocity_feedback_robots(graph: &FormationGraph, feed_forward: &[bool]) -> Vec<usize> {
    let mut damped: Vec<bool> = (0..graph.robots())
        .map(|i| !feed_forward[i] || graph.incoming_edges(i).count() == 0)
        .collect();
    let mut open: Vec<usize> = (0..graph.robots()).filter(|&i| damped[i]).collect();
    while let Some(robot) = open.pop() {
        for edge in graph.outgoing_edges(robot) {
            if !std::mem::replace(&mut damped[edge.to], true) {
                open.push(edge.to);
            }
        }
    }
    (0..graph.robots()).filter(|&i| !damped[i]).collect()
}

/// Returns the spectral radius rho of a non-negative square matrix (Definition 7) by Gelfand's formula, the
/// limit of |M^m|^(1/m). Squaring a non-negative matrix causes no cancellation, so rounding errors stay small.
/// Unlike the QR algorithm it is not slowed by cycles or repeated eigenvalues.
pub fn spectral_radius(matrix: &Matrix) -> f64 {
    let (mut power, mut log_radius) = (matrix.clone(), 0.0);
    for squared in 0..=SQUARINGS {
        let norm = power.row_iter().map(|row| row.sum()).fold(0.0, f64::max);
        if norm == 0.0 {
            return 0.0;
        }
        power /= norm;
        log_radius += portable_math::ln(norm) / portable_math::exp2(f64::from(squared));
        power = &power * &power;
    }
    portable_math::exp(log_radius)
}

/// Returns the spectral norm |M|_2 of a non-negative matrix: sqrt(rho(M^T M)).
pub fn norm_2(matrix: &Matrix) -> f64 {
    spectral_radius(&(matrix.transpose() * matrix)).sqrt()
}

/// Returns the positions at which the robots settle relative to `pinned`, m, at heading 0 and scale 1: the
/// alpha that solves A alpha = C with the row of `pinned` replaced by the unit row. (29) (30) (33)
///
/// Returns `None` unless every robot is reachable from `pinned`.
pub fn settled_positions(graph: &FormationGraph, pinned: usize) -> Option<Vec<Vec2>> {
    if !graph.reachability()[pinned].iter().all(|&reached| reached) {
        return None;
    }
    let heard: Vec<Vec<(usize, Vec2)>> = (0..graph.robots())
        .map(|i| graph.incoming_edges(i).map(|edge| (edge.from, edge.offset_m)).collect())
        .collect();
    let mut places = vec![Vec2::zeros(); graph.robots()];
    let others: Vec<usize> = (0..graph.robots()).filter(|&i| i != pinned).collect();
    move_to_settled_positions(&heard, &others, &mut places)?;
    Some(places)
}

/// Moves the robots `free` to the positions at which they settle, m, while all other robots keep their
/// `places`: each free robot is at the mean over its in-neighbors of position plus offset. (24) (46)
///
/// Every free robot must be reachable from a robot that is not free. Returns `None` and changes no position if
/// the linear system is numerically singular.
pub fn move_to_settled_positions(
    heard: &[Vec<(usize, Vec2)>],
    free: &[usize],
    places: &mut [Vec2],
) -> Option<()> {
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
        // Arbitrary offsets, different for each edge.
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
        /// Generates graphs of up to 8 robots, in which the first has no incoming edge if `leads`.
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

    /// Returns the largest modulus of the eigenvalues, by the QR algorithm.
    fn by_qr(matrix: &Matrix) -> f64 {
        let schur = nalgebra::Schur::try_new(matrix.clone(), 1e-14, 10_000).unwrap();
        schur.complex_eigenvalues().iter().map(|z| z.re.hypot(z.im)).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn laplacian_and_system_match_their_definitions(
            graph in graphs(true), leads in any::<bool>(),
        ) {
            let n = graph.robots();
            let leader = leads.then_some(0);
            let (l, a) = (laplacian(&graph), formation_matrix(&graph, leader));
            for i in 0..n {
                let heard: Vec<usize> = graph.incoming_edges(i).map(|e| e.from).collect();
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
        fn system_is_an_m_matrix_iff_the_leader_reaches_all(
            graph in graphs(true),
        ) {
            let n = graph.robots();
            let reached = Reachability::new(&graph, Some(0), &[], &[]).defects_without_faults().unled.is_empty();
            let a = formation_matrix(&graph, Some(0));
            let radius = spectral_radius(&iteration(&graph, &vec![true; n]));
            let hearing = (1..n).all(|i| graph.incoming_edges(i).count() > 0);
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
        fn spectral_radius_and_norm_agree_with_qr_and_svd(
            n in 1..7usize, elements in proptest::collection::vec(0.0..1.0f64, 36),
        ) {
            let matrix = Matrix::from_fn(n, n, |i, j| elements[6 * i + j]);
            let radius = by_qr(&matrix);
            prop_assert!((spectral_radius(&matrix) / radius - 1.0).abs() < 1e-9);
            let singular = matrix.singular_values().max();
            prop_assert!((norm_2(&matrix) / singular - 1.0).abs() < 1e-9);
        }

        #[test]
        fn velocities_echo_iff_the_spectral_radius_is_1(
            graph in graphs(false), feed_forward in proptest::collection::vec(any::<bool>(), 9),
        ) {
            let feed_forward = &feed_forward[..graph.robots()];
            let radius = spectral_radius(&iteration(&graph, feed_forward));
            prop_assert!(radius < 1.0 + 1e-12);
            prop_assert_eq!(velocity_feedback_robots(&graph, feed_forward).is_empty(), radius < 1.0 - 1e-9);
        }

        /// Robots that are not free may be at any position.
        #[test]
        fn settle_moves_only_free_robots_to_their_neighbor_mean(
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
                .map(|i| graph.incoming_edges(i).map(|edge| (edge.from, edge.offset_m)).collect())
                .collect();
            let start: Vec<Vec2> = at[..n].iter().map(|&(x, y)| Vec2::new(x, y)).collect();
            let mut places = start.clone();
            prop_assert_eq!(move_to_settled_positions(&heard, &free, &mut places), Some(()));
            for (i, start) in start.iter().enumerate() {
                if stays(i) {
                    prop_assert_eq!(&places[i], start);
                    continue;
                }
                let asked: Vec2 = graph.incoming_edges(i).map(|e| places[e.from] + e.offset_m).sum();
                let asked = asked / graph.incoming_edges(i).count() as f64; // (24)
                prop_assert!((places[i] - asked).norm() < 1e-9, "robot {i}");
            }
        }

        #[test]
        fn settled_robots_are_at_their_neighbor_mean(
            graph in graphs(true),
        ) {
            let reached = Reachability::new(&graph, Some(0), &[], &[]).defects_without_faults().unled.is_empty();
            let places = settled_positions(&graph, 0);
            prop_assert_eq!(places.is_some(), reached);
            let Some(places) = places else { return Ok(()) };
            prop_assert_eq!(places[0], Vec2::zeros());
            for i in 1..graph.robots() {
                let asked: Vec2 = graph.incoming_edges(i).map(|e| places[e.from] + e.offset_m).sum();
                let asked = asked / graph.incoming_edges(i).count() as f64; // (24)
                prop_assert!((places[i] - asked).norm() < 1e-9, "robot {i}");
            }
        }
    }

    #[test]
    fn directed_ring_echoes_only_with_feed_forward() {
        for robots in [2, 3, 7, 64] {
            let ring = ring(robots);
            let all = vec![true; robots];
            assert!((spectral_radius(&iteration(&ring, &all)) - 1.0).abs() < 1e-12);
            assert_eq!(velocity_feedback_robots(&ring, &all).len(), robots);
            let none = vec![false; robots];
            assert_eq!(spectral_radius(&iteration(&ring, &none)), 0.0);
            assert!(velocity_feedback_robots(&ring, &none).is_empty());
        }
    }
}
