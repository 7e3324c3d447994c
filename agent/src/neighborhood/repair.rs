//! Whom a robot goes by in place of in-neighbours that it has given up: the next spares that are
//! heard. Must not: hear anything but how those heard so far are heard.

use protocol::message::Contact;

use super::Neighbor;

/// Whether a sender is given up: it is after it was lost for long enough, and until it has been
/// heard again for as long.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct GivenUp {
    lost: bool,
    /// Time since the run's start since which it is lost, or is not, ns.
    since_t_ns: u64,
    pub(super) yes: bool,
}

impl GivenUp {
    fn judge(&mut self, contact: Contact, after_ns: u64, t_ns: u64) {
        let lost = contact == Contact::Lost;
        if lost != self.lost {
            (self.lost, self.since_t_ns) = (lost, t_ns);
        }
        if t_ns.saturating_sub(self.since_t_ns) >= after_ns {
            self.yes = self.lost;
        }
    }
}

/// Whether a robot goes by a sender, and since when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct GoesBy {
    pub(super) yes: bool,
    /// Time since the run's start, ns; 0: it always did, or never.
    pub(super) since_t_ns: u64,
}

impl GoesBy {
    fn turns(&mut self, yes: bool, since_t_ns: u64) -> bool {
        let turned = yes != self.yes;
        if turned {
            *self = GoesBy { yes, since_t_ns };
        }
        turned
    }
}

/// When a spare was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opened {
    pub(super) tick: u64,
    pub(super) stamp_ns: u64,
}

/// Opens and closes spares, and says by whom the robot goes; whether that changed. For each
/// in-neighbour given up one spare is open, and one more for each open one that is given up too.
pub(super) fn repair(
    neighbors: &mut [Neighbor],
    spares: &mut [Neighbor],
    after_ns: u64,
    now: Opened,
    t_ns: u64,
) -> bool {
    for sender in neighbors.iter_mut().chain(&mut *spares) {
        sender.given_up.judge(sender.contact.contact, after_ns, t_ns);
    }
    let mut lacking = neighbors.iter().filter(|neighbor| neighbor.given_up.yes).count();
    for spare in &mut *spares {
        match (lacking > 0, spare.opened) {
            (true, None) => spare.opened = Some(now),
            (false, Some(_)) => spare.close(),
            _ => {}
        }
        lacking -= usize::from(lacking > 0 && !spare.given_up.yes);
    }
    let mut changed = false;
    let mut replacing = 0;
    for spare in spares {
        let heard = spare.newest.is_some() && spare.contact.contact != Contact::Lost;
        replacing += usize::from(heard);
        changed |= spare.goes_by.turns(heard, t_ns);
    }
    for neighbor in neighbors {
        let replaced = neighbor.given_up.yes && replacing > 0;
        replacing -= usize::from(replaced);
        changed |= neighbor.goes_by.turns(!replaced, t_ns);
    }
    changed
}
