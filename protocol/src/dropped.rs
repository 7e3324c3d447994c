//! Why a bridge drops samples and refuses connections: the places of [`crate::message::BridgeHeader::dropped`].

use crate::message::BridgeHeader;

/// Why a sample from another host, or for one, was dropped, or a connection refused. Each has one reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Dropped {
    /// It is no frame.
    Garbage = 0,
    /// Of another version of what is on the wire.
    Version = 1,
    /// Its messages have another layout: another build sent it.
    Layout = 2,
    /// Of another scenario or fleet file.
    Experiment = 3,
    /// Under the key of another host than the sender.
    Owner = 4,
    /// Not after what came before it, or of a bridge that was replaced since.
    Replayed = 5,
    /// Older than the bound of its topic.
    Old = 6,
    /// No robot that works could have said it.
    Implausible = 7,
    /// The answer to a sample that this bridge did not deliver.
    Unmatched = 8,
    /// Its time cannot be told: the clocks were not yet compared, or it would go back.
    Clock = 9,
    /// The scenario keeps these hosts apart for now.
    Partition = 10,
    /// A connection whose certificate is missing, or not by the authority of the fleet, or not for that address.
    Certificate = 11,
    /// A connection whose certificate does not hold yet, or not any more.
    Expired = 12,
    /// A connection with a certificate of a name that no host of the fleet has: nothing of it is taken.
    Stranger = 13,
    /// A message under a key that its sender may not write.
    Denied = 14,
    /// A connection that did not come about: garbage, silence, or another version of TLS.
    Handshake = 15,
}

impl Dropped {
    /// All, in the order of their numbers.
    pub const ALL: [Dropped; 16] = [
        Dropped::Garbage,
        Dropped::Version,
        Dropped::Layout,
        Dropped::Experiment,
        Dropped::Owner,
        Dropped::Replayed,
        Dropped::Old,
        Dropped::Implausible,
        Dropped::Unmatched,
        Dropped::Clock,
        Dropped::Partition,
        Dropped::Certificate,
        Dropped::Expired,
        Dropped::Stranger,
        Dropped::Denied,
        Dropped::Handshake,
    ];

    /// The word for it in files.
    pub fn word(self) -> &'static str {
        match self {
            Dropped::Garbage => "garbage",
            Dropped::Version => "version",
            Dropped::Layout => "layout",
            Dropped::Experiment => "experiment",
            Dropped::Owner => "owner",
            Dropped::Replayed => "replayed",
            Dropped::Old => "old",
            Dropped::Implausible => "implausible",
            Dropped::Unmatched => "unmatched",
            Dropped::Clock => "clock",
            Dropped::Partition => "partition",
            Dropped::Certificate => "certificate",
            Dropped::Expired => "expired",
            Dropped::Stranger => "stranger",
            Dropped::Denied => "denied",
            Dropped::Handshake => "handshake",
        }
    }
}

/// How much a bridge dropped and refused, with the words for why, without what was none.
pub fn in_words(header: &BridgeHeader) -> impl Iterator<Item = (&'static str, u64)> {
    let all = Dropped::ALL.into_iter().map(|why| (why.word(), header.dropped[why as usize]));
    all.filter(|&(_, count)| count > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_has_a_word_and_a_place_of_its_own() {
        let counts = std::array::from_fn(|place| place as u64 + 1);
        let header = BridgeHeader { dropped: counts, ..BridgeHeader::default() };
        let words: Vec<_> = in_words(&header).collect();
        assert!(words.iter().map(|&(_, count)| count).eq(counts), "{words:?}");
        let different: std::collections::BTreeSet<_> = words.iter().map(|(word, _)| word).collect();
        assert_eq!(different.len(), Dropped::ALL.len());
    }
}
