//! Seeded pseudo-random numbers, identical on every machine. Not cryptographically secure.

/// Increment of the state of [`SplitMix64`] per drawn word (the golden gamma).
const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64 pseudo-random number generator.
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// Creates a generator with the given seed.
    pub fn new(seed: u64) -> SplitMix64 {
        SplitMix64(seed)
    }

    /// Returns the next uniformly distributed 64-bit word.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN_GAMMA);
        let bits = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ bits >> 31
    }

    /// Returns a uniformly distributed number in [0, 1).
    pub fn draw_unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a number between `minimum` and `maximum`, both inclusive. Computed by a remainder, so the
    /// distribution is only approximately uniform. Requires `minimum <= maximum`.
    pub fn draw_between(&mut self, minimum: u64, maximum: u64) -> u64 {
        minimum + self.next_u64() % (maximum - minimum + 1)
    }

    /// Returns `true` with the given probability.
    pub fn draw_bool(&mut self, probability: f64) -> bool {
        self.draw_unit() < probability
    }
}

/// Returns draw number `counter` of the stream `seed`, uniformly distributed in [0, 1), without computing the
/// earlier draws.
pub fn draw_unit_by_number(seed: u64, counter: u64) -> f64 {
    let first = SplitMix64::new(seed).next_u64();
    SplitMix64::new(first.wrapping_add(counter.wrapping_sub(1).wrapping_mul(GOLDEN_GAMMA)))
        .draw_unit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A draw by number does not depend on earlier calls and equals the sequential draw.
        #[test]
        fn draw_by_number_equals_sequential_draw(seed: u64, counter in 0..50u64) {
            let mut one_by_one = SplitMix64::new(SplitMix64::new(seed).next_u64());
            for number in 1..=counter {
                prop_assert_eq!(draw_unit_by_number(seed, number).to_bits(), one_by_one.draw_unit().to_bits());
            }
        }

        /// All 53 bits are kept: words that differ in their upper 53 bits give different numbers.
        #[test]
        fn unit_keeps_the_upper_53_bits_of_its_word(seed: u64) {
            let word = SplitMix64::new(seed).next_u64();
            let unit = SplitMix64::new(seed).draw_unit();
            prop_assert!((0.0..1.0).contains(&unit));
            prop_assert_eq!((unit * 2f64.powi(64)) as u64, word & !0x7ff);
        }
    }

    #[test]
    fn words_match_the_published_generator() {
        let mut random = SplitMix64::new(1_234_567);
        let words = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert_eq!(words.map(|_| random.next_u64()), words);
    }

    #[test]
    fn between_and_chance_have_the_requested_frequencies() {
        let mut random = SplitMix64::new(5);
        let mut drawn = [0; 4];
        for _ in 0..4000 {
            drawn[random.draw_between(7, 10) as usize - 7] += 1;
        }
        assert!(drawn.iter().all(|&times| (850..1150).contains(&times)), "{drawn:?}");
        assert_eq!(random.draw_between(9, 9), 9);
        let count = (0..4000).filter(|_| random.draw_bool(0.3)).count();
        assert!((1050..1350).contains(&count), "{count}");
        assert!(!random.draw_bool(0.0) && random.draw_bool(1.0));
    }
}
