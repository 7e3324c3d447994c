//! Whom a robot goes by in place of in-neighbours that it has given up: the next spares that are
//! heard, or those that its brief names for each. Must not: hear anything but how those heard so far are heard.

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

/// Opens and closes spares, and says by whom the robot goes; whether that changed. A spare that replaces certain
/// in-neighbours is open while one of them is given up. Of the others one is open for each in-neighbour given up,
/// and one more for each open one that is given up too.
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
    let mut replacing = 0;
    let mut changed = false;
    for spare in &mut *spares {
        let for_anybody = spare.replaces.is_empty();
        let is_given_up = |robot: &u64| {
            neighbors.iter().any(|neighbor| neighbor.index == *robot && neighbor.given_up.yes)
        };
        let wanted = if for_anybody { lacking > 0 } else { spare.replaces.iter().any(is_given_up) };
        match (wanted, spare.opened) {
            (true, None) => spare.opened = Some(now),
            (false, Some(_)) => spare.close(),
            _ => {}
        }
        lacking -= usize::from(lacking > 0 && for_anybody && !spare.given_up.yes);
        let heard = spare.is_heard();
        replacing += usize::from(for_anybody && heard);
        changed |= spare.goes_by.turns(heard, t_ns);
    }
    for place in 0..neighbors.len() {
        let robot = neighbors[place].index;
        let mut senders = neighbors.iter().chain(&*spares);
        let by_plan = senders.any(|one| one.replaces.contains(&robot) && one.is_heard());
        let replaced = neighbors[place].given_up.yes && (by_plan || replacing > 0);
        replacing -= usize::from(replaced && !by_plan);
        changed |= neighbors[place].goes_by.turns(!replaced, t_ns);
    }
    changed
}
