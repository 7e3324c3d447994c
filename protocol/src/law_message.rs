//! Messages that control laws send with their beacons: format, checks, and encoding.
//!
//! A message is a sequence of bytes, or named arrays of 64-bit floating-point numbers: little-endian, row by row, one
//! array after the other in the order of the format. The format is declared with the law and is static, so that the
//! receivers of a message know it.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::message::Beacon;

/// Maximum length of a message, bytes.
pub const MESSAGE_BYTES_MAX: usize = 1 << 16;

/// Number of beacons that are queued for a receiver if the sender's law sends messages; then the oldest one is dropped.
pub const MESSAGE_QUEUE_LENGTH: usize = 16;

/// Format of the messages of a law.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageFormat {
    /// Maximum length, bytes. With arrays, it is the exact length.
    pub bytes_max: usize,
    /// Arrays of numbers in the order in which a message contains them; empty for bytes without a structure.
    #[serde(default, rename = "array", skip_serializing_if = "<[_]>::is_empty")]
    pub arrays: Cow<'static, [MessageArray]>,
}

/// Array of numbers in a message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageArray {
    /// Key of the array.
    pub name: Cow<'static, str>,
    /// Length of each dimension; empty for a single number.
    pub shape: Cow<'static, [usize]>,
}

impl MessageArray {
    /// Returns the number of numbers.
    pub fn count(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Reason why bytes are not a message of a format.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum MessageFlaw {
    /// The length does not fit the format.
    #[error("the message has {found} bytes, expected {expected}")]
    WrongLength { found: usize, expected: String },
    /// A number is NaN or infinite.
    #[error("the message has {number} in `{array}`, expected finite numbers")]
    NotFinite { array: String, number: String },
    /// An array of the format is not given.
    #[error("the message has no `{array}`, expected {expected}")]
    MissingArray { array: String, expected: String },
    /// An array is not in the format.
    #[error("the message has `{array}`, which is not declared, expected {expected}")]
    UnknownArray { array: String, expected: String },
    /// An array has another number of numbers than the format.
    #[error("`{array}` has {found} numbers, expected {expected}")]
    WrongCount { array: String, found: usize, expected: usize },
    /// The law declares no messages.
    #[error(
        "the law declares no message, expected `message = {{ NAME = SHAPE }}` or `message_bytes_max = N` in its \
         table [laws.NAME]"
    )]
    UndeclaredMessage,
    /// The law does not declare that it withholds beacons.
    #[error(
        "the law withholds its beacon and does not declare that, expected `withholds = true` in its table \
         [laws.NAME]"
    )]
    UndeclaredWithholding,
}

impl MessageFormat {
    /// Returns the format of messages of 1 to `bytes_max` bytes without a structure.
    pub const fn with_bytes(bytes_max: usize) -> MessageFormat {
        MessageFormat { bytes_max, arrays: Cow::Borrowed(&[]) }
    }

    /// Returns the format of messages that consist of these arrays.
    pub fn with_arrays(arrays: Vec<MessageArray>) -> MessageFormat {
        let bytes_max = 8 * arrays.iter().map(MessageArray::count).sum::<usize>();
        MessageFormat { bytes_max, arrays: arrays.into() }
    }

    /// Returns whether the messages are bytes without a structure.
    pub fn is_bytes(&self) -> bool {
        self.arrays.is_empty()
    }

    /// Returns the arrays as the scenario declares them, for messages.
    pub fn describe(&self) -> String {
        if self.is_bytes() {
            return format!("1 to {} bytes", self.bytes_max);
        }
        let array = |array: &MessageArray| match &array.shape[..] {
            [] => format!("{} = 1", array.name),
            [count] => format!("{} = {count}", array.name),
            shape => format!("{} = {shape:?}", array.name),
        };
        let arrays: Vec<String> = self.arrays.iter().map(array).collect();
        format!("{{ {} }}", arrays.join(", "))
    }

    /// Checks the bytes of a message.
    ///
    /// # Errors
    ///
    /// The length is wrong, or a number is not finite.
    pub fn check_bytes(&self, bytes: &[u8]) -> Result<(), MessageFlaw> {
        let found = bytes.len();
        if self.is_bytes() {
            let is_valid_length = (1..=self.bytes_max).contains(&found);
            let expected = format!("1 to {}", self.bytes_max);
            return if is_valid_length {
                Ok(())
            } else {
                Err(MessageFlaw::WrongLength { found, expected })
            };
        }
        if found != self.bytes_max {
            let expected = format!("{}: {}", self.bytes_max, self.describe());
            return Err(MessageFlaw::WrongLength { found, expected });
        }
        for (array, numbers) in self.split_arrays(bytes) {
            let mut numbers = numbers.iter().map(|number| f64::from_le_bytes(*number));
            // All numbers without a branch, which is faster than up to the first that is not finite.
            if numbers.clone().fold(true, |all_finite, number| all_finite & number.is_finite()) {
                continue;
            }
            let number = numbers.find(|number| !number.is_finite()).unwrap_or_default();
            let (array, number) = (array.name.to_string(), number.to_string());
            return Err(MessageFlaw::NotFinite { array, number });
        }
        Ok(())
    }

