//! Matrices of the formation graph, on which the chapter's proofs and its iteration are based. (4)-(6) (31)
//!
//! W = Lambda A_d, the mean over the in-neighbors, is a non-negative matrix. By Perron-Frobenius its spectral
//! radius rho is an eigenvalue, the largest in modulus and in real part. Hence the eigenvalue of A = I - W with
//! the smallest real part is 1 - rho, and rho(A^-1) = 1 / (1 - rho).

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DVector, Dyn, LU};

use crate::Vec2;
use crate::graph::FormationGraph;
use crate::portable_math;

/// A square matrix whose row and column i belong to the robot with index i.
pub type Matrix = nalgebra::DMatrix<f64>;

/// Number of squarings in [`spectral_radius`]. An exponent of 2^50 leaves only rounding errors.
const SQUARINGS: i32 = 50;
/// Maximum number of rows of a dense matrix that is squared or decomposed, which takes the cube of this number of operations.
const DENSE_MATRIX_ROWS_MAX: usize = 256;
/// Maximum number of linear systems that are solved for a spectral radius.
const LINEAR_SOLVES_MAX: usize = 30;
/// Maximum number of steps of a power iteration.
const POWER_ITERATION_STEPS_MAX: usize = 20_000;

/// Returns the graph Laplacian L = Delta - A_d. (4) (5) (6)
pub fn laplacian(graph: &FormationGraph) -> Matrix {
    let mut l = Matrix::zeros(graph.robot_count(), graph.robot_count());
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
    for i in 0..graph.robot_count() {
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
pub fn velocity_iteration_matrix(graph: &FormationGraph, feed_forward: &[bool]) -> Matrix {
    let mut w = Matrix::zeros(graph.robot_count(), graph.robot_count());
    for (i, _) in feed_forward.iter().enumerate().filter(|(_, uses)| **uses) {
        let g = graph.incoming_edges(i).count() as f64;
        graph.incoming_edges(i).for_each(|edge| w[(i, edge.from)] += 1.0 / g);
    }
    w
}

/// Returns the robots, ascending, in which velocities feed back forever: none of their ancestors in the graph
/// depends on anything but the velocities of others. The spectral radius of [`velocity_iteration_matrix`] is 1 if there
/// are such robots, and less than 1 otherwise.
pub fn velocity_feedback_robots(graph: &FormationGraph, feed_forward: &[bool]) -> Vec<usize> {
    let mut has_in_neighbor = vec![false; graph.robot_count()];
    graph.edges().iter().for_each(|edge| has_in_neighbor[edge.to] = true);
    let is_source = |&i: &usize| !feed_forward[i] || !has_in_neighbor[i];
    let sources: Vec<usize> = (0..graph.robot_count()).filter(is_source).collect();
    let is_damped = graph.robots_reached_from(&sources);
    (0..graph.robot_count()).filter(|&i| !is_damped[i]).collect()
}

/// Returns the spectral radius rho of a non-negative square matrix (Definition 7) by Gelfand's formula, the
/// limit of |M^m|^(1/m). Squaring a non-negative matrix causes no cancellation, so rounding errors stay small.
/// Unlike the QR algorithm it is not slowed by cycles or repeated eigenvalues.
///
/// Above `DENSE_MATRIX_ROWS_MAX` rows it is the largest radius of a part whose rows depend on each other, because all
/// other elements change no eigenvalue; see `spectral_radius_by_components`.
pub fn spectral_radius(matrix: &Matrix) -> f64 {
    if matrix.nrows() <= DENSE_MATRIX_ROWS_MAX {
        spectral_radius_by_squaring(matrix)
    } else {
        spectral_radius_by_components(matrix)
    }
}

/// Returns the spectral radius of a large non-negative matrix: 0 without cycles.
fn spectral_radius_by_components(matrix: &Matrix) -> f64 {
    let n = matrix.nrows();
    let positive = |i: usize| (0..n).filter(move |&j| matrix[(i, j)] > 0.0);
    let rows: Vec<Vec<usize>> = (0..n).map(|i| positive(i).collect()).collect();
    let radius = |part: &Vec<usize>| match part[..] {
        [i] => matrix[(i, i)],
        _ => {
            let part = matrix.select_rows(part).select_columns(part);
            if part.nrows() <= DENSE_MATRIX_ROWS_MAX {
                spectral_radius_by_squaring(&part)
            } else {
                spectral_radius_by_noda(&part)
            }
        }
    };
    strong_components(&rows).iter().map(radius).fold(0.0, f64::max)
}

/// Returns the spectral radius of a non-negative irreducible matrix by Noda's inverse iteration: the shift is the upper
/// bound of Collatz and Wielandt, which decreases to the radius, quadratically in the end.
fn spectral_radius_by_noda(matrix: &Matrix) -> f64 {
    let n = matrix.nrows();
    let mut vector = DVector::from_element(n, 1.0);
    let mut upper = f64::INFINITY;
    for _ in 0..LINEAR_SOLVES_MAX {
        let ratios = (matrix * &vector).component_div(&vector);
        upper = upper.min(ratios.max());
        if upper - ratios.min() <= 1e-12 * upper {
            break;
        }
        let shifted = Matrix::from_diagonal_element(n, n, upper) - matrix;
        // The shift is the radius itself, up to rounding errors, if the system is singular.
        let Some(next) = shifted.lu().solve(&vector) else { break };
        let largest = next.max();
        if !(largest.is_finite() && next.min() > 0.0) {
            break;
        }
        vector = next / largest;
    }
    upper
}

/// Returns the strong components of the graph in which node i leads to the nodes `next[i]` (Kosaraju).
fn strong_components(next: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut predecessors = vec![Vec::new(); next.len()];
    for (i, next) in next.iter().enumerate() {
        next.iter().for_each(|&j| predecessors[j].push(i));
    }
    let mut seen = vec![false; next.len()];
    let mut finished = Vec::new();
    for first in 0..next.len() {
        let mut open = vec![(first, 0)];
        while let Some((node, tried)) = open.pop() {
            if tried == 0 && std::mem::replace(&mut seen[node], true) {
                continue;
            }
            match next[node].get(tried) {
                Some(&other) => open.extend([(node, tried + 1), (other, 0)]),
                None => finished.push(node),
            }
        }
    }
    let mut components = Vec::new();
    for first in finished.into_iter().rev() {
        let (mut component, mut open) = (Vec::new(), vec![first]);
        while let Some(node) = open.pop() {
            if std::mem::replace(&mut seen[node], false) {
                component.push(node);
                open.extend(&predecessors[node]);
            }
        }
        if !component.is_empty() {
            components.push(component);
        }
    }
    components
}

fn spectral_radius_by_squaring(matrix: &Matrix) -> f64 {
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
///
/// Above `DENSE_MATRIX_ROWS_MAX` rows it is computed by power iteration from the vector of ones, which is never
/// orthogonal to the singular vector of a non-negative matrix.
pub fn spectral_norm(matrix: &Matrix) -> f64 {
    if matrix.nrows() <= DENSE_MATRIX_ROWS_MAX {
        return spectral_radius(&(matrix.transpose() * matrix)).sqrt();
    }
    let transposed = matrix.transpose();
    // The columns of the factors are contiguous in memory.
    let image = |vector: &DVector<f64>| Some(transposed.tr_mul(vector));
    norm_by_powers(matrix.ncols(), image, |vector| Some(matrix.tr_mul(vector)))
        .expect("every product exists")
}

/// Returns |A^-1|_2 of an M-matrix A, whose inverse is non-negative, or `None` if A is singular.
///
/// Above `DENSE_MATRIX_ROWS_MAX` rows no inverse is computed: the systems of the power iteration of [`spectral_norm`]
/// are solved in groups of rows that depend on each other.
pub fn inverse_norm_2(matrix: &Matrix) -> Option<f64> {
    if matrix.nrows() <= DENSE_MATRIX_ROWS_MAX {
        return Some(spectral_norm(&matrix.clone().try_inverse()?));
    }
    let (system, transposed) =
        (GroupedSystem::new(matrix), GroupedSystem::new(&matrix.transpose()));
    let image = |vector: &DVector<f64>| system.solve(vector);
    norm_by_powers(matrix.nrows(), image, |vector| transposed.solve(vector))
}

/// Returns |M|_2 of a non-negative matrix M by power iteration from the vector of ones. `image` returns the product of
/// M and a vector, and `image_of_transpose` that of its transpose; without one the result is `None`.
fn norm_by_powers(
    columns: usize,
    image: impl Fn(&DVector<f64>) -> Option<DVector<f64>>,
    image_of_transpose: impl Fn(&DVector<f64>) -> Option<DVector<f64>>,
) -> Option<f64> {
    let (mut vector, mut norm) = (DVector::<f64>::from_element(columns, 1.0), 0.0f64);
    for _ in 0..POWER_ITERATION_STEPS_MAX {
        vector /= vector.norm().max(f64::MIN_POSITIVE);
        let image = image(&vector)?;
        let previous = std::mem::replace(&mut norm, image.norm());
        if norm - previous <= 1e-13 * norm {
            break;
        }
        vector = image_of_transpose(&image)?;
    }
    Some(norm)
}

/// A sparse linear system, in groups of rows that depend on each other.
struct GroupedSystem {
    /// Columns and values of the elements of each row.
    rows: Vec<Vec<(usize, f64)>>,
    /// Groups, each after those on which it depends, with the factors of its own part of the matrix.
    groups: Vec<(Vec<usize>, LU<f64, Dyn, Dyn>)>,
    /// Group of each row.
    group_of_row: Vec<usize>,
}

impl GroupedSystem {
    fn new(matrix: &Matrix) -> GroupedSystem {
        let n = matrix.nrows();
        let row =
            |i: usize| (0..n).map(move |j| (j, matrix[(i, j)])).filter(|(_, value)| *value != 0.0);
        let rows: Vec<Vec<(usize, f64)>> = (0..n).map(|i| row(i).collect()).collect();
        let next: Vec<Vec<usize>> =
            rows.iter().map(|row| row.iter().map(|&(j, _)| j).collect()).collect();
        let mut group_of_row = vec![0; n];
        let groups = strong_components(&next).into_iter().rev().enumerate();
        let groups = groups.map(|(group, group_rows)| {
            group_rows.iter().for_each(|&i| group_of_row[i] = group);
            let part = Matrix::from_fn(group_rows.len(), group_rows.len(), |a, b| {
                matrix[(group_rows[a], group_rows[b])]
            });
            (group_rows, part.lu())
        });
        let groups = groups.collect();
        GroupedSystem { rows, groups, group_of_row }
    }

    /// Returns the solution for this right-hand side, or `None` if the system is singular.
    fn solve(&self, right: &DVector<f64>) -> Option<DVector<f64>> {
        let mut solution = right.clone();
        for (group, (group_rows, factors)) in self.groups.iter().enumerate() {
            let known_sum = |i: usize| {
                let others = self.rows[i].iter().filter(|(j, _)| self.group_of_row[*j] != group);
                others.map(|&(j, value)| value * solution[j]).sum::<f64>()
            };
            let right = group_rows.iter().map(|&i| right[i] - known_sum(i));
            let right = DVector::from_iterator(group_rows.len(), right);
            let part = factors.solve(&right)?;
            group_rows.iter().zip(&part).for_each(|(&i, &value)| solution[i] = value);
        }
        Some(solution)
    }
}

/// Returns the positions at which the robots settle relative to `fixed`, m, at heading 0 and scale 1: the
/// alpha that solves A alpha = C with the row of `fixed` replaced by the unit row. (29) (30) (33)
///
/// Returns `None` unless every robot is reachable from `fixed`.
pub fn settled_positions(graph: &FormationGraph, fixed: usize) -> Option<Vec<Vec2>> {
    if graph.hop_counts_from(fixed).contains(&None) {
        return None;
    }
    let in_neighbors: Vec<Vec<(usize, Vec2)>> = (0..graph.robot_count())
        .map(|i| graph.incoming_edges(i).map(|edge| (edge.from, edge.offset_m)).collect())
        .collect();
    let mut positions = vec![Vec2::zeros(); graph.robot_count()];
    let others: Vec<usize> = (0..graph.robot_count()).filter(|&i| i != fixed).collect();
    move_to_settled_positions(&in_neighbors, &others, &mut positions)?;
    Some(positions)
}

/// Moves the robots `free` to the positions at which they settle, m, while all other robots keep their
/// `positions`: each free robot is at the mean over its in-neighbors of position plus offset. (24) (46)
///
/// Every free robot must be reachable from a robot that is not free. Returns `None` and changes no position if
/// the linear system is numerically singular.
///
/// More than `DENSE_MATRIX_ROWS_MAX` free robots are moved in groups that depend on each other, each after the groups
/// on which it depends.
pub fn move_to_settled_positions(
    in_neighbors: &[Vec<(usize, Vec2)>],
    free: &[usize],
    positions: &mut [Vec2],
) -> Option<()> {
    let mut row = vec![None; positions.len()];
    free.iter().enumerate().for_each(|(k, &i)| row[i] = Some(k));
    if free.len() <= DENSE_MATRIX_ROWS_MAX {
        return solve_equilibrium_system(in_neighbors, free, &row, positions);
    }
    let next = |&i: &usize| in_neighbors[i].iter().filter_map(|&(from, _)| row[from]).collect();
    let groups = strong_components(&free.iter().map(next).collect::<Vec<_>>());
    let mut moved = positions.to_vec();
    let mut row = vec![None; positions.len()];
    // A group comes before those on which it depends.
    for group in groups.into_iter().rev() {
        let group: Vec<usize> = group.into_iter().map(|k| free[k]).collect();
        group.iter().enumerate().for_each(|(k, &i)| row[i] = Some(k));
        solve_equilibrium_system(in_neighbors, &group, &row, &mut moved)?;
        group.iter().for_each(|&i| row[i] = None);
    }
    positions.copy_from_slice(&moved);
    Some(())
}

/// Does the work of [`move_to_settled_positions`] by solving one linear system. `row` has the index of each free robot
/// in `free`.
fn solve_equilibrium_system(
    in_neighbors: &[Vec<(usize, Vec2)>],
    free: &[usize],
    row: &[Option<usize>],
    positions: &mut [Vec2],
) -> Option<()> {
    if free.is_empty() {
        return Some(());
    }
    if free.len() > DENSE_MATRIX_ROWS_MAX {
        return eliminate_equilibrium_system(in_neighbors, free, row, positions);
    }
    let mut system = Matrix::identity(free.len(), free.len());
    let (mut x, mut y) = (DVector::zeros(free.len()), DVector::zeros(free.len()));
    for (k, &i) in free.iter().enumerate() {
        let subtract = |column, weight| system[(k, column)] -= weight;
        let constant = equilibrium_equation(&in_neighbors[i], row, positions, subtract);
        (x[k], y[k]) = (constant.x, constant.y);
    }
    let lu = system.lu();
    let (x, y) = (lu.solve(&x)?, lu.solve(&y)?);
    if x.iter().chain(&y).any(|coordinate| !coordinate.is_finite()) {
        return None;
    }
    free.iter().zip(x.iter().zip(&y)).for_each(|(&i, (&x, &y))| positions[i] = Vec2::new(x, y));
    Some(())
}

/// Calls `add` with the column and the weight of each free in-neighbor of a robot, and returns the constant part of the
/// mean over its in-neighbors: offsets, and positions of robots that are not free.
fn equilibrium_equation(
    in_neighbors: &[(usize, Vec2)],
    row: &[Option<usize>],
    positions: &[Vec2],
    mut add: impl FnMut(usize, f64),
) -> Vec2 {
    let weight = 1.0 / in_neighbors.len() as f64;
    let mut constant = Vec2::zeros();
    for &(from, offset_m) in in_neighbors {
        let mut desired = offset_m;
        match row[from] {
            Some(column) => add(column, weight),
            None => desired += positions[from],
        }
        constant += weight * desired;
    }
    constant
}

/// Does the same as [`solve_equilibrium_system`] by Gaussian elimination of sparse rows. A robot with few neighbors is
/// eliminated first, so that few new elements arise. The pivot is the diagonal element: in each row it is at least the sum
/// of the weights, also after each elimination.
fn eliminate_equilibrium_system(
    in_neighbors: &[Vec<(usize, Vec2)>],
    free: &[usize],
    row: &[Option<usize>],
    positions: &mut [Vec2],
) -> Option<()> {
    // Row k states: diagonal[k] p_k = constant[k] + sum of weights[k][j] p_j.
    let mut diagonal = vec![1.0; free.len()];
    let mut constant = vec![Vec2::zeros(); free.len()];
    let mut weights: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); free.len()];
    let mut rows_with: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); free.len()];
    for (k, &i) in free.iter().enumerate() {
        let add = |column: usize, weight| {
            *weights[k].entry(column).or_default() += weight;
            rows_with[column].insert(k);
        };
        constant[k] = equilibrium_equation(&in_neighbors[i], row, positions, add);
    }
    let mut left: BTreeSet<usize> = (0..free.len()).collect();
    let mut order = Vec::new();
    while let Some(k) = left.iter().copied().min_by_key(|&k| weights[k].len() * rows_with[k].len())
    {
        left.remove(&k);
        order.push(k);
        let own = std::mem::take(&mut weights[k]);
        for &j in own.keys() {
            rows_with[j].remove(&k);
        }
        for i in std::mem::take(&mut rows_with[k]) {
            let factor = weights[i].remove(&k).unwrap_or(0.0) / diagonal[k];
            let added = factor * constant[k];
            constant[i] += added;
            for (&j, &weight) in &own {
                if j == i {
                    diagonal[i] -= factor * weight;
                } else {
                    *weights[i].entry(j).or_default() += factor * weight;
                    rows_with[j].insert(i);
                }
            }
        }
        weights[k] = own;
    }
    let mut solution = vec![Vec2::zeros(); free.len()];
    for &k in order.iter().rev() {
        let others = weights[k].iter().map(|(&j, &weight)| weight * solution[j]);
        solution[k] = (constant[k] + others.sum::<Vec2>()) / diagonal[k];
    }
    if solution.iter().any(|position| !position.iter().all(|coordinate| coordinate.is_finite())) {
        return None;
    }
    free.iter().zip(solution).for_each(|(&i, position)| positions[i] = position);
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
            let pairs = pairs.into_iter().map(|(from, to)| [from % n, to % n]);
            let edges = pairs.filter(|[from, to]| from != to && !(leads && *to == 0));
            let edges: std::collections::BTreeSet<[usize; 2]> = edges.collect();
            graph(n, &edges.into_iter().collect::<Vec<_>>())
        }
    }

    /// Returns the largest modulus of the eigenvalues, by the QR algorithm.
    fn spectral_radius_by_qr(matrix: &Matrix) -> f64 {
        let schur = nalgebra::Schur::try_new(matrix.clone(), 1e-14, 10_000).unwrap();
        schur.complex_eigenvalues().iter().map(|z| z.re.hypot(z.im)).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn laplacian_and_system_match_their_definitions(
            graph in graphs(true), leads in any::<bool>(),
        ) {
            let n = graph.robot_count();
            let leader = leads.then_some(0);
            let (l, a) = (laplacian(&graph), formation_matrix(&graph, leader));
            for i in 0..n {
                let in_neighbors: Vec<usize> = graph.incoming_edges(i).map(|e| e.from).collect();
                let g = in_neighbors.len() as f64;
                for j in 0..n {
                    let unit = f64::from(u8::from(i == j));
                    let a_d = f64::from(u8::from(in_neighbors.contains(&j))); // (6)
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
            let n = graph.robot_count();
            let reached = Reachability::new(&graph, Some(0), &[], &[]).defects_without_faults().unled.is_empty();
            let a = formation_matrix(&graph, Some(0));
            let radius = spectral_radius(&velocity_iteration_matrix(&graph, &vec![true; n]));
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
            let radius = spectral_radius_by_qr(&matrix);
            prop_assert!((spectral_radius(&matrix) / radius - 1.0).abs() < 1e-9);
            let singular = matrix.singular_values().max();
            prop_assert!((spectral_norm(&matrix) / singular - 1.0).abs() < 1e-9);
        }

        #[test]
        fn velocities_echo_iff_the_spectral_radius_is_1(
            graph in graphs(false), feed_forward in proptest::collection::vec(any::<bool>(), 9),
        ) {
            let feed_forward = &feed_forward[..graph.robot_count()];
            let radius = spectral_radius(&velocity_iteration_matrix(&graph, feed_forward));
            prop_assert!(radius < 1.0 + 1e-12);
            prop_assert_eq!(velocity_feedback_robots(&graph, feed_forward).is_empty(), radius < 1.0 - 1e-9);
        }

        /// Robots that are not free may be at any position.
        #[test]
        fn settle_moves_only_free_robots_to_their_neighbor_mean(
            graph in graphs(true), is_fixed in proptest::collection::vec(any::<bool>(), 9),
            at in proptest::collection::vec((-9.0..9.0f64, -9.0..9.0f64), 9),
        ) {
            let n = graph.robot_count();
            let reached = graph.reachability();
            let is_fixed = |i: usize| i == 0 || is_fixed[i];
            let is_reached = |i: usize| (0..n).any(|from| is_fixed(from) && reached[from][i]);
            let free: Vec<usize> = (0..n).filter(|&i| !is_fixed(i)).collect();
            prop_assume!(free.iter().all(|&i| is_reached(i)));
            let in_neighbors: Vec<Vec<(usize, Vec2)>> = (0..n)
                .map(|i| graph.incoming_edges(i).map(|edge| (edge.from, edge.offset_m)).collect())
                .collect();
            let start: Vec<Vec2> = at[..n].iter().map(|&(x, y)| Vec2::new(x, y)).collect();
            let mut positions = start.clone();
            prop_assert_eq!(move_to_settled_positions(&in_neighbors, &free, &mut positions), Some(()));
            for (i, start) in start.iter().enumerate() {
                if is_fixed(i) {
                    prop_assert_eq!(&positions[i], start);
                    continue;
                }
                let desired: Vec2 = graph.incoming_edges(i).map(|e| positions[e.from] + e.offset_m).sum();
                let desired = desired / graph.incoming_edges(i).count() as f64; // (24)
                prop_assert!((positions[i] - desired).norm() < 1e-9, "robot {i}");
            }
        }

        #[test]
        fn elimination_settles_robots_like_the_dense_solution(graph in graphs(true)) {
            let n = graph.robot_count();
            prop_assume!(!graph.hop_counts_from(0).contains(&None));
            let in_neighbors: Vec<Vec<(usize, Vec2)>> = (0..n)
                .map(|i| graph.incoming_edges(i).map(|edge| (edge.from, edge.offset_m)).collect())
                .collect();
            let free: Vec<usize> = (1..n).collect();
            let row: Vec<Option<usize>> = (0..n).map(|i| i.checked_sub(1)).collect();
            let start = vec![Vec2::new(0.3, -2.0); n];
            let (mut sparse, mut dense) = (start.clone(), start);
            let solved = eliminate_equilibrium_system(&in_neighbors, &free, &row, &mut sparse);
            prop_assert_eq!(solved, Some(()));
            prop_assert_eq!(solve_equilibrium_system(&in_neighbors, &free, &row, &mut dense), Some(()));
            for i in 0..n {
                prop_assert!((sparse[i] - dense[i]).norm() < 1e-9, "robot {i}");
            }
        }

        /// Copies of a graph, each led by a robot of the one before, are as many as are solved in groups.
        #[test]
        fn settle_moves_many_robots_to_their_neighbor_mean(one in graphs(true)) {
            let n = one.robot_count();
            let reached = Reachability::new(&one, Some(0), &[], &[]).defects_without_faults().unled.is_empty();
            prop_assume!(n > 1 && reached);
            let copies = DENSE_MATRIX_ROWS_MAX / (n - 1) + 2;
            let mut in_neighbors: Vec<Vec<(usize, Vec2)>> = vec![Vec::new()];
            for copy in 0..copies {
                let index = |robot: usize| if robot == 0 { copy * (n - 1) } else { copy * (n - 1) + robot };
                for robot in 1..n {
                    let edges = one.incoming_edges(robot);
                    in_neighbors.push(edges.map(|edge| (index(edge.from), edge.offset_m)).collect());
                }
            }
            let free: Vec<usize> = (1..in_neighbors.len()).collect();
            prop_assert!(free.len() > DENSE_MATRIX_ROWS_MAX);
            let mut positions = vec![Vec2::zeros(); in_neighbors.len()];
            prop_assert_eq!(move_to_settled_positions(&in_neighbors, &free, &mut positions), Some(()));
            for &i in &free {
                let desired: Vec2 = in_neighbors[i].iter().map(|&(from, c)| positions[from] + c).sum();
                let error_m = (positions[i] - desired / in_neighbors[i].len() as f64).norm();
                prop_assert!(error_m < 1e-6, "robot {i}: {error_m}");
            }
        }

        #[test]
        fn settled_robots_are_at_their_neighbor_mean(
            graph in graphs(true),
        ) {
            let reached = Reachability::new(&graph, Some(0), &[], &[]).defects_without_faults().unled.is_empty();
            let positions = settled_positions(&graph, 0);
            prop_assert_eq!(positions.is_some(), reached);
            let Some(positions) = positions else { return Ok(()) };
            prop_assert_eq!(positions[0], Vec2::zeros());
            for i in 1..graph.robot_count() {
                let desired: Vec2 = graph.incoming_edges(i).map(|e| positions[e.from] + e.offset_m).sum();
                let desired = desired / graph.incoming_edges(i).count() as f64; // (24)
                prop_assert!((positions[i] - desired).norm() < 1e-9, "robot {i}");
            }
        }
    }

    #[test]
    fn large_ring_settles_at_neighbor_means() {
        let robots = 2 * DENSE_MATRIX_ROWS_MAX;
        let heard = |i: usize| (1..=4).map(move |k| [(i + k) % robots, i]);
        let ring = graph(robots, &(1..robots).flat_map(heard).collect::<Vec<_>>());
        let positions = settled_positions(&ring, 0).unwrap();
        for i in 1..robots {
            let desired: Vec2 =
                ring.incoming_edges(i).map(|e| positions[e.from] + e.offset_m).sum();
            let error_m = (positions[i] - desired / 4.0).norm();
            assert!(error_m < 1e-6, "robot {i}: {error_m}");
        }
    }

    #[test]
    fn large_matrices_have_the_radius_and_norm_of_small_ones() {
        // Rings of 20, next to each other in one matrix, with an edge from each to the next.
        let rings = |count: usize, weight: f64| {
            Matrix::from_fn(20 * count, 20 * count, |i, j| match (i / 20 == j / 20, j == i + 20) {
                (true, _) if (i + 1) % 20 == j % 20 => weight * (1.0 + (i % 20) as f64 / 20.0),
                (false, true) => 0.25,
                _ => 0.0,
            })
        };
        let (small, large) = (rings(1, 0.4), rings(20, 0.4));
        assert!(large.nrows() > DENSE_MATRIX_ROWS_MAX);
        let radius = spectral_radius(&small);
        assert!((spectral_radius(&large) / radius - 1.0).abs() < 1e-9);
        let open = Matrix::from_fn(400, 400, |i, j| f64::from(u8::from(j == i + 1)));
        assert_eq!(spectral_radius(&open), 0.0);
        // The product of the weights of the ring is 1.
        let weight = |i: usize| if i.is_multiple_of(2) { 2.0 } else { 0.5 };
        let ring =
            Matrix::from_fn(400, 400, |i, j| if j == (i + 1) % 400 { weight(i) } else { 0.0 });
        assert!((spectral_radius(&ring) - 1.0).abs() < 1e-9);
        let (squared, powers) = (
            spectral_radius_by_squaring(&(large.transpose() * &large)).sqrt(),
            spectral_norm(&large),
        );
        assert!((powers / squared - 1.0).abs() < 1e-6, "{powers} {squared}");
        let system = Matrix::identity(400, 400) - 0.1 * large;
        let (solved, inverted) =
            (inverse_norm_2(&system), spectral_norm(&system.clone().try_inverse().unwrap()));
        let solved = solved.unwrap();
        assert!((solved / inverted - 1.0).abs() < 1e-9, "{solved} {inverted}");
        assert_eq!(inverse_norm_2(&Matrix::zeros(400, 400)), None);
    }

    #[test]
    fn directed_ring_echoes_only_with_feed_forward() {
        for robots in [2, 3, 7, 64] {
            let ring = ring(robots);
            let all = vec![true; robots];
            assert!((spectral_radius(&velocity_iteration_matrix(&ring, &all)) - 1.0).abs() < 1e-12);
            assert_eq!(velocity_feedback_robots(&ring, &all).len(), robots);
            let none = vec![false; robots];
            assert_eq!(spectral_radius(&velocity_iteration_matrix(&ring, &none)), 0.0);
            assert!(velocity_feedback_robots(&ring, &none).is_empty());
        }
    }
}
