//! The scale factor delta(t) of a formation. (20) (22)
//!
//! Every scale is continuously differentiable, as the chapter requires.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::portable_math;

/// Scale factor delta(t) of the formation, with t in seconds since the start of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Scale {
    /// The chapter's scale: mean + amplitude sin(2 pi t / period).
    #[expect(missing_docs, reason = "the fields are in the formula")]
    Sine { mean: f64, amplitude: f64, period_s: f64 },
    /// Enlarged while the robots travel to their slots, then closing to 1. An addition to the chapter: through
    /// gaps narrower than twice the distance at which robots are steered around each other, the last robots to
    /// arrive find no passage.
    Closing {
        /// Scale factor while open, at least 1.
        from: f64,
        /// Duration of the open phase, s.
        hold_s: f64,
        /// Duration of closing, and of reopening, s.
        over_s: f64,
        /// Times at which it begins to reopen, s. Each time it stays open for `hold_s` and closes as before.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        reopen_at_s: Vec<f64>,
    },
}

impl Scale {
    /// Constant scale factor 1.
    pub const CONSTANT_ONE: Scale = Scale::Sine { mean: 1.0, amplitude: 0.0, period_s: 1.0 };

    /// Returns the scale factor and its rate, (delta(t), delta'(t)), the latter in 1/s.
    pub fn value_and_rate_at(&self, t_s: f64) -> (f64, f64) {
        match *self {
            Scale::Sine { mean, amplitude, period_s } => {
                let w = TAU / period_s;
                let (sin, cos) = portable_math::sin_cos(w * t_s);
                (mean + amplitude * sin, amplitude * w * cos)
            }
            Scale::Closing { from, hold_s, over_s, ref reopen_at_s } => {
                let step = |begin_s: f64| half_cosine_step((t_s - begin_s) / over_s);
                let (closed, rate) = step(hold_s);
                let (mut open, mut rate) = (1.0 - closed, -rate);
                for &reopen_s in reopen_at_s {
                    let ([rise, rise_rate], [fall, fall_rate]) =
                        (step(reopen_s).into(), step(reopen_s + over_s + hold_s).into());
                    (open, rate) = (open + (rise - fall), rate + (rise_rate - fall_rate));
                }
                (1.0 + (from - 1.0) * open, (from - 1.0) * rate / over_s)
            }
        }
    }

    /// Returns the minimum and the maximum of the scale factor.
    pub fn value_range(&self) -> [f64; 2] {
        match *self {
            Scale::Sine { mean, amplitude, .. } => [mean - amplitude, mean + amplitude],
            Scale::Closing { from, .. } => [1.0, from],
        }
    }

    /// Returns the mean of a sine, or the value of a closing scale after it has closed.
    pub fn final_or_mean_value(&self) -> f64 {
        match *self {
            Scale::Sine { mean, .. } => mean,
            Scale::Closing { .. } => 1.0,
        }
    }

    /// Returns the time from which the scale is constant, s, or `None` if it never is.
    pub fn constant_start_s(&self) -> Option<f64> {
        match self {
            Scale::Sine { amplitude, .. } => (*amplitude == 0.0).then_some(0.0),
            Scale::Closing { .. } => self.closing_end_s(),
        }
    }

    /// Returns the time at which a closing scale has closed for the last time, s, or `None` for a sine.
    pub fn closing_end_s(&self) -> Option<f64> {
        match self {
            Scale::Sine { .. } => None,
            Scale::Closing { hold_s, over_s, reopen_at_s, .. } => {
                let last = reopen_at_s.last().map_or(0.0, |reopen_s| reopen_s + over_s);
                Some(last + hold_s + over_s)
            }
        }
    }
}

