//! Queue for at-least-once delivery of status and latencies from robots to the supervisor on the plant's host. Records
//! are kept while that host is unreachable, up to a bound.
//!
//! Each record has a sequence number. Records are sent in order until they are acknowledged.

use std::collections::VecDeque;

use protocol::message::Plain;

/// Maximum size of unacknowledged records, bytes. Beyond it, the oldest ones are dropped and counted.
const QUEUED_BYTES_MAX: usize = 32 << 20;
/// Maximum size of a batch, bytes: a frame that zenoh does not fragment.
const BATCH_BYTES_MAX: usize = 48 << 10;
/// Retransmission timeout for unacknowledged records, ns.
const RETRANSMISSION_TIMEOUT_NS: u64 = 300_000_000;

/// Kind of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum RecordKind {
    /// Status of an agent.
    Status = 0,
    /// A batch of latencies.
    Latency = 1,
}

/// One message of a robot to the supervisor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatusRecord {
    /// Kind of the record.
    pub kind: RecordKind,
    /// Index of the robot that sent the record.
    pub robot: usize,
    /// Header and rows, encoded.
    pub content: Vec<u8>,
}

/// Queue of unacknowledged records.
#[derive(Debug, Default)]
pub struct UnackedQueue {
    records: VecDeque<StatusRecord>,
    queued_bytes: usize,
    /// Sequence number of the oldest record.
    oldest_sequence: u64,
    /// Sequence number after the last record sent.
    next_sequence: u64,
    /// Oldest record when the retransmission timer was started, by its sequence number, and that time, ns.
    retransmission_timer: (u64, u64),
    /// Number of records dropped because the queue was full.
    pub dropped_count: u64,
}

impl UnackedQueue {
    /// Appends a record. If the queue then holds more than `QUEUED_BYTES_MAX` bytes, drops the oldest records and
    /// counts them in `dropped`.
    pub fn push(&mut self, record: StatusRecord) {
        self.queued_bytes += record.content.len();
        self.records.push_back(record);
        while self.queued_bytes > QUEUED_BYTES_MAX {
            self.drop_oldest();
            self.dropped_count += 1;
        }
    }

    /// Removes the acknowledged records: all before sequence number `next`.
    pub fn acknowledge(&mut self, next: u64) {
        while self.oldest_sequence < next && !self.records.is_empty() {
            self.drop_oldest();
        }
    }

    fn drop_oldest(&mut self) {
        if let Some(record) = self.records.pop_front() {
            self.queued_bytes -= record.content.len();
            self.oldest_sequence += 1;
        }
    }

    /// Returns the number of unacknowledged records.
    pub fn unacked_count(&self) -> usize {
        self.records.len()
    }

    /// Returns the batch to send now, if any: the sequence number of the oldest record in the queue, that of the
    /// first record in the batch, and the records.
    pub fn next_batch(&mut self, now_ns: u64) -> Option<Vec<u8>> {
        let mut next = self.next_sequence.max(self.oldest_sequence);
        let (waiting, since_ns) = self.retransmission_timer;
        if next == self.oldest_sequence || waiting != self.oldest_sequence {
            self.retransmission_timer = (self.oldest_sequence, now_ns);
        } else if now_ns >= since_ns + RETRANSMISSION_TIMEOUT_NS {
            next = self.oldest_sequence;
            self.retransmission_timer = (self.oldest_sequence, now_ns);
        }
        let skipped = (next - self.oldest_sequence) as usize;
        let mut content = [self.oldest_sequence.bytes(), next.bytes()].concat();
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
        self.next_sequence = next + count;
        (count > 0).then_some(content)
    }
}

/// Receiver side of the delivery, for one other host.
#[derive(Debug, Default)]
pub struct RecordReceiver {
    /// Bridge of the last accepted batch, and the next expected sequence number.
    expected_boot_and_sequence: Option<(u64, u64)>,
}

impl RecordReceiver {
    /// Returns the new records of a batch of the bridge `boot`: none if records before them are missing. Returns
    /// `None` if the batch is malformed.
    pub fn receive_batch(&mut self, boot: u64, batch: &[u8]) -> Option<Vec<StatusRecord>> {
        let (oldest, rest) = split_number(batch)?;
        let (first, mut rest) = split_number(rest)?;
        let mut records = Vec::new();
        while !rest.is_empty() {
            let (kind, remaining) = split_number(rest)?;
            let (robot, remaining) = split_number(remaining)?;
            let (length, remaining) = split_number(remaining)?;
            let (content, remaining) = remaining.split_at_checked(usize::try_from(length).ok()?)?;
            let kind = [RecordKind::Status, RecordKind::Latency]
                .into_iter()
                .find(|&k| k as u64 == kind)?;
            let (robot, content) = (usize::try_from(robot).ok()?, content.to_vec());
            records.push(StatusRecord { kind, robot, content });
            rest = remaining;
        }
        let next = match self.expected_boot_and_sequence {
            Some((known_boot, next)) if known_boot == boot => next,
            // A batch of a new bridge, or the first one that this bridge receives.
            _ => oldest,
        };
        // Records that the sender dropped will not arrive.
        let next = next.max(oldest);
        if first > next {
            self.expected_boot_and_sequence = Some((boot, next));
            return Some(Vec::new());
        }
        let end = first.checked_add(records.len() as u64)?;
        self.expected_boot_and_sequence = Some((boot, next.max(end)));
        records.drain(..((next - first) as usize).min(records.len()));
        Some(records)
    }

