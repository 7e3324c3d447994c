//! Short formatting of numbers.

use formation::portable_math;

/// Formats a number with four significant digits.
pub fn format_four_digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !size.is_finite() => value.to_string(),
        size if !(1e-3..1e5).contains(&size) => format!("{value:.1e}"),
        size => {
            let before = portable_math::log10(size).floor() as i32;
            format!("{value:.*}", (3 - before).max(0) as usize)
        }
    }
}
