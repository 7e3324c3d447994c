//! Topology repair: the states of the senders over time, from which `formation::rewiring` selects the references.

use formation::rewiring::{
    PlannedReplacement, Receiver, References, SenderPurpose, SenderState, Succession,
};
use protocol::brief::{AgentBrief, SuccessionBrief};
use protocol::message::ReceptionState;

use super::Neighbor;

/// Failure declaration of a sender: it is declared failed after it was lost for long enough, until it has been
/// received again for the same time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct FailureDeclaration {
    is_lost: bool,
    /// Run time of the last change of `is_lost`, ns.
    last_change_t_ns: u64,
    pub(super) is_declared_failed: bool,
}

impl FailureDeclaration {
    fn update_declaration(&mut self, reception_state: ReceptionState, after_ns: u64, t_ns: u64) {
        let is_lost = reception_state == ReceptionState::Lost;
        if is_lost != self.is_lost {
            (self.is_lost, self.last_change_t_ns) = (is_lost, t_ns);
        }
        if t_ns.saturating_sub(self.last_change_t_ns) >= after_ns {
            self.is_declared_failed = self.is_lost;
        }
    }
}

/// Use of a sender as a reference, and the time of the last change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ReferenceUse {
    pub(super) is_used: bool,
    /// Run time of the last change, ns, and 0 if there was none.
    pub(super) last_change_t_ns: u64,
}

impl ReferenceUse {
    fn set_used(&mut self, is_used: bool, t_ns: u64) -> bool {
        let changed = is_used != self.is_used;
        if changed {
            *self = ReferenceUse { is_used, last_change_t_ns: t_ns };
        }
        changed
    }
}

/// Time at which a spare was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SpareOpeningTime {
    pub(super) tick: u64,
    pub(super) stamp_ns: u64,
}

/// Returns the robot of the brief with its senders, by scenario index from 1, and its plans for their failures.
pub(super) fn receiver_from_brief(brief: &AgentBrief) -> Receiver {
    let keeps_slot =
        |robot| brief.successions.iter().any(|succession| succession.by.contains(&robot));
    let substitutes = brief.senders().flat_map(|sender| {
        let entry = |&lost| PlannedReplacement {
            robot: brief.index,
            lost_in_neighbor: lost,
            substitutes: vec![sender.index],
        };
        sender.replaces.iter().map(entry)
    });
    let successions = brief.successions.iter().map(|succession| {
        let SuccessionBrief { leader, deputies, by: _ } = succession.clone();
        Succession { leader, deputies }
    });
    Receiver::new(
        brief.index,
        brief.neighbors.iter().map(|sender| sender.index),
        brief.spares.iter().map(|spare| (spare.index, keeps_slot(spare.index))),
        substitutes.collect(),
        successions.collect(),
    )
}

/// Opens and closes spares and selects the senders used as references. `neighbors` are the in-neighbors and the
/// spares. Returns whether the selection changed.
pub(super) fn update_spares_and_references(
    neighbors: &mut [Neighbor],
    receiver: &Receiver,
    references: &mut References,
    after_ns: u64,
    now: SpareOpeningTime,
    t_ns: u64,
) -> bool {
    for sender in &mut *neighbors {
        sender.failure_declaration.update_declaration(sender.reception.state, after_ns, t_ns);
    }
    let state = |index: usize| SenderState {
        has_failed: neighbors[index].failure_declaration.is_declared_failed,
        is_received: neighbors[index].is_received(),
    };
    receiver.update_references(state, references);
    let mut changed = false;
    for (index, sender) in neighbors.iter_mut().enumerate() {
        let is_in_neighbor = receiver.senders()[index].purpose == SenderPurpose::InNeighbor;
        match (references.is_sender_open[index], sender.opening_time) {
            (true, None) if !is_in_neighbor => sender.opening_time = Some(now),
            (false, Some(_)) => sender.reset(),
            _ => {}
        }
        changed |= sender.reference_use.set_used(references.uses_sender(index), t_ns);
    }
    changed
}
