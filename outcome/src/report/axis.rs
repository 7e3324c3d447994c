//! Axis of a figure: mapping of values to positions, and ticks.

use formation::portable_math;

/// Threshold of the distance of ticks from 0, in distances between two ticks. Ticks farther out are labeled
/// relative to an offset.
const LABEL_OFFSET_MIN: f64 = 1e4;

/// Smallest value on a logarithmic axis. Smaller values are drawn there.
const LOG_AXIS_MIN: f64 = 1e-30;

/// Axis with a label that includes the unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Label with the unit.
    pub label: String,
    is_logarithmic: bool,
    /// Whether ticks are integers only.
    has_integer_ticks: bool,
    low: f64,
    high: f64,
}

impl Axis {
    /// Creates a linear axis that ends exactly at `low` and `high`.
    pub fn exact(label: &str, low: f64, high: f64) -> Axis {
        let (low, high) = finite_bounds(low, high);
        Axis { label: label.into(), is_logarithmic: false, has_integer_ticks: false, low, high }
    }

    /// Creates an axis of item numbers from 1 to `count`.
    pub fn for_item_numbers(label: &str, count: usize) -> Axis {
        Axis { has_integer_ticks: true, ..Axis::exact(label, 0.5, count as f64 + 0.5) }
    }

    /// Creates a linear axis from `low` to `high`, extended to the next ticks.
    pub fn linear(label: &str, low: f64, high: f64) -> Axis {
        let (low, high) = finite_bounds(low, high);
        let step = tick_step(high - low, 6);
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        Axis { label: label.into(), is_logarithmic: false, has_integer_ticks: false, low, high }
    }

    /// Creates a logarithmic axis over the decades that contain both values, which must be above 0.
    pub fn log(label: &str, low: f64, high: f64) -> Axis {
        let [low, high] = [low, high]
            .map(|value| portable_math::log10(value.clamp(LOG_AXIS_MIN, 1.0 / LOG_AXIS_MIN)));
        let (low, high) = if low <= high { (low, high) } else { finite_bounds(low, high) };
        // The tolerance absorbs rounding at the border of a decade.
        let (low, high) = ((low + 1e-9).floor(), (high - 1e-9).ceil());
        let high = if high > low { high } else { low + 1.0 };
        Axis { label: label.into(), is_logarithmic: true, has_integer_ticks: false, low, high }
    }

    /// Returns the smallest and the largest value on the axis.
    pub fn value_range(&self) -> (f64, f64) {
        if self.is_logarithmic {
            (portable_math::pow(10.0, self.low), portable_math::pow(10.0, self.high))
        } else {
            (self.low, self.high)
        }
    }

    /// Returns the position of a value: 0 at the low end, 1 at the high end, beyond these outside.
    pub fn fraction(&self, value: f64) -> f64 {
        // Values too small for a logarithm are far below the axis.
        let value =
            if self.is_logarithmic { portable_math::log10(value.max(LOG_AXIS_MIN)) } else { value };
        (value - self.low) / (self.high - self.low)
    }

    /// Returns the value at a position from 0 to 1.
    pub fn value_at(&self, fraction: f64) -> f64 {
        let value = self.low + fraction * (self.high - self.low);
        if self.is_logarithmic { portable_math::pow(10.0, value) } else { value }
    }

    /// Returns the ticks with their labels, at most about `count`, and the label of the axis. Labels differ, and
    /// each equals its tick up to a small fraction of the distance between two ticks. Far from 0 the ticks are
    /// labeled relative to an offset, which is then part of the label of the axis: `x \u{2212} 500000 (m)`.
    pub(super) fn tick_labels(&self, count: usize) -> (Vec<(f64, String)>, String) {
        let ticks = self.ticks(count);
        let plain_labels =
            |ticks: Vec<f64>| ticks.into_iter().map(|tick| (tick, format_tick(tick))).collect();
        let ([first, second, ..], false) = (&ticks[..], self.is_logarithmic) else {
            return (plain_labels(ticks), self.label.clone());
        };
        let (step, span) = (second - first, ticks[ticks.len() - 1] - first);
        let largest = ticks.iter().fold(0.0, |largest: f64, tick| largest.max(tick.abs()));
        if largest / step > LABEL_OFFSET_MIN {
            let rounding_unit = power_of_ten(portable_math::log10(span).ceil() as i32);
            let offset = ((first + 0.5 * span) / rounding_unit).round() * rounding_unit;
            let digits = decimal_count(rounding_unit);
            let relative = ticks.iter().map(|&tick| {
                let rounded_offset = ((tick - offset) / step).round() * step;
                (tick, format_tick(rounded_offset))
            });
            return (relative.collect(), label_with_offset(&self.label, offset, digits));
        }
        // Two decimals of a power of ten cannot distinguish such ticks.
        if largest >= 1e5 && largest / step > 50.0 {
            let digits = decimal_count(step);
            let whole_label = |tick: f64| (tick, with_minus_sign(&format!("{tick:.digits$}")));
            return (ticks.into_iter().map(whole_label).collect(), self.label.clone());
        }
        (plain_labels(ticks), self.label.clone())
    }

