//! Covariance matrix adaptation in the unit cube, for functions of which only the order of values is known.
//!
//! (mu/mu_w, lambda)-CMA-ES after N. Hansen, The CMA Evolution Strategy: A Tutorial (2016), equations in brackets.
//! Steps are drawn by the Cholesky factor of C, in place of its symmetric root: the evolution path of the step size
//! is then that of the same steps before the factor.

use formation::portable_math;
use formation::random::SplitMix64;

/// State of a CMA-ES search.
pub(super) struct Cma {
    mean: Vec<f64>,
    /// Step size sigma.
    pub(super) sigma: f64,
    /// Covariance matrix (C).
    covariance: Vec<Vec<f64>>,
    /// Cholesky factor (A) of the covariance matrix.
    cholesky_factor: Vec<Vec<f64>>,
    sigma_evolution_path: Vec<f64>,
    covariance_evolution_path: Vec<f64>,
    generation: i32,
    /// Standard normal vectors of the current points, before the multiplication by A.
    standard_normal_samples: Vec<Vec<f64>>,
}

impl Cma {
    /// Creates a search around `mean`.
    pub(super) fn new(mean: Vec<f64>, sigma: f64) -> Cma {
        let n = mean.len();
        let identity_row = |i: usize| (0..n).map(|j| f64::from(i == j)).collect();
        let identity: Vec<Vec<f64>> = (0..n).map(identity_row).collect();
        Cma {
            mean,
            sigma,
            cholesky_factor: identity.clone(),
            covariance: identity,
            sigma_evolution_path: vec![0.0; n],
            covariance_evolution_path: vec![0.0; n],
            generation: 0,
            standard_normal_samples: Vec::new(),
        }
    }

    /// Draws the next `lambda` points: x = m + sigma A z, reflected at the cube's sides. (39) (40)
    pub(super) fn sample_points(
        &mut self,
        random: &mut SplitMix64,
        lambda: usize,
    ) -> Vec<Vec<f64>> {
        let n = self.mean.len();
        self.standard_normal_samples =
            (0..lambda).map(|_| (0..n).map(|_| draw_standard_normal(random)).collect()).collect();
        let point = |z: &Vec<f64>| {
            let y = matrix_vector_product(&self.cholesky_factor, z);
            self.mean
                .iter()
                .zip(y)
                .map(|(m, y)| reflect_into_unit_interval(m + self.sigma * y))
                .collect()
        };
        self.standard_normal_samples.iter().map(point).collect()
    }