    /// Encodes a message from the numbers of each array, row by row.
    ///
    /// # Errors
    ///
    /// An array is missing or unknown, has another number of numbers, or a number is not finite.
    pub fn encode(&self, given: &[(&str, &[f64])]) -> Result<Arc<[u8]>, MessageFlaw> {
        let is_declared = |name: &str| self.arrays.iter().any(|array| array.name == name);
        if let Some((name, _)) = given.iter().find(|(name, _)| !is_declared(name)) {
            return Err(MessageFlaw::UnknownArray {
                array: (*name).to_owned(),
                expected: self.describe(),
            });
        }
        let mut bytes = Vec::with_capacity(self.bytes_max);
        for array in self.arrays.iter() {
            let name = || array.name.to_string();
            let found = given.iter().find(|(given, _)| *given == array.name);
            let (_, numbers) = found.ok_or_else(|| MessageFlaw::MissingArray {
                array: name(),
                expected: self.describe(),
            })?;
            let (found, expected) = (numbers.len(), array.count());
            if found != expected {
                return Err(MessageFlaw::WrongCount { array: name(), found, expected });
            }
            numbers.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
        }
        self.check_bytes(&bytes)?;
        Ok(bytes.into())
    }

    /// Returns the arrays of a message of this format, each with its numbers, row by row.
    pub fn decode_arrays<'a>(
        &'a self,
        bytes: &'a [u8],
    ) -> impl Iterator<Item = (&'a MessageArray, Vec<f64>)> {
        self.split_arrays(bytes).map(|(array, numbers)| (array, decode_numbers(numbers)))
    }

    /// Returns the arrays of a message of this format, each with the bytes of its numbers.
    fn split_arrays<'a>(
        &'a self,
        bytes: &'a [u8],
    ) -> impl Iterator<Item = (&'a MessageArray, &'a [[u8; 8]])> {
        let mut rest = bytes;
        self.arrays.iter().map(move |array| {
            let (array_bytes, remaining) = rest.split_at((8 * array.count()).min(rest.len()));
            rest = remaining;
            let (numbers, _) = array_bytes.as_chunks();
            (array, numbers)
        })
    }
}

fn decode_numbers(numbers: &[[u8; 8]]) -> Vec<f64> {
    numbers.iter().map(|number| f64::from_le_bytes(*number)).collect()
}

/// Message of an in-neighbor, as passed to a law.
#[derive(Debug, Clone, PartialEq)]
pub struct ReceivedMessage {
    /// Format of the sender's law.
    pub format: Arc<MessageFormat>,
    /// Encoded numbers, or bytes without a structure.
    pub bytes: Arc<[u8]>,
    /// Age of the message, s. In real time it is negative for a message newer than the sample.
    pub age_s: f64,
}

impl ReceivedMessage {
    /// Returns the numbers of an array, row by row; `None` if the format has no such array.
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let mut arrays = self.format.split_arrays(&self.bytes);
        arrays.find(|(array, _)| array.name == name).map(|(_, numbers)| decode_numbers(numbers))
    }
}

/// Choice of a law of what to send to the out-neighbors with an answer.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum SendDecision {
    /// The beacon without a message.
    #[default]
    Beacon,
    /// The beacon with this message.
    Message(Arc<[u8]>),
    /// No beacon: the law withholds it, as in event-triggered control.
    Withheld,
}

impl SendDecision {
    /// Checks a law's choice against what the law declares.
    ///
    /// # Errors
    ///
    /// The message does not have the declared format, or the law does not declare what it does.
    #[inline]
    pub fn check(
        &self,
        format: Option<&MessageFormat>,
        withholds: bool,
    ) -> Result<(), MessageFlaw> {
        match self {
            SendDecision::Beacon => Ok(()),
            SendDecision::Message(bytes) => {
                format.ok_or(MessageFlaw::UndeclaredMessage)?.check_bytes(bytes)
            }
            SendDecision::Withheld if withholds => Ok(()),
            SendDecision::Withheld => Err(MessageFlaw::UndeclaredWithholding),
        }
    }

    /// Returns the message, if there is one, and whether the beacon leaves.
    #[inline]
    pub fn into_message(self) -> (Option<Arc<[u8]>>, bool) {
        match self {
            SendDecision::Beacon => (None, true),
            SendDecision::Message(bytes) => (Some(bytes), true),
            SendDecision::Withheld => (None, false),
        }
    }
}

