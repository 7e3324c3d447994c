//! Why a bridge drops samples and refuses connections: the places of [`crate::message::BridgeHeader::dropped`].

use crate::message::BridgeHeader;
use crate::numbered;

numbered! {
    /// Why a sample from another host, or for one, was dropped, or a connection refused. Each has one reason.
    Dropped: usize {
        /// It is no frame.
        Garbage = 0 "garbage",
        /// Of another version of what is on the wire.
        Version = 1 "version",
        /// Its messages have another layout: another build sent it.
        Layout = 2 "layout",
        /// Of another scenario or fleet file.
        Experiment = 3 "experiment",
        /// Under the key of another host than the sender.
        Owner = 4 "owner",
        /// Not after what came before it, or of a bridge that was replaced since.
        Replayed = 5 "replayed",
        /// Older than the bound of its topic.
        Old = 6 "old",
        /// No robot that works could have said it.
        Implausible = 7 "implausible",
        /// The answer to a sample that this bridge did not deliver.
        Unmatched = 8 "unmatched",
        /// Its time cannot be told: the clocks were not yet compared, or it would go back.
        Clock = 9 "clock",
        /// The scenario keeps these hosts apart for now.
        Partition = 10 "partition",
        /// A connection whose certificate is missing, or not by the authority of the fleet, or not for that address.
        Certificate = 11 "certificate",
        /// A connection whose certificate does not hold yet, or not any more.
        Expired = 12 "expired",
        /// A connection with a certificate of a name that no host of the fleet has: nothing of it is taken.
        Stranger = 13 "stranger",
        /// A message under a key that its sender may not write.
        Denied = 14 "denied",
        /// A connection that did not come about: garbage, silence, or another version of TLS.
        Handshake = 15 "handshake",
    }
}

/// How much a bridge dropped and refused, with the words for why, without what was none.
pub fn in_words(header: &BridgeHeader) -> impl Iterator<Item = (&'static str, u64)> {
    numbered::in_words(Dropped::ALL.map(Dropped::word), &header.dropped)
}