    /// Updates the distribution with the points and their costs. Smaller costs are better.
    pub(super) fn update_from_costs(&mut self, costs: &[f64]) {
        let (n, lambda) = (self.mean.len() as f64, costs.len());
        let mut order: Vec<usize> = (0..lambda).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let mu = (lambda / 2).max(1);
        // Weights, and the variance-effective selection mass. (49) (8)
        let raw_weight = |i: usize| {
            portable_math::ln((lambda as f64 + 1.0) / 2.0) - portable_math::ln(i as f64 + 1.0)
        };
        let sum: f64 = (0..mu).map(raw_weight).sum();
        let weights: Vec<f64> = (0..mu).map(|i| raw_weight(i) / sum).collect();
        let mu_eff = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        // Learning rates. (55) to (58)
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let damping = 1.0 + 2.0 * (((mu_eff - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        let c_c = (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n);
        let c_1 = 2.0 / (portable_math::square(n + 1.3) + mu_eff);
        let c_mu = (2.0 * (mu_eff - 2.0 + 1.0 / mu_eff)
            / (portable_math::square(n + 2.0) + mu_eff))
            .min(1.0 - c_1);
        let best: Vec<&Vec<f64>> =
            order[..mu].iter().map(|&i| &self.standard_normal_samples[i]).collect();
        let weighted = |i: usize| weights.iter().zip(&best).map(|(w, z)| w * z[i]).sum::<f64>();
        let z_mean: Vec<f64> = (0..self.mean.len()).map(weighted).collect();
        let y_mean = matrix_vector_product(&self.cholesky_factor, &z_mean);
        for (m, y) in self.mean.iter_mut().zip(&y_mean) {
            *m = reflect_into_unit_interval(*m + self.sigma * y);
        }
        // Step size. (43) (44)
        let path_gain = (c_sigma * (2.0 - c_sigma) * mu_eff).sqrt();
        for (p, z) in self.sigma_evolution_path.iter_mut().zip(&z_mean) {
            *p = (1.0 - c_sigma) * *p + path_gain * z;
        }
        self.generation += 1;
        let chi = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
        let length = self.sigma_evolution_path.iter().map(|p| p * p).sum::<f64>().sqrt();
        self.sigma =
            (self.sigma * portable_math::exp(c_sigma / damping * (length / chi - 1.0))).min(1.0);
        // Covariance. (45) (47)
        let path_scale =
            (1.0 - portable_math::pow(1.0 - c_sigma, f64::from(2 * self.generation))).sqrt();
        let h_sigma = f64::from(length / path_scale < (1.4 + 2.0 / (n + 1.0)) * chi);
        let path_gain = h_sigma * (c_c * (2.0 - c_c) * mu_eff).sqrt();
        for (p, y) in self.covariance_evolution_path.iter_mut().zip(&y_mean) {
            *p = (1.0 - c_c) * *p + path_gain * y;
        }
        let steps: Vec<Vec<f64>> =
            best.iter().map(|z| matrix_vector_product(&self.cholesky_factor, z)).collect();
        let old_weight = 1.0 - c_1 - c_mu + (1.0 - h_sigma) * c_1 * c_c * (2.0 - c_c);
        for (i, row) in self.covariance.iter_mut().enumerate() {
            for (j, c) in row.iter_mut().enumerate() {
                let rank_mu: f64 = weights.iter().zip(&steps).map(|(w, y)| w * y[i] * y[j]).sum();
                *c = old_weight * *c
                    + c_1 * self.covariance_evolution_path[i] * self.covariance_evolution_path[j]
                    + c_mu * rank_mu;
            }
        }
        self.cholesky_factor = cholesky(&self.covariance);
    }
}

/// Draws a standard normal number (Box-Muller transform).
pub(super) fn draw_standard_normal(random: &mut SplitMix64) -> f64 {
    let radius = (-2.0 * portable_math::ln(1.0 - random.draw_unit())).sqrt();
    radius * portable_math::cos(std::f64::consts::TAU * random.draw_unit())
}

/// Reflects a number at 0 and 1 into [0, 1].
pub(super) fn reflect_into_unit_interval(x: f64) -> f64 {
    let x = x.rem_euclid(2.0);
    if x > 1.0 { 2.0 - x } else { x }
}

fn matrix_vector_product(matrix: &[Vec<f64>], vector: &[f64]) -> Vec<f64> {
    matrix.iter().map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum()).collect()
}

/// Returns the lower triangular A with A A^T = C (Cholesky factor).
fn cholesky(c: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut a = vec![vec![0.0; c.len()]; c.len()];
    for i in 0..c.len() {
        for j in 0..=i {
            let rest = c[i][j] - a[i][..j].iter().zip(&a[j][..j]).map(|(x, y)| x * y).sum::<f64>();
            a[i][j] = if i == j { rest.max(1e-20).sqrt() } else { rest / a[j][j] };
        }
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the value of a long valley that is not aligned with an axis: 1e4 times as steep across as along.
    fn valley(x: &[f64]) -> f64 {
        let s: Vec<f64> = x.iter().map(|x| x - 0.3).collect();
        let across: f64 = s.windows(2).map(|pair| (pair[0] - pair[1]).powi(2)).sum();
        1e4 * across + s.iter().sum::<f64>().powi(2)
    }

    #[test]
    fn cma_finds_the_minimum_of_a_skewed_valley() {
        let mut random = SplitMix64::new(3);
        let mut cma = Cma::new(vec![0.8; 8], 0.2);
        for _ in 0..400 {
            let points = cma.sample_points(&mut random, 16);
            assert!(points.iter().flatten().all(|x| (0.0..=1.0).contains(x)));
            let costs: Vec<f64> = points.iter().map(|point| valley(point)).collect();
            cma.update_from_costs(&costs);
        }
        assert!(valley(&cma.mean) < 1e-12, "{:?}", cma.mean);
    }

    #[test]
    fn cholesky_factor_times_transpose_is_the_matrix() {
        let c = [[4.0, 2.0, 0.6], [2.0, 5.0, 1.0], [0.6, 1.0, 3.0]].map(Vec::from);
        let a = cholesky(&c);
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| a[i][k] * a[j][k]).sum();
                assert!((product - c[i][j]).abs() < 1e-12);
            }
        }
    }
}
