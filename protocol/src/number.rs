//! How a number is shown to people.

/// Six significant digits, without trailing zeros.
pub fn short(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let digits = 5 - (number.abs().log10().floor() as i32);
    let rounded = format!("{number:.*}", digits.clamp(0, 15) as usize);
    if rounded.contains('.') {
        rounded.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        rounded
    }
}
