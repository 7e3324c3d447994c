//! Reasons for which a bridge drops samples and refuses connections: the indices of
//! [`crate::message::BridgeHeader::dropped`].

use crate::message::BridgeHeader;
use crate::wire_enum;

wire_enum! {
    /// Reason for which a bridge dropped a sample from or for another host, or refused a connection. Each has
    /// exactly one.
    DropReason: usize {
        /// The bytes are not a frame.
        Garbage = 0 "garbage",
        /// Another version of the wire format.
        Version = 1 "version",
        /// Another layout of the messages: the sender is another build.
        Layout = 2 "layout",
        /// Another scenario or fleet file.
        OtherExperiment = 3 "experiment",
        /// The key belongs to a host other than the sender.
        WrongSender = 4 "owner",
        /// A frame that is not newer than the last one, or was sent by a bridge that has been replaced.
        Replayed = 5 "replayed",
        /// Older than the limit of its topic.
        Old = 6 "old",
        /// Values that no working robot sends.
        Implausible = 7 "implausible",
        /// A command in response to a sample that this bridge did not deliver.
        Unmatched = 8 "unmatched",
        /// The time cannot be converted: the clocks have not been compared yet, or it would run backwards.
        UnconvertibleTime = 9 "clock",
        /// A planned partition separates the two hosts.
        Partition = 10 "partition",
        /// A connection whose certificate is missing, is not signed by the fleet's authority, or has another
        /// address.
        Certificate = 11 "certificate",
        /// A connection whose certificate is not valid yet, or no longer valid.
        Expired = 12 "expired",
        /// A connection whose certificate has a name that is not a host of the fleet; nothing of it is accepted.
        UnknownHost = 13 "stranger",
        /// A message under a key that its sender may not write.
        Denied = 14 "denied",
        /// A connection that failed to establish: garbage, a timeout, or another version of TLS.
        Handshake = 15 "handshake",
    }
}

/// Returns the nonzero counts of dropped samples and refused connections, with their keywords.
pub fn dropped_counts(header: &BridgeHeader) -> impl Iterator<Item = (&'static str, u64)> {
    wire_enum::nonzero_counts(DropReason::ALL.map(DropReason::keyword), &header.dropped)
}
