//! Signals of a control law: named numbers that it records about itself for the results of the run, such as a cost.
//!
//! The names are declared with the law. A robot reports the values of a sample with its status; no other robot receives
//! them.

/// Maximum number of signals of a law.
pub const SIGNALS_MAX: usize = 16;

/// Values that a law has recorded at one sample, in the order in which the law declares its signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalValues {
    /// Bit i is set if signal i was recorded.
    recorded_bits: u64,
    values: [f64; SIGNALS_MAX],
}

impl Default for SignalValues {
    fn default() -> SignalValues {
        SignalValues::NONE
    }
}

impl SignalValues {
    /// Values of a sample at which the law recorded no signal.
    pub const NONE: SignalValues = SignalValues { recorded_bits: 0, values: [0.0; SIGNALS_MAX] };

    /// Creates the values from their form in a status message. A value that is not finite is left out.
    pub fn from_parts(recorded: u64, values: [f64; SIGNALS_MAX]) -> SignalValues {
        let mut signals = SignalValues::NONE;
        let recorded_values =
            values.into_iter().enumerate().filter(|(i, _)| recorded >> i & 1 == 1);
        recorded_values.for_each(|(i, value)| signals.set(i, value));
        signals
    }

    /// Returns the values in the form of a status message: a bit for each recorded signal, and all values.
    pub fn parts(&self) -> (u64, [f64; SIGNALS_MAX]) {
        (self.recorded_bits, self.values)
    }

    /// Records signal `i`. Does nothing if the value is not finite.
    ///
    /// # Panics
    ///
    /// If `i` is at least [`SIGNALS_MAX`].
    pub fn set(&mut self, i: usize, value: f64) {
        if value.is_finite() {
            self.values[i] = value;
            self.recorded_bits |= 1 << i;
        }
    }

    /// Returns whether no signal was recorded.
    pub fn is_empty(&self) -> bool {
        self.recorded_bits == 0
    }

    /// Returns the recorded values with the indices of their signals.
    pub fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        let SignalValues { recorded_bits: recorded, values } = *self;
        values.into_iter().enumerate().filter(move |(i, _)| recorded >> i & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_round_trip_and_infinite_ones_are_left_out() {
        let mut values = SignalValues::NONE;
        assert!(values.is_empty());
        values.set(SIGNALS_MAX - 1, -2.5);
        values.set(3, f64::NAN);
        values.set(0, 0.0);
        let (recorded, mut numbers) = values.parts();
        assert_eq!(SignalValues::from_parts(recorded, numbers), values);
        let found: Vec<(usize, f64)> = values.iter().collect();
        assert_eq!(found, [(0, 0.0), (SIGNALS_MAX - 1, -2.5)]);
        numbers[0] = f64::INFINITY;
        let left: Vec<usize> =
            SignalValues::from_parts(recorded, numbers).iter().map(|(i, _)| i).collect();
        assert_eq!(left, [SIGNALS_MAX - 1]);
    }
}
