//! Formatting of numbers in messages.

use formation::portable_math;

/// Formats a number with six significant digits, without trailing zeros.
pub fn format_short(number: f64) -> String {
    format_significant(number, 6)
}

/// Formats two compared numbers with at least six significant digits, and with as many as make them differ if
/// they are not equal.
pub fn format_distinct(a: f64, b: f64) -> [String; 2] {
    // 17 digits distinguish any two doubles.
    let candidates = (6..=17).map(|digits| [a, b].map(|number| format_significant(number, digits)));
    let mut candidates = candidates.skip_while(|[one, other]| one == other && a != b);
    candidates.next().unwrap_or_else(|| [a, b].map(|number| number.to_string()))
}

/// Formats a number with `digits` significant digits, without trailing zeros. A magnitude below 1e-6 has an exponent.
fn format_significant(number: f64, digits: i32) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    if number.abs() < 1e-6 {
        let rounded = format!("{number:.*e}", digits as usize - 1);
        let (mantissa, exponent) = rounded.split_once('e').expect("in scientific notation");
        return format!("{}e{exponent}", trim_zeros(mantissa));
    }
    let decimals = digits - 1 - (portable_math::log10(number.abs()).floor() as i32);
    trim_zeros(&format!("{number:.*}", decimals.max(0) as usize)).to_owned()
}

/// Removes the trailing zeros after a decimal point, and a point without digits after it.
fn trim_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

/// Returns whether a bound is 0, its value if a file does not set it.
pub(crate) fn is_zero(bound: &f64) -> bool {
    *bound == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compared_numbers_get_enough_digits_to_differ() {
        assert_eq!(format_short(0.123_456_789), "0.123457");
        assert_eq!(format_short(1_234_567.8), "1234568");
        assert_eq!(format_short(-2.5e-5), "-0.000025");
        assert_eq!([format_short(1e-6), format_short(9e-7)], ["0.000001", "9e-7"]);
        assert_eq!(
            [format_short(-9.739_314e-9), format_short(1e-320)],
            ["-9.73931e-9", "9.99989e-321"]
        );
        assert_eq!([format_short(0.0), format_short(f64::INFINITY)], ["0", "inf"]);
        assert_eq!(format_distinct(0.2, 0.3), ["0.2", "0.3"]);
        assert_eq!(format_distinct(0.2, 0.2), ["0.2", "0.2"]);
        assert_eq!(format_distinct(0.199_999_999_97, 0.2), ["0.19999999997", "0.2"]);
        let next = 0.2f64.next_down();
        let [one, other] = format_distinct(next, 0.2);
        assert_ne!(one, other);
        assert_eq!(one.parse(), Ok(next));
    }
}
