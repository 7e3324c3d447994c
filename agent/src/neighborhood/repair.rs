//! Topology repair: the states of the senders over time, from which `formation::rewiring` selects the references.

use formation::rewiring::{Purpose, Receiver, References, SenderState, Substitutes, Succession};
use protocol::brief::{AgentBrief, SuccessionBrief};
use protocol::message::Contact;

use super::Neighbor;

/// Failure declaration of a sender: it is declared failed after it was lost for long enough, until it has been
/// received again for the same time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct GivenUp {
    lost: bool,
    /// Run time of the last change of `lost`, ns.
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

/// Use of a sender as a reference, and the time of the last change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ReferenceUse {
    pub(super) yes: bool,
    /// Run time of the last change, ns, and 0 if there was none.
    pub(super) since_t_ns: u64,
}

impl ReferenceUse {
    fn set_active(&mut self, yes: bool, since_t_ns: u64) -> bool {
        let turned = yes != self.yes;
        if turned {
            *self = ReferenceUse { yes, since_t_ns };
        }
        turned
    }
}

/// Time at which a spare was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opened {
    pub(super) tick: u64,
    pub(super) stamp_ns: u64,
}

/// Returns the robot of the brief with its senders, by scenario index from 1, and its plans for their failures.
pub(super) fn receiver(brief: &AgentBrief) -> Receiver {
    let for_slot = |robot| brief.successions.iter().any(|one| one.by.contains(&robot));
    let substitutes = brief.senders().flat_map(|sender| {
        let entry = |&lost| Substitutes { robot: brief.index, lost, by: vec![sender.index] };
        sender.replaces.iter().map(entry)
    });
    let successions = brief.successions.iter().map(|one| {
        let SuccessionBrief { leader, deputies, by: _ } = one.clone();
        Succession { leader, deputies }
    });
    Receiver::new(
        brief.index,
        brief.neighbors.iter().map(|sender| sender.index),
        brief.spares.iter().map(|spare| (spare.index, for_slot(spare.index))),
        substitutes.collect(),
        successions.collect(),
    )
}

/// Opens and closes spares and selects the senders used as references. `neighbors` are the in-neighbors and the
/// spares. Returns whether the selection changed.
pub(super) fn repair(
    neighbors: &mut [Neighbor],
    receiver: &Receiver,
    references: &mut References,
    after_ns: u64,
    now: Opened,
    t_ns: u64,
) -> bool {
    for sender in &mut *neighbors {
        sender.given_up.judge(sender.contact.contact, after_ns, t_ns);
    }
    let state = |place: usize| SenderState {
        has_failed: neighbors[place].given_up.yes,
        is_heard: neighbors[place].is_received(),
    };
    receiver.update(state, references);
    let mut changed = false;
    for (place, sender) in neighbors.iter_mut().enumerate() {
        let is_in_neighbor = receiver.senders()[place].purpose == Purpose::InNeighbor;
        match (references.is_open[place], sender.opened) {
            (true, None) if !is_in_neighbor => sender.opened = Some(now),
            (false, Some(_)) => sender.close(),
            _ => {}
        }
        changed |= sender.goes_by.set_active(references.uses(place), t_ns);
    }
    changed
}
