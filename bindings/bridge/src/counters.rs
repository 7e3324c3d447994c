//! Why samples are dropped, and how many were.

pub use protocol::dropped::Dropped;
use protocol::message::BridgeHeader;

/// What a bridge did since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Frames sent to other hosts.
    pub sent: u64,
    /// Of these, odometry, commands and beacons.
    pub samples_sent: u64,
    /// Frames taken over from other hosts.
    pub taken: u64,
    dropped: [u64; 16],
}

impl Counters {
    /// One more was dropped.
    pub fn drop(&mut self, why: Dropped) {
        self.dropped[why as usize] += 1;
    }

    /// How many were dropped for this reason.
    pub fn dropped(&self, why: Dropped) -> u64 {
        self.dropped[why as usize]
    }

    /// The same, as it is told.
    pub fn told(&self) -> BridgeHeader {
        let Counters { sent, samples_sent, taken, dropped } = *self;
        BridgeHeader { sent, samples_sent, taken, dropped, ..BridgeHeader::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_has_a_word_and_a_place_of_its_own() {
        let mut counters = Counters::default();
        for (place, why) in Dropped::ALL.into_iter().enumerate() {
            assert_eq!(why as usize, place);
            (0..=place).for_each(|_| counters.drop(why));
        }
        let told: Vec<_> = protocol::dropped::in_words(&counters.told()).collect();
        assert_eq!(told.len(), Dropped::ALL.len());
        assert!(told.iter().enumerate().all(|(place, (_, count))| *count == place as u64 + 1));
        let words: std::collections::BTreeSet<_> = told.iter().map(|(word, _)| word).collect();
        assert_eq!(words.len(), told.len());
        assert_eq!(counters.dropped(Dropped::Version), 2);
    }
}
