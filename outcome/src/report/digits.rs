//! Short formatting of numbers.

use formation::portable_math;

/// Formats a number with four significant digits.
pub fn format_four_digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        magnitude if !magnitude.is_finite() => value.to_string(),
        magnitude if !(1e-3..1e5).contains(&magnitude) => format!("{value:.1e}"),
        magnitude => {
            let exponent = portable_math::log10(magnitude).floor() as i32;
            format!("{value:.*}", (3 - exponent).max(0) as usize)
        }
    }
}