/// Returns a half-cosine step, which rises from 0 to 1 while `fraction` goes from 0 to 1, and its derivative with
/// respect to `fraction`.
fn half_cosine_step(fraction: f64) -> (f64, f64) {
    match fraction {
        fraction if fraction <= 0.0 => (0.0, 0.0),
        fraction if fraction >= 1.0 => (1.0, 0.0),
        fraction => {
            let (sin, cos) = portable_math::sin_cos(PI * fraction);
            (0.5 - 0.5 * cos, 0.5 * PI * sin)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scales() -> impl Strategy<Value = Scale> {
        let times = (0.0..20.0f64, 0.5..20.0f64, proptest::collection::vec(1.0..50.0f64, 0..3));
        (1.0..3.0f64, times).prop_map(|(from, (hold_s, over_s, gaps_s))| {
            let mut reopen_at_s: Vec<f64> = Vec::new();
            let mut closed_s = hold_s + over_s;
            for gap_s in gaps_s {
                reopen_at_s.push(closed_s + gap_s);
                closed_s += gap_s + hold_s + 2.0 * over_s;
            }
            Scale::Closing { from, hold_s, over_s, reopen_at_s }
        })
    }

    proptest! {
        #[test]
        fn sine_rate_is_the_derivative_of_the_scale(t in 0.0..100.0f64) {
            let (scale, h) = (Scale::Sine { mean: 1.0, amplitude: 0.2, period_s: 80.0 }, 1e-5);
            let slope = (scale.value_and_rate_at(t + h).0 - scale.value_and_rate_at(t - h).0) / (2.0 * h);
            prop_assert!((slope - scale.value_and_rate_at(t).1).abs() < 1e-9);
        }

        #[test]
        fn closing_scale_is_smooth_and_its_rate_is_its_derivative(
            scale in scales(), fraction in 0.0..1.2f64,
        ) {
            let closed_s = scale.closing_end_s().unwrap();
            let Scale::Closing { from, over_s, .. } = scale else { unreachable!() };
            let (t, h) = (fraction * closed_s, 1e-5);
            let [before, now, after] = [t - h, t, t + h].map(|t| scale.value_and_rate_at(t));
            let slope = (after.0 - before.0) / (2.0 * h);
            // The second derivative is at most (from - 1) pi^2 / (2 over^2), and is discontinuous at both ends.
            let bend = (from - 1.0) * PI * PI / (2.0 * over_s * over_s);
            prop_assert!((slope - now.1).abs() <= bend * h + 1e-9, "{slope}, {}", now.1);
            prop_assert!((after.1 - before.1).abs() <= 2.0 * bend * h + 1e-9);
            prop_assert!((1.0..=from).contains(&now.0), "{}", now.0);
        }

        #[test]
        fn closing_scale_stays_open_then_shrinks_to_exactly_1(
            scale in scales(), fraction in 0.0..1.0f64,
        ) {
            let Scale::Closing { from, hold_s, over_s, ref reopen_at_s } = scale else {
                unreachable!()
            };
            prop_assert_eq!(scale.value_and_rate_at(fraction * hold_s), (from, 0.0));
            let (earlier, later) = (scale.value_and_rate_at(hold_s + fraction * over_s).0, scale.value_and_rate_at(hold_s + over_s));
            prop_assert!(earlier >= later.0);
            prop_assert_eq!(later.0, 1.0);
            for reopen_s in reopen_at_s {
                prop_assert_eq!(scale.value_and_rate_at(*reopen_s).0, 1.0);
                let (open, rate) = scale.value_and_rate_at(reopen_s + over_s + fraction * hold_s);
                prop_assert!((open - from).abs() < 1e-9 && rate.abs() < 1e-9);
            }
            prop_assert_eq!(scale.value_and_rate_at(scale.closing_end_s().unwrap() + 1e-6 + fraction), (1.0, 0.0));
        }
    }

    #[test]
    fn sine_scale_has_known_values_at_its_quarters() {
        let scale = Scale::Sine { mean: 1.5, amplitude: 0.4, period_s: 8.0 };
        let (at_peak, rate) = scale.value_and_rate_at(2.0);
        assert!((at_peak - 1.9).abs() < 1e-12 && rate.abs() < 1e-12, "{at_peak}, {rate}");
        let (middle, rate) = scale.value_and_rate_at(4.0);
        assert!((middle - 1.5).abs() < 1e-12 && (rate + 0.1 * PI).abs() < 1e-12, "{rate}");
        assert_eq!(
            (scale.value_range(), scale.final_or_mean_value(), scale.closing_end_s()),
            ([1.1, 1.9], 1.5, None)
        );
    }

    #[test]
    fn closing_scale_is_half_open_and_fastest_half_way() {
        let scale =
            Scale::Closing { from: 2.0, hold_s: 10.0, over_s: 4.0, reopen_at_s: vec![20.0] };
        let (middle, rate) = scale.value_and_rate_at(12.0);
        assert!((middle - 1.5).abs() < 1e-12 && (rate + PI / 8.0).abs() < 1e-12, "{rate}");
        let (middle, rate) = scale.value_and_rate_at(22.0);
        assert!((middle - 1.5).abs() < 1e-12 && (rate - PI / 8.0).abs() < 1e-12, "{rate}");
        assert_eq!((scale.value_range(), scale.closing_end_s()), ([1.0, 2.0], Some(38.0)));
    }
}