/// A beacon, and the message that travels with it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Broadcast {
    /// State of the sender.
    pub beacon: Beacon,
    /// Message of the sender's law, if it sends one with this beacon.
    pub message: Option<Arc<[u8]>>,
}

impl From<Beacon> for Broadcast {
    fn from(beacon: Beacon) -> Broadcast {
        Broadcast { beacon, message: None }
    }
}

/// Beacons and messages that one incarnation of a robot has sent, and messages that were dropped before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SentCounts {
    /// Number of beacons.
    pub beacons: u64,
    /// Number of messages.
    pub messages: u64,
    /// Hash of all messages and their ticks; 0 without messages.
    pub message_hash: u64,
    /// Number of messages of in-neighbors that it did not process: a queue was full, or it was frozen.
    pub dropped_messages: u64,
}

impl SentCounts {
    /// Counts a beacon, and the message with it.
    #[inline]
    pub fn count_sent(&mut self, broadcast: &Broadcast) {
        self.beacons += 1;
        if let Some(bytes) = &broadcast.message {
            self.messages += 1;
            let hash = hash_bytes(self.message_hash, &broadcast.beacon.tick.to_le_bytes());
            self.message_hash = hash_words(hash, bytes);
        }
    }

    /// Returns the counts of two consecutive incarnations together.
    pub fn plus_next_incarnation(self, next: SentCounts) -> SentCounts {
        SentCounts {
            beacons: self.beacons + next.beacons,
            messages: self.messages + next.messages,
            dropped_messages: self.dropped_messages.saturating_add(next.dropped_messages),
            message_hash: match (self.messages, next.messages) {
                (_, 0) => self.message_hash,
                (0, _) => next.message_hash,
                _ => hash_bytes(self.message_hash, &next.message_hash.to_le_bytes()),
            },
        }
    }
}

/// Counter of the messages of one neighbor that are missing between those received.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GapCounter {
    /// Incarnation and message number of the newest beacon; `None` before the first.
    newest_incarnation_and_number: Option<(u64, u64)>,
}

impl GapCounter {
    /// Records a received beacon, and returns the number of messages sent between it and the newest before it. Beacons
    /// before the first one, and of an earlier incarnation, do not count.
    pub fn record_beacon(&mut self, beacon: &Beacon, has_message: bool) -> u64 {
        let (incarnation, number) = (beacon.incarnation, beacon.messages_sent);
        let previous = self.newest_incarnation_and_number.filter(|(of, _)| *of == incarnation);
        match self.newest_incarnation_and_number {
            Some(newest) if newest > (incarnation, number) => return 0,
            _ => self.newest_incarnation_and_number = Some((incarnation, number)),
        }
        let between = |(_, newest): (u64, u64)| number - newest;
        previous.map_or(0, between).saturating_sub(u64::from(has_message))
    }
}

/// Returns the FNV-1a hash of bytes after those with this hash; 0 stands for none.
pub fn hash_bytes(hash: u64, bytes: &[u8]) -> u64 {
    let start = if hash == 0 { 0xcbf2_9ce4_8422_2325 } else { hash };
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(start, step)
}