    /// Returns the acknowledgment: the bridge, and the next expected sequence number.
    pub fn acknowledgment(&self) -> Option<[u64; 2]> {
        self.expected_boot_and_sequence.map(|(boot, next)| [boot, next])
    }
}

fn split_number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn record(n: usize) -> StatusRecord {
        let kind = if n.is_multiple_of(2) { RecordKind::Status } else { RecordKind::Latency };
        StatusRecord { kind, robot: n, content: vec![n as u8; n % 50] }
    }

    proptest! {
        /// Batches and acknowledgments are lost at random: each record arrives once and in order.
        #[test]
        fn records_arrive_once_and_in_order_despite_losses(
            lost in proptest::collection::vec(any::<[bool; 2]>(), 40),
            each in 1usize..30,
        ) {
            let (mut queue, mut receiver) = (UnackedQueue::default(), RecordReceiver::default());
            let (mut pushed, mut arrived, mut now_ns) = (0, Vec::new(), 0);
            for [batch_lost, confirmation_lost] in lost.into_iter().chain([[false; 2]; 60]) {
                now_ns += 50_000_000;
                if pushed < 40 * each {
                    (pushed..pushed + each).for_each(|n| queue.push(record(n)));
                    pushed += each;
                }
                if let Some(batch) = queue.next_batch(now_ns).filter(|_| !batch_lost) {
                    arrived.extend(receiver.receive_batch(9, &batch).unwrap());
                }
                if let Some([boot, next]) = receiver.acknowledgment().filter(|_| !confirmation_lost) {
                    prop_assert_eq!(boot, 9);
                    queue.acknowledge(next);
                }
            }
            prop_assert_eq!(queue.unacked_count(), 0);
            prop_assert_eq!(arrived, (0..pushed).map(record).collect::<Vec<_>>());
        }

        #[test]
        fn garbage_is_never_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = RecordReceiver::default().receive_batch(1, &bytes);
        }
    }

    #[test]
    fn backlog_after_an_outage_drains_under_load() {
        let (mut queue, mut receiver) = (UnackedQueue::default(), RecordReceiver::default());
        let (mut arrived, mut now_ns) = (Vec::new(), 0);
        for n in 0..400 {
            now_ns += 20_000_000;
            queue.push(StatusRecord { content: vec![0; 2_000], ..record(n) });
            let batch = queue.next_batch(now_ns);
            let is_down = (100..300).contains(&n);
            if let Some(batch) = batch.filter(|_| !is_down) {
                arrived.extend(receiver.receive_batch(9, &batch).unwrap());
                queue.acknowledge(receiver.acknowledgment().unwrap()[1]);
            }
        }
        let robots = arrived.iter().map(|record| record.robot);
        assert!(robots.eq(0..400) && queue.unacked_count() == 0);
    }

    #[test]
    fn unacknowledged_records_are_bounded() {
        let mut queue = UnackedQueue::default();
        let large =
            |robot| StatusRecord { kind: RecordKind::Latency, robot, content: vec![0; 1 << 20] };
        (0..40).for_each(|robot| queue.push(large(robot)));
        assert_eq!((queue.unacked_count(), queue.dropped_count), (32, 8));
        let batch = queue.next_batch(0).unwrap();
        let records = RecordReceiver::default().receive_batch(1, &batch).unwrap();
        assert_eq!(records[0].robot, 8);
    }

    #[test]
    fn restarted_sender_is_received_from_its_first_record() {
        let (mut old_queue, mut new_queue, mut receiver) =
            (UnackedQueue::default(), UnackedQueue::default(), RecordReceiver::default());
        (0..5).for_each(|n| old_queue.push(record(n)));
        assert_eq!(receiver.receive_batch(1, &old_queue.next_batch(0).unwrap()).unwrap().len(), 5);
        new_queue.push(record(7));
        assert_eq!(
            receiver.receive_batch(2, &new_queue.next_batch(0).unwrap()).unwrap(),
            [record(7)]
        );
        assert_eq!(receiver.acknowledgment(), Some([2, 1]));
    }
}
