//! A link for messages of one kind (beacons of one neighbor, a robot's odometry, or its commands), with planned
//! faults and with cuts by a user.
//!
//! Messages enter when they are sent and leave when they may be received. A pure function of times and seeds: no
//! I/O, no clock.

use crate::fault::{LinkFault, Transmission, TransmissionResult};

/// Maximum number of messages in transit. Beyond it, the oldest one is lost.
const IN_TRANSIT_MESSAGES_MAX: usize = 4096;

/// A link with faults.
#[derive(Debug, Clone)]
pub struct FaultyLink<M> {
    faults: Vec<LinkFault>,
    /// Whether a user has cut the link.
    is_cut: bool,
    /// Messages in transit, with the run times at which they may be received, ns.
    in_transit_messages: Vec<(u64, M)>,
    lost_count: u64,
}

impl<M: Clone> FaultyLink<M> {
    /// Creates a link with these faults.
    pub fn new(faults: &[LinkFault]) -> FaultyLink<M> {
        FaultyLink {
            faults: faults.to_vec(),
            is_cut: false,
            in_transit_messages: Vec::new(),
            lost_count: 0,
        }
    }

    /// Cuts the link or restores it, on behalf of a user. Messages in transit still arrive.
    pub fn set_cut(&mut self, is_cut: bool) {
        self.is_cut = is_cut;
    }

    /// Returns whether every message passes at once: the link has no faults and is not cut.
    #[inline]
    pub fn is_transparent(&self) -> bool {
        self.faults.is_empty() && !self.is_cut
    }

    /// Sends a message. Returns it if it may be received at once; otherwise it is lost or kept for
    /// [`FaultyLink::next_due_message`].
    pub fn send(&mut self, message: &M, transmission: Transmission) -> Option<M> {
        if self.is_cut {
            self.lost_count += 1;
            return None;
        }
        let t_ns = transmission.t_ns;
        let mut due_ns = t_ns;
        for fault in &self.faults {
            match fault.transmission(transmission) {
                TransmissionResult::NotBefore(earliest_ns) => due_ns = due_ns.max(earliest_ns),
                TransmissionResult::Lost => {
                    self.lost_count += 1;
                    return None;
                }
            }
        }
        if due_ns == t_ns {
            return Some(message.clone());
        }
        if self.in_transit_messages.len() == IN_TRANSIT_MESSAGES_MAX {
            self.in_transit_messages.remove(0);
            self.lost_count += 1;
        }
        self.in_transit_messages.push((due_ns, message.clone()));
        None
    }

    /// Returns the next message in transit that may be received at `t_ns` of run time.
    pub fn next_due_message(&mut self, t_ns: u64) -> Option<M> {
        // `min_by_key` returns the first of equal keys, so messages stay in order.
        let (index, (due_ns, _)) =
            self.in_transit_messages.iter().enumerate().min_by_key(|(_, (due_ns, _))| *due_ns)?;
        (*due_ns <= t_ns).then(|| self.in_transit_messages.remove(index).1)
    }

    /// Returns the number of lost messages.
    pub fn lost_count(&self) -> u64 {
        self.lost_count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::{LinkFaultKind, Span};

    /// Creates a link whose messages are the times at which they were sent, ns.
    fn link(kind: LinkFaultKind) -> FaultyLink<u64> {
        let span = Span { from_ns: 10, until_ns: 20 };
        FaultyLink::new(&[LinkFault { span, kind, seed: 1 }])
    }

    fn pass_message(link: &mut FaultyLink<u64>, t_ns: u64) -> Option<u64> {
        link.send(&t_ns, Transmission { tick: t_ns, t_ns, distance_m: None })
    }

    #[test]
    fn cut_link_delivers_only_messages_already_in_transit() {
        let mut link = link(LinkFaultKind::Delay { delay_ns: 5, jitter_ns: 0 });
        assert_eq!(pass_message(&mut link, 12), None);
        link.set_cut(true);
        assert_eq!((pass_message(&mut link, 14), pass_message(&mut link, 30)), (None, None));
        assert_eq!(
            (link.next_due_message(u64::MAX), link.next_due_message(u64::MAX)),
            (Some(12), None)
        );
        link.set_cut(false);
        assert_eq!((pass_message(&mut link, 31), link.lost_count()), (Some(31), 2));
    }

    #[test]
    fn delayed_messages_arrive_in_order_of_their_due_time() {
        let mut link = link(LinkFaultKind::Delay { delay_ns: 5, jitter_ns: 0 });
        assert_eq!(pass_message(&mut link, 10), None);
        assert_eq!(pass_message(&mut link, 12), None);
        assert_eq!(link.next_due_message(14), None);
        assert_eq!(link.next_due_message(15), Some(10));
        assert_eq!(link.next_due_message(15), None);
        assert_eq!(link.next_due_message(100), Some(12));
        assert_eq!(pass_message(&mut link, 20), Some(20), "the delay is over");
    }

    #[test]
    fn messages_in_transit_are_bounded() {
        let mut link = link(LinkFaultKind::Delay { delay_ns: u64::MAX, jitter_ns: 0 });
        for _ in 0..2 * IN_TRANSIT_MESSAGES_MAX {
            assert_eq!(pass_message(&mut link, 15), None);
        }
        assert_eq!(
            (link.in_transit_messages.len(), link.lost_count()),
            (IN_TRANSIT_MESSAGES_MAX, IN_TRANSIT_MESSAGES_MAX as u64)
        );
    }
}