    /// Returns the values of the ticks: at most about `count`.
    pub(super) fn ticks(&self, count: usize) -> Vec<f64> {
        if !self.is_logarithmic {
            let step = tick_step(self.high - self.low, count);
            let step = if self.has_integer_ticks { step.max(1.0) } else { step };
            let (first, last) =
                ((self.low / step - 1e-9).ceil(), (self.high / step + 1e-9).floor());
            return (first as i64..=last as i64).map(|tick| tick as f64 * step).collect();
        }
        let decades = (self.high - self.low) as usize;
        let step = decades.div_ceil(count.max(1)).max(1);
        let shown_decades = (self.low as i32..=self.high as i32).step_by(step);
        let mantissas: &[f64] = if decades < 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let high = self.value_range().1;
        let ticks_of_decade =
            |decade| mantissas.iter().map(move |mantissa| mantissa * power_of_ten(decade));
        shown_decades.flat_map(ticks_of_decade).filter(|&tick| tick <= high * 1.000_001).collect()
    }
}

/// Returns the number of decimals of 1, 2 or 5 times a power of ten.
fn decimal_count(step: f64) -> usize {
    (-(portable_math::log10(step) + 1e-9).floor()).clamp(0.0, 15.0) as usize
}

/// Returns the label of an axis whose ticks are relative to an offset: `x (m)` becomes `x \u{2212} 500000 (m)`.
fn label_with_offset(label: &str, offset: f64, digits: usize) -> String {
    let sign = if offset < 0.0 { '+' } else { '\u{2212}' };
    let (name, unit) =
        label.rsplit_once(" (").map_or((label, None), |(name, unit)| (name, Some(unit)));
    let unit = unit.map_or(String::new(), |unit| format!(" ({unit}"));
    format!("{name} {sign} {:.digits$}{unit}", offset.abs())
}

/// Returns 10^n rounded like a literal: 1e-3 and not 0.0010000000000000002.
fn power_of_ten(decade: i32) -> f64 {
    format!("1e{decade}").parse().expect("a number")
}

/// Returns finite bounds of at most 1e12 with the second one larger.
fn finite_bounds(low: f64, high: f64) -> (f64, f64) {
    let limit = |value: f64| if value.is_finite() { value.clamp(-1e12, 1e12) } else { value };
    let (low, high) = (limit(low), limit(high));
    match (low.is_finite(), high.is_finite()) {
        (true, true) if high - low > 1e-12 * low.abs().max(high.abs()).max(1e-280) => (low, high),
        (true, _) => (low, low + low.abs().max(1.0)),
        (false, true) => (high - high.abs().max(1.0), high),
        (false, false) => (0.0, 1.0),
    }
}

/// Returns 1, 2 or 5 times a power of ten, such that about `count` steps span `length`.
fn tick_step(length: f64, count: usize) -> f64 {
    round_up_to_nice_step(length / count.max(1) as f64)
}

/// Returns 1, 2 or 5 times a power of ten: the smallest that is at least `minimum`, which must be above 0.
pub(super) fn round_up_to_nice_step(minimum: f64) -> f64 {
    let decade = power_of_ten(portable_math::log10(minimum).floor() as i32);
    let mantissa =
        [1.0, 2.0, 5.0, 10.0].into_iter().find(|mantissa| mantissa * decade >= minimum * 0.999);
    mantissa.unwrap_or(10.0) * decade
}

/// Formats a tick: with a power of ten below 0.01 and from 100,000 on.
pub(super) fn format_tick(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let decade = portable_math::log10(value.abs()).floor() as i32;
    if (-2..5).contains(&decade) {
        let text = format!("{value:.6}");
        return with_minus_sign(text.trim_end_matches('0').trim_end_matches('.'));
    }
    let mantissa = (value / power_of_ten(decade) * 100.0).round() / 100.0;
    let exponent: String = decade.to_string().chars().map(superscript).collect();
    if mantissa == 1.0 {
        format!("10{exponent}")
    } else {
        with_minus_sign(&format!("{mantissa}\u{b7}10{exponent}"))
    }
}