/// Returns the hash of a message after those with this hash, computed in steps of 8 bytes: for a message,
/// [`hash_bytes`] would take longer than sending it.
fn hash_words(hash: u64, bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks();
    let step = |hash: u64, word: u64| {
        let product = u128::from(hash ^ word) * 0x9e37_79b9_7f4a_7c15;
        // The upper half too, so that high bits, such as signs, change all bits.
        product as u64 ^ (product >> 64) as u64
    };
    let hash = words.iter().fold(hash, |hash, word| step(hash, u64::from_le_bytes(*word)));
    // The length of the rest distinguishes it from a rest that ends with zeros.
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    last[7] = rest.len() as u8;
    step(hash, u64::from_le_bytes(last))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn format() -> MessageFormat {
        let array = |name: &'static str, shape: &'static [usize]| MessageArray {
            name: name.into(),
            shape: shape.into(),
        };
        MessageFormat::with_arrays(vec![array("bid", &[]), array("plan_m", &[3, 2])])
    }

    #[test]
    fn arrays_round_trip_through_their_bytes() {
        let plan = [0.0, 1.0, 2.0, 3.0, 4.0, -5.5];
        let bytes = format().encode(&[("plan_m", &plan), ("bid", &[7.0])]).unwrap();
        let received = ReceivedMessage { format: format().into(), bytes, age_s: 0.0 };
        assert_eq!(received.bytes.len(), 56);
        assert_eq!(received.numbers("bid"), Some(vec![7.0]));
        assert_eq!(received.numbers("plan_m"), Some(plan.to_vec()));
        assert_eq!(received.numbers("other"), None);
    }

    #[test]
    fn each_wrong_message_has_an_error_that_names_it() {
        let format = format();
        let message = |given: &[(&str, &[f64])]| format.encode(given).unwrap_err().to_string();
        let plan: &[f64] = &[0.0; 6];
        assert_eq!(
            message(&[("bid", &[1.0])]),
            "the message has no `plan_m`, expected { bid = 1, plan_m = [3, 2] }"
        );
        assert_eq!(
            message(&[("bid", &[1.0]), ("plan_m", plan), ("price", &[1.0])]),
            "the message has `price`, which is not declared, expected { bid = 1, plan_m = [3, 2] }"
        );
        assert_eq!(
            message(&[("bid", &[1.0, 2.0]), ("plan_m", plan)]),
            "`bid` has 2 numbers, expected 1"
        );
        assert_eq!(
            message(&[("bid", &[f64::NAN]), ("plan_m", plan)]),
            "the message has NaN in `bid`, expected finite numbers"
        );
        let bytes = MessageFormat::with_bytes(4);
        for wrong in [&[][..], &[0; 5]] {
            let flaw = bytes.check_bytes(wrong).unwrap_err().to_string();
            assert!(flaw.ends_with("expected 1 to 4"), "{flaw}");
        }
        assert_eq!(bytes.check_bytes(&[1; 4]), Ok(()));
        let none = SendDecision::Message([1][..].into()).check(None, true);
        assert_eq!(none, Err(MessageFlaw::UndeclaredMessage));
        assert_eq!(
            SendDecision::Withheld.check(Some(&bytes), false),
            Err(MessageFlaw::UndeclaredWithholding)
        );
    }

    #[test]
    fn hash_of_messages_depends_on_ticks_and_incarnations() {
        let sent = |ticks: &[u64]| {
            let mut counts = SentCounts::default();
            for &tick in ticks {
                let beacon = Beacon { tick, ..Beacon::default() };
                counts.count_sent(&Broadcast { beacon, message: Some([1, 2][..].into()) });
            }
            counts
        };
        assert_ne!(sent(&[1, 2]).message_hash, sent(&[1, 3]).message_hash);
        let both = sent(&[1]).plus_next_incarnation(sent(&[2]));
        assert_eq!((both.messages, both.beacons), (2, 2));
        assert_ne!(both.message_hash, sent(&[2]).plus_next_incarnation(sent(&[1])).message_hash);
        assert_eq!(sent(&[1]).plus_next_incarnation(SentCounts::default()), sent(&[1]));
    }

    #[test]
    fn hash_of_messages_depends_on_each_bit_and_on_the_length() {
        let messages = |bits: std::ops::Range<usize>| {
            bits.map(|bit| {
                let mut bytes = [0; 24];
                bytes[bit / 8] ^= 1 << (bit % 8);
                bytes
            })
        };
        let lengths = (1..=24).map(|length| hash_words(7, &[0; 24][..length]));
        let single = messages(0..192).map(|bytes| hash_words(7, &bytes));
        // The signs of two numbers.
        let mut signs = [0; 24];
        (signs[7], signs[15]) = (0x80, 0x80);
        let all: Vec<u64> = lengths.chain(single).chain([hash_words(7, &signs)]).collect();
        let distinct: std::collections::BTreeSet<u64> = all.iter().copied().collect();
        assert_eq!(distinct.len(), all.len());
    }

    #[test]
    fn gaps_count_messages_within_an_incarnation() {
        let mut gaps = GapCounter::default();
        let mut record = |incarnation, messages_sent, has_message| {
            let beacon = Beacon { incarnation, messages_sent, ..Beacon::default() };
            gaps.record_beacon(&beacon, has_message)
        };
        assert_eq!(record(0, 5, true), 0, "those before the first do not count");
        assert_eq!(record(0, 6, true), 0);
        assert_eq!(record(0, 6, false), 0, "a beacon without a message");
        assert_eq!(record(0, 9, true), 2, "7 and 8");
        assert_eq!(record(0, 12, false), 3, "10 to 12");
        assert_eq!(record(0, 11, true), 0, "overtaken");
        assert_eq!(record(1, 40, true), 0, "another incarnation");
        assert_eq!(record(1, u64::MAX, true), u64::MAX - 41);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]
        #[test]
        fn garbage_is_refused_or_has_the_declared_shape(
            bytes in proptest::collection::vec(any::<u8>(), 0..80),
        ) {
            let format = format();
            if format.check_bytes(&bytes).is_ok() {
                prop_assert_eq!(bytes.len(), format.bytes_max);
                let all_finite = |(_, numbers): (_, Vec<f64>)| numbers.iter().all(|n| n.is_finite());
                prop_assert!(format.decode_arrays(&bytes).all(all_finite));
            }
        }
    }
}
