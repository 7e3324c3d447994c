//! One axis: from values to places, and where its ticks are.

use formation::portable_math;

/// Below this, a logarithmic axis knows no values.
const LEAST: f64 = 1e-30;

/// An axis with a unit in its label.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// What is shown, and its unit.
    pub label: String,
    logarithmic: bool,
    /// Ticks are whole numbers.
    whole: bool,
    low: f64,
    high: f64,
}

impl Axis {
    /// From `low` to `high` exactly.
    pub fn exact(label: &str, low: f64, high: f64) -> Axis {
        let (low, high) = sound(low, high);
        Axis { label: label.into(), logarithmic: false, whole: false, low, high }
    }

    /// Of numbers of things, from 1 to `most`.
    pub fn numbers(label: &str, most: usize) -> Axis {
        Axis { whole: true, ..Axis::exact(label, 0.5, most as f64 + 0.5) }
    }

    /// From `low` to `high`, and on to the next ticks.
    pub fn linear(label: &str, low: f64, high: f64) -> Axis {
        let (low, high) = sound(low, high);
        let step = step(high - low, 6);
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        Axis { label: label.into(), logarithmic: false, whole: false, low, high }
    }

    /// Logarithmic, over whole decades around both; both above 0.
    pub fn log(label: &str, low: f64, high: f64) -> Axis {
        let [low, high] =
            [low, high].map(|value| portable_math::log10(value.clamp(LEAST, 1.0 / LEAST)));
        let (low, high) = if low <= high { (low, high) } else { sound(low, high) };
        // A hair's breadth beyond a decade is rounding.
        let (low, high) = ((low + 1e-9).floor(), (high - 1e-9).ceil());
        let high = if high > low { high } else { low + 1.0 };
        Axis { label: label.into(), logarithmic: true, whole: false, low, high }
    }

    /// Smallest and largest value on it.
    pub fn bounds(&self) -> (f64, f64) {
        if self.logarithmic {
            (portable_math::pow(10.0, self.low), portable_math::pow(10.0, self.high))
        } else {
            (self.low, self.high)
        }
    }

    /// Where a value is: 0 at the low end, 1 at the high one, beyond both outside.
    pub fn share(&self, value: f64) -> f64 {
        // What is too small for a logarithm is far below.
        let value = if self.logarithmic { portable_math::log10(value.max(LEAST)) } else { value };
        (value - self.low) / (self.high - self.low)
    }

    /// The value at a share of its length.
    pub fn at(&self, share: f64) -> f64 {
        let value = self.low + share * (self.high - self.low);
        if self.logarithmic { portable_math::pow(10.0, value) } else { value }
    }

    /// The numbers that stand at it: at most about `many`.
    pub(super) fn ticks(&self, many: usize) -> Vec<f64> {
        if !self.logarithmic {
            let step = step(self.high - self.low, many);
            let step = if self.whole { step.max(1.0) } else { step };
            let (first, last) =
                ((self.low / step - 1e-9).ceil(), (self.high / step + 1e-9).floor());
            return (first as i64..=last as i64).map(|tick| tick as f64 * step).collect();
        }
        let decades = (self.high - self.low) as usize;
        let every = decades.div_ceil(many.max(1)).max(1);
        let whole = (self.low as i32..=self.high as i32).step_by(every);
        let mantissas: &[f64] = if decades < 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let high = self.bounds().1;
        let of_decade = |decade| mantissas.iter().map(move |mantissa| mantissa * power(decade));
        whole.flat_map(of_decade).filter(|&tick| tick <= high * 1.000_001).collect()
    }
}

/// 10^n, as near as a literal is: 1e-3 and not 0.0010000000000000002.
fn power(decade: i32) -> f64 {
    format!("1e{decade}").parse().expect("a number")
}

/// Both finite and no farther out than anything is, and the second one larger.
fn sound(low: f64, high: f64) -> (f64, f64) {
    let bounded = |value: f64| if value.is_finite() { value.clamp(-1e12, 1e12) } else { value };
    let (low, high) = (bounded(low), bounded(high));
    match (low.is_finite(), high.is_finite()) {
        (true, true) if high - low > 1e-12 * low.abs().max(high.abs()).max(1e-280) => (low, high),
        (true, _) => (low, low + low.abs().max(1.0)),
        (false, true) => (high - high.abs().max(1.0), high),
        (false, false) => (0.0, 1.0),
    }
}

/// 1, 2 or 5 times a power of ten, so that about `many` of it span `length`.
fn step(length: f64, many: usize) -> f64 {
    let least = length / many.max(1) as f64;
    let decade = power(portable_math::log10(least).floor() as i32);
    let found =
        [1.0, 2.0, 5.0, 10.0].into_iter().find(|mantissa| mantissa * decade >= least * 0.999);
    found.unwrap_or(10.0) * decade
}

/// A tick in few characters: powers of ten from 0.001 down and 10,000 up.
pub(super) fn label(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let decade = portable_math::log10(value.abs()).floor() as i32;
    if (-2..5).contains(&decade) {
        let text = format!("{value:.6}");
        return minus(text.trim_end_matches('0').trim_end_matches('.'));
    }
    let mantissa = (value / power(decade) * 100.0).round() / 100.0;
    let raised: String = decade.to_string().chars().map(superscript).collect();
    if mantissa == 1.0 {
        format!("10{raised}")
    } else {
        minus(&format!("{mantissa}\u{b7}10{raised}"))
    }
}

fn minus(number: &str) -> String {
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

    fn labels(axis: &Axis, many: usize) -> Vec<String> {
        axis.ticks(many).into_iter().map(label).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(
            labels(&Axis::linear("t (s)", 0.0, 30.0), 6),
            ["0", "5", "10", "15", "20", "25", "30"]
        );
        let metres = labels(&Axis::linear("x (m)", -0.12, 0.31), 6);
        assert_eq!(metres, ["\u{2212}0.2", "\u{2212}0.1", "0", "0.1", "0.2", "0.3", "0.4"]);
        let decades = labels(&Axis::log("error (m)", 1e-6, 1.02), 9);
        assert_eq!(
            decades[..3],
            ["10\u{207b}\u{2076}", "10\u{207b}\u{2075}", "10\u{207b}\u{2074}"]
        );
        assert_eq!(decades.last().unwrap(), "10");
        assert_eq!(labels(&Axis::numbers("point", 3), 9), ["1", "2", "3"]);
        assert_eq!(labels(&Axis::log("age (ms)", 5.0, 5.0), 9), ["1", "2", "5", "10"]);
    }

    proptest! {
        #[test]
        fn an_axis_is_sound_whatever_it_is_to_show(
            low in any::<f64>(), high in any::<f64>(), many in 0..20_usize,
        ) {
            for axis in [Axis::exact("", low, high), Axis::linear("", low, high), Axis::log("", low, high)] {
                let (from, to) = axis.bounds();
                prop_assert!(from < to, "{axis:?}");
                prop_assert!(axis.ticks(many).len() < 200, "{axis:?}");
            }
        }

        #[test]
        fn what_it_is_to_show_is_on_it(low in -1e6..1e6f64, length in 1e-3..1e6f64, share in 0.0..1.0f64) {
            let axis = Axis::linear("", low, low + length);
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.share(low + share * length)));
            let axis = Axis::log("", length, length * 7.0);
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.share(length * (1.0 + 6.0 * share))));
        }
    }
}
