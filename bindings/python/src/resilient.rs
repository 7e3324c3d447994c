//! The W-MSR filter of the built-in laws, for values in messages.

use formation::resilient::ReceivedValue;
use pyo3::prelude::*;

/// Returns the W-MSR result of these values, see [`formation::resilient::resilient_mean`]. No value is trusted.
#[pyfunction]
pub fn resilient_mean(own: f64, values: Vec<f64>, liars_max: usize) -> f64 {
    let received = values.into_iter().map(|value| ReceivedValue { value, is_trusted: false });
    formation::resilient::resilient_mean(own, received, liars_max)
}
