//! Random numbers from a seed: the same on every machine. Not for secrets.

/// What the state of [`SplitMix64`] grows by with each word.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Words drawn one after the other, all equally likely. (SplitMix64)
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// Before the first word of this seed.
    pub fn new(seed: u64) -> SplitMix64 {
        SplitMix64(seed)
    }

    /// The next word.
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        let bits = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ bits >> 31
    }

    /// From 0 to below 1, all equally likely.
    pub fn unit(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// From `least` to `most`, both included.
    pub fn between(&mut self, least: u64, most: u64) -> u64 {
        least + self.word() % (most - least + 1)
    }

    /// Whether something of this probability happens.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }
}

/// The draw number `counter` of `seed`, whatever was drawn before: from 0 to below 1, all equally
/// likely.
pub fn draw(seed: u64, counter: u64) -> f64 {
    let first = SplitMix64::new(seed).word();
    SplitMix64::new(first.wrapping_add(counter.wrapping_sub(1).wrapping_mul(GOLDEN))).unit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// So a draw needs none of those before it, and is what they would lead to.
        #[test]
        fn draws_by_number_are_those_drawn_one_after_the_other(seed: u64, counter in 0..50u64) {
            let mut one_by_one = SplitMix64::new(SplitMix64::new(seed).word());
            for number in 1..=counter {
                prop_assert_eq!(draw(seed, number).to_bits(), one_by_one.unit().to_bits());
            }
        }

        /// All 53 bits of it: no two words of different upper bits give the same number.
        #[test]
        fn a_unit_is_its_word_over_2_to_the_64_cut_to_53_bits(seed: u64) {
            let word = SplitMix64::new(seed).word();
            let unit = SplitMix64::new(seed).unit();
            prop_assert!((0.0..1.0).contains(&unit));
            prop_assert_eq!((unit * 2f64.powi(64)) as u64, word & !0x7ff);
        }
    }

    #[test]
    fn words_are_those_of_the_published_generator() {
        let mut random = SplitMix64::new(1_234_567);
        let words = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert_eq!(words.map(|_| random.word()), words);
    }

    #[test]
    fn numbers_between_two_are_all_of_them_and_chances_come_as_often_as_asked_for() {
        let mut random = SplitMix64::new(5);
        let mut drawn = [0; 4];
        for _ in 0..4000 {
            drawn[random.between(7, 10) as usize - 7] += 1;
        }
        assert!(drawn.iter().all(|&times| (850..1150).contains(&times)), "{drawn:?}");
        assert_eq!(random.between(9, 9), 9);
        let happened = (0..4000).filter(|_| random.chance(0.3)).count();
        assert!((1050..1350).contains(&happened), "{happened}");
        assert!(!random.chance(0.0) && random.chance(1.0));
    }
}