fn with_minus_sign(number: &str) -> String {
    number.replace('-', "\u{2212}")
}

fn superscript(digit: char) -> char {
    match digit {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        other => char::from_u32(0x2070 + other as u32 - '0' as u32).unwrap_or(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(axis: &Axis, count: usize) -> Vec<String> {
        axis.ticks(count).into_iter().map(format_tick).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(
            labels(&Axis::linear("t (s)", 0.0, 30.0), 6),
            ["0", "5", "10", "15", "20", "25", "30"]
        );
        let meters = labels(&Axis::linear("x (m)", -0.12, 0.31), 6);
        assert_eq!(meters, ["\u{2212}0.2", "\u{2212}0.1", "0", "0.1", "0.2", "0.3", "0.4"]);
        let decade_labels = labels(&Axis::log("error (m)", 1e-6, 1.02), 9);
        assert_eq!(
            decade_labels[..3],
            ["10\u{207b}\u{2076}", "10\u{207b}\u{2075}", "10\u{207b}\u{2074}"]
        );
        assert_eq!(decade_labels.last().unwrap(), "10");
        assert_eq!(labels(&Axis::for_item_numbers("point", 3), 9), ["1", "2", "3"]);
        assert_eq!(labels(&Axis::log("age (ms)", 5.0, 5.0), 9), ["1", "2", "5", "10"]);
    }

    #[test]
    fn tick_labels_far_from_zero_are_relative_to_an_offset() {
        let texts = |axis: &Axis| {
            let (ticks, label) = axis.tick_labels(6);
            (ticks.into_iter().map(|(_, text)| text).collect::<Vec<_>>().join(" "), label)
        };
        let tick_texts = |low, high| texts(&Axis::exact("x (m)", low, high));
        assert_eq!(
            tick_texts(499_998.5, 500_001.5),
            (
                "\u{2212}1.5 \u{2212}1 \u{2212}0.5 0 0.5 1 1.5".into(),
                "x \u{2212} 500000 (m)".into()
            )
        );
        let far_offset = tick_texts(4_650_000.2, 4_650_003.4);
        assert_eq!(far_offset, ("1 2 3".into(), "x \u{2212} 4650000 (m)".into()));
        assert_eq!(tick_texts(-500_003.0, -500_000.0).1, "x + 500000 (m)");
        assert_eq!(tick_texts(100_000.0, 100_400.0).0, "100000 100100 100200 100300 100400");
        assert_eq!(tick_texts(0.0, 100_000.0).1, "x (m)");
        assert_eq!(
            tick_texts(0.0, 0.001),
            (
                "0 2\u{b7}10\u{207b}\u{2074} 4\u{b7}10\u{207b}\u{2074} \
            6\u{b7}10\u{207b}\u{2074} 8\u{b7}10\u{207b}\u{2074} 10\u{207b}\u{b3}"
                    .into(),
                "x (m)".into()
            )
        );
        assert_eq!(tick_texts(0.0, 30.0), ("0 5 10 15 20 25 30".into(), "x (m)".into()));
    }

    proptest! {
        #[test]
        fn tick_labels_differ_wherever_the_axis_lies(
            low in -6.0..6.0f64, is_positive in any::<bool>(), length in -4.0..6.0f64, count in 2..12_usize,
        ) {
            let low = 10f64.powf(low) * if is_positive { 1.0 } else { -1.0 };
            let (ticks, label) = Axis::exact("x (m)", low, low + 10f64.powf(length)).tick_labels(count);
            let different: std::collections::BTreeSet<_> = ticks.iter().map(|(_, text)| text).collect();
            prop_assert_eq!(different.len(), ticks.len(), "{:?} {}", &ticks, label);
            prop_assert!(ticks.iter().all(|(_, text)| text.chars().count() <= 12), "{:?}", &ticks);
        }

        #[test]
        fn axis_is_valid_for_any_range(
            low in any::<f64>(), high in any::<f64>(), count in 0..20_usize,
        ) {
            for axis in [Axis::exact("", low, high), Axis::linear("", low, high), Axis::log("", low, high)] {
                let (from, to) = axis.value_range();
                prop_assert!(from < to, "{axis:?}");
                prop_assert!(axis.ticks(count).len() < 200, "{axis:?}");
            }
        }

        #[test]
        fn axis_contains_the_given_range(low in -1e6..1e6f64, length in 1e-3..1e6f64, fraction in 0.0..1.0f64) {
            let axis = Axis::linear("", low, low + length);
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.fraction(low + fraction * length)));
            let axis = Axis::log("", length, length * 7.0);
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.fraction(length * (1.0 + 6.0 * fraction))));
        }
    }
}
