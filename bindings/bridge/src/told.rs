//! What the robots of a host tell the supervisor, on its way to the plant's host: nothing of it is lost
//! while that host is away, unless it is away for very long.
//!
//! Each record has a number. They are sent until they are confirmed, from the oldest one on.

use std::collections::VecDeque;

use protocol::message::Plain;

/// More than this is not kept while nobody confirms, bytes.
const KEPT_BYTES_MAX: usize = 32 << 20;
/// At most this much is sent at once, bytes: a frame in one piece.
const BATCH_BYTES_MAX: usize = 48 << 10;
/// What was sent and not confirmed for this long is sent again, ns.
const AGAIN_AFTER_NS: u64 = 300_000_000;

/// What a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Kind {
    /// A status.
    Status = 0,
    /// A batch of latencies.
    Latency = 1,
}

/// One record: which robot, by its place from 0, told what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// What it is.
    pub kind: Kind,
    /// Whose.
    pub robot: usize,
    /// Header and rows, as they lie in memory.
    pub content: Vec<u8>,
}

/// Records that are not confirmed yet.
#[derive(Debug, Default)]
pub struct Log {
    records: VecDeque<Record>,
    bytes: usize,
    /// The number of the first of them.
    first: u64,
    /// The number after the last one that was sent.
    sent: u64,
    /// Since when the first of them waits for being confirmed, by its number, ns.
    waits: (u64, u64),
    /// How many were dropped because nobody confirmed for too long.
    pub dropped: u64,
}

impl Log {
    /// One more.
    pub fn push(&mut self, record: Record) {
        self.bytes += record.content.len();
        self.records.push_back(record);
        while self.bytes > KEPT_BYTES_MAX {
            self.forget_first();
            self.dropped += 1;
        }
    }

    /// All before this number have arrived.
    pub fn confirm(&mut self, next: u64) {
        while self.first < next && !self.records.is_empty() {
            self.forget_first();
        }
    }

    fn forget_first(&mut self) {
        if let Some(record) = self.records.pop_front() {
            self.bytes -= record.content.len();
            self.first += 1;
        }
    }

    /// How many are not confirmed.
    pub fn unconfirmed(&self) -> usize {
        self.records.len()
    }

    /// What is to be sent now: the number of the oldest record that is kept, that of the first one that follows,
    /// and the records.
    pub fn batch(&mut self, now_ns: u64) -> Option<Vec<u8>> {
        let mut next = self.sent.max(self.first);
        let (waiting, since_ns) = self.waits;
        if next == self.first || waiting != self.first {
            self.waits = (self.first, now_ns);
        } else if now_ns >= since_ns + AGAIN_AFTER_NS {
            next = self.first;
            self.waits = (self.first, now_ns);
        }
        let skipped = (next - self.first) as usize;
        let mut content = [self.first.bytes(), next.bytes()].concat();
        let mut count = 0;
        for record in self.records.iter().skip(skipped) {
            if count > 0 && content.len() + record.content.len() > BATCH_BYTES_MAX {
                break;
            }
            for number in [record.kind as u64, record.robot as u64, record.content.len() as u64] {
                content.extend(number.bytes());
            }
            content.extend(&record.content);
            count += 1;
        }
        self.sent = next + count;
        (count > 0).then_some(content)
    }
}

/// What arrived of another host's log.
#[derive(Debug, Default)]
pub struct Heard {
    /// Of which bridge, and the number expected next.
    next: Option<(u64, u64)>,
}

impl Heard {
    /// The new records of a batch of that bridge; none if some before it are missing.
    pub fn take(&mut self, boot: u64, batch: &[u8]) -> Option<Vec<Record>> {
        let (oldest, rest) = number(batch)?;
        let (first, mut rest) = number(rest)?;
        let mut records = Vec::new();
        while !rest.is_empty() {
            let (kind, after) = number(rest)?;
            let (robot, after) = number(after)?;
            let (length, after) = number(after)?;
            let (content, after) = after.split_at_checked(usize::try_from(length).ok()?)?;
            let kind = [Kind::Status, Kind::Latency].into_iter().find(|&k| k as u64 == kind)?;
            let (robot, content) = (usize::try_from(robot).ok()?, content.to_vec());
            records.push(Record { kind, robot, content });
            rest = after;
        }
        let next = match self.next {
            Some((known, next)) if known == boot => next,
            // Of a bridge that was not heard before, or by a bridge that is new itself.
            _ => oldest,
        };
        // What was dropped there does not come any more.
        let next = next.max(oldest);
        if first > next {
            self.next = Some((boot, next));
            return Some(Vec::new());
        }
        let end = first.checked_add(records.len() as u64)?;
        self.next = Some((boot, next.max(end)));
        records.drain(..((next - first) as usize).min(records.len()));
        Some(records)
    }

