//! A link from one neighbour, with whatever the brief says is to be wrong with it, or somebody does
//! to it by hand.
//!
//! Beacons go in as they come and come out when they may be heard. A pure function of stamps and
//! seeds: no I/O, no clock.

use protocol::fault::{LinkFault, Passage};
use protocol::message::Beacon;

/// More beacons than this are never under way: the oldest is lost instead.
const WAITING_MAX: usize = 4096;

/// The link from one neighbour.
#[derive(Debug, Clone)]
pub struct Link {
    faults: Vec<LinkFault>,
    /// Cut by hand, until it is mended.
    cut: bool,
    /// Beacons under way, and the run times from which on they may be heard, ns.
    waiting: Vec<(u64, Beacon)>,
    lost: u64,
}

impl Link {
    /// A link with these faults.
    pub fn new(faults: &[LinkFault]) -> Link {
        Link { faults: faults.to_vec(), cut: false, waiting: Vec::new(), lost: 0 }
    }

    /// Cuts it by hand, or mends what was cut so. What was under way still arrives.
    pub fn set_cut(&mut self, cut: bool) {
        self.cut = cut;
    }

    /// Takes a beacon; gives it back if it may be heard at once. `start_ns`: the stamp of t = 0.
    pub fn pass(&mut self, beacon: &Beacon, start_ns: u64) -> Option<Beacon> {
        if self.cut {
            self.lost += 1;
            return None;
        }
        let t_ns = beacon.stamp_ns.saturating_sub(start_ns);
        let mut due_ns = t_ns;
        for fault in &self.faults {
            match fault.passage(beacon.tick, t_ns) {
                Passage::At(at_ns) => due_ns = due_ns.max(at_ns),
                Passage::Lost => {
                    self.lost += 1;
                    return None;
                }
            }
        }
        if due_ns == t_ns {
            return Some(*beacon);
        }
        if self.waiting.len() == WAITING_MAX {
            self.waiting.remove(0);
            self.lost += 1;
        }
        self.waiting.push((due_ns, *beacon));
        None
    }

    /// The next beacon that was under way and may be heard at `t_ns` of run time.
    pub fn due(&mut self, t_ns: u64) -> Option<Beacon> {
        // The first of those due first: min_by_key keeps the order of equals.
        let (place, (due_ns, _)) =
            self.waiting.iter().enumerate().min_by_key(|(_, (due_ns, _))| *due_ns)?;
        (*due_ns <= t_ns).then(|| self.waiting.remove(place).1)
    }

    /// How many beacons never arrived.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::fault::{LinkFaultKind, Span};

    fn link(kind: LinkFaultKind) -> Link {
        let span = Span { from_ns: 10, until_ns: 20 };
        Link::new(&[LinkFault { span, kind, seed: 1 }])
    }

    fn beacon(stamp_ns: u64) -> Beacon {
        Beacon { tick: stamp_ns, stamp_ns, ..Beacon::default() }
    }

    #[test]
    fn a_cut_link_is_silent_for_as_long_as_it_is_cut() {
        let mut link = link(LinkFaultKind::Cut);
        let heard: Vec<bool> =
            [109, 110, 119, 120].map(|ns| link.pass(&beacon(ns), 100).is_some()).into();
        assert_eq!(heard, [true, false, false, true]);
        assert_eq!((link.lost(), link.due(u64::MAX)), (2, None));
    }

    #[test]
    fn a_link_cut_by_hand_is_silent_until_it_is_mended_but_for_what_was_under_way() {
        let mut link = link(LinkFaultKind::Delay { delay_ns: 5, jitter_ns: 0 });
        assert_eq!(link.pass(&beacon(12), 0), None);
        link.set_cut(true);
        assert_eq!((link.pass(&beacon(14), 0), link.pass(&beacon(30), 0)), (None, None));
        assert_eq!((link.due(u64::MAX), link.due(u64::MAX)), (Some(beacon(12)), None));
        link.set_cut(false);
        assert_eq!((link.pass(&beacon(31), 0), link.lost()), (Some(beacon(31)), 2));
    }

    #[test]
    fn delayed_beacons_come_out_in_the_order_in_which_they_are_due() {
        let mut link = link(LinkFaultKind::Delay { delay_ns: 5, jitter_ns: 0 });
        assert_eq!(link.pass(&beacon(10), 0), None);
        assert_eq!(link.pass(&beacon(12), 0), None);
        assert_eq!(link.due(14), None);
        assert_eq!(link.due(15), Some(beacon(10)));
        assert_eq!(link.due(15), None);
        assert_eq!(link.due(100), Some(beacon(12)));
        assert_eq!(link.pass(&beacon(20), 0), Some(beacon(20)), "the delay is over");
    }

    #[test]
    fn what_never_comes_out_is_bounded() {
        let mut link = link(LinkFaultKind::Delay { delay_ns: u64::MAX, jitter_ns: 0 });
        for _ in 0..2 * WAITING_MAX {
            assert_eq!(link.pass(&beacon(15), 0), None);
        }
        assert_eq!((link.waiting.len(), link.lost()), (WAITING_MAX, WAITING_MAX as u64));
    }
}