    /// What is to be confirmed: the bridge, and the number expected next.
    pub fn confirmed(&self) -> Option<[u64; 2]> {
        self.next.map(|(boot, next)| [boot, next])
    }
}

fn number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn record(n: usize) -> Record {
        let kind = if n.is_multiple_of(2) { Kind::Status } else { Kind::Latency };
        Record { kind, robot: n, content: vec![n as u8; n % 50] }
    }

    proptest! {
        /// Batches and confirmations are lost at random: each record arrives once and in order.
        #[test]
        fn what_is_told_arrives_once_and_in_order(
            lost in proptest::collection::vec(any::<[bool; 2]>(), 40),
            each in 1usize..30,
        ) {
            let (mut log, mut heard) = (Log::default(), Heard::default());
            let (mut told, mut arrived, mut now_ns) = (0, Vec::new(), 0);
            for [batch_lost, confirmation_lost] in lost.into_iter().chain([[false; 2]; 60]) {
                now_ns += 50_000_000;
                if told < 40 * each {
                    (told..told + each).for_each(|n| log.push(record(n)));
                    told += each;
                }
                if let Some(batch) = log.batch(now_ns).filter(|_| !batch_lost) {
                    arrived.extend(heard.take(9, &batch).unwrap());
                }
                if let Some([boot, next]) = heard.confirmed().filter(|_| !confirmation_lost) {
                    prop_assert_eq!(boot, 9);
                    log.confirm(next);
                }
            }
            prop_assert_eq!(log.unconfirmed(), 0);
            prop_assert_eq!(arrived, (0..told).map(record).collect::<Vec<_>>());
        }

        #[test]
        fn garbage_is_never_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = Heard::default().take(1, &bytes);
        }
    }

    #[test]
    fn after_an_outage_all_arrives_although_more_is_told_all_the_time() {
        let (mut log, mut heard) = (Log::default(), Heard::default());
        let (mut arrived, mut now_ns) = (Vec::new(), 0);
        for n in 0..400 {
            now_ns += 20_000_000;
            log.push(Record { content: vec![0; 2_000], ..record(n) });
            let batch = log.batch(now_ns);
            let is_down = (100..300).contains(&n);
            if let Some(batch) = batch.filter(|_| !is_down) {
                arrived.extend(heard.take(9, &batch).unwrap());
                log.confirm(heard.confirmed().unwrap()[1]);
            }
        }
        let robots = arrived.iter().map(|record| record.robot);
        assert!(robots.eq(0..400) && log.unconfirmed() == 0);
    }

    #[test]
    fn what_nobody_confirms_does_not_grow_without_bound() {
        let mut log = Log::default();
        let large = |robot| Record { kind: Kind::Latency, robot, content: vec![0; 1 << 20] };
        (0..40).for_each(|robot| log.push(large(robot)));
        assert_eq!((log.unconfirmed(), log.dropped), (32, 8));
        let batch = log.batch(0).unwrap();
        let records = Heard::default().take(1, &batch).unwrap();
        assert_eq!(records[0].robot, 8);
    }

    #[test]
    fn a_log_that_begins_anew_is_heard_from_its_beginning() {
        let (mut old, mut new, mut heard) = (Log::default(), Log::default(), Heard::default());
        (0..5).for_each(|n| old.push(record(n)));
        assert_eq!(heard.take(1, &old.batch(0).unwrap()).unwrap().len(), 5);
        new.push(record(7));
        assert_eq!(heard.take(2, &new.batch(0).unwrap()).unwrap(), [record(7)]);
        assert_eq!(heard.confirmed(), Some([2, 1]));
    }
}
