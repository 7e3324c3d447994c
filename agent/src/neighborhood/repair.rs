//! Topology repair: replacement of failed in-neighbors by the next spares received or by the replacements that
//! the brief names, and succession of failed leaders. It uses only the communication states of the senders.

use protocol::brief::AgentBrief;
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

/// Succession of a leader that is declared failed.
struct Succession {
    leader: u64,
    /// Deputies, best rank first.
    deputies: Vec<u64>,
    /// Index of the first deputy that has not failed, while the leader is declared failed.
    acting: Option<usize>,
}

impl Succession {
    fn is_acting_deputy(&self, robot: u64) -> bool {
        self.acting.is_some_and(|rank| self.deputies.get(rank) == Some(&robot))
    }
}

/// Successions of all leaders received, and whether the robot itself succeeds one.
pub(super) struct Successions {
    own_index: u64,
    all: Vec<Succession>,
    pub(super) takes_place: bool,
}

impl Successions {
    pub(super) fn new(brief: &AgentBrief) -> Successions {
        let all = brief.successions.iter().map(|one| Succession {
            leader: one.leader as u64,
            deputies: one.deputies.iter().map(|&deputy| deputy as u64).collect(),
            acting: None,
        });
        Successions { own_index: brief.index as u64, all: all.collect(), takes_place: false }
    }

    fn judge(&mut self, is_given_up: impl Fn(u64) -> bool) {
        for one in &mut self.all {
            let living = one.deputies.iter().position(|&deputy| !is_given_up(deputy));
            let acting = living.unwrap_or(one.deputies.len());
            one.acting = is_given_up(one.leader).then_some(acting);
        }
    }

    /// Returns the leaders that `robot` currently succeeds.
    pub(super) fn succeeded_leaders(&self, robot: u64) -> impl Iterator<Item = u64> {
        self.all.iter().filter(move |one| one.is_acting_deputy(robot)).map(|one| one.leader)
    }

    /// Returns whether a deputy has to be received: it succeeds a leader, or its rank is better than that of
    /// the acting deputy.
    fn must_receive_deputy(&self, robot: u64) -> bool {
        let tries = |one: &Succession| one.acting.map_or(0, |rank| rank + 1);
        self.all.iter().any(|one| one.deputies.iter().take(tries(one)).any(|&one| one == robot))
    }
}

/// Opens and closes spares and selects the senders used as references. Returns whether the selection changed.
///
/// A spare that replaces specific in-neighbors is open while one of them is declared failed. Of the other
/// spares, one is open for each failed in-neighbor, and one more for each open spare that has failed too.
/// Deputies of leaders precede them, by rank. A robot that succeeds a leader uses only the senders that its
/// brief names for this purpose.
pub(super) fn repair(
    neighbors: &mut [Neighbor],
    spares: &mut [Neighbor],
    successions: &mut Successions,
    after_ns: u64,
    now: Opened,
    t_ns: u64,
) -> bool {
    for sender in neighbors.iter_mut().chain(&mut *spares) {
        sender.given_up.judge(sender.contact.contact, after_ns, t_ns);
    }
    let mut senders = neighbors.iter().chain(&*spares);
    successions.judge(|robot| senders.clone().any(|one| one.index == robot && one.given_up.yes));
    let acts = successions.succeeded_leaders(successions.own_index).next().is_some();
    let takes_place =
        acts && senders.any(|sender| sender.keeps_leader_slot && sender.is_received());
    successions.takes_place = takes_place;
    let has_deputies = |robot: u64| successions.all.iter().any(|one| one.leader == robot);
    let lacks = |one: &&Neighbor| one.given_up.yes && !has_deputies(one.index);
    let mut lacking = neighbors.iter().filter(lacks).count();
    let mut replacing = 0;
    let mut changed = false;
    for spare in &mut *spares {
        let is_given_up = |robot: &u64| {
            neighbors.iter().any(|neighbor| neighbor.index == *robot && neighbor.given_up.yes)
        };
        let planned = spare.replaces.iter().any(is_given_up);
        let wanted = if spare.is_universal {
            lacking > 0
        } else if spare.keeps_leader_slot {
            acts
        } else {
            planned || successions.must_receive_deputy(spare.index)
        };
        match (wanted, spare.opened) {
            (true, None) => spare.opened = Some(now),
            (false, Some(_)) => spare.close(),
            _ => {}
        }
        lacking -= usize::from(lacking > 0 && spare.is_universal && !spare.given_up.yes);
        let heard = spare.is_received();
        replacing += usize::from(spare.is_universal && heard);
        let replaces = spare.is_universal
            || planned
            || successions.succeeded_leaders(spare.index).next().is_some();
        let counts = if takes_place { spare.keeps_leader_slot } else { replaces };
        changed |= spare.goes_by.set_active(heard && counts, t_ns);
    }
    for place in 0..neighbors.len() {
        let robot = neighbors[place].index;
        let mut senders = neighbors.iter().chain(&*spares);
        let by_plan = senders.any(|one| {
            let acts = || successions.succeeded_leaders(one.index).any(|leader| leader == robot);
            one.is_received() && (one.replaces.contains(&robot) || acts())
        });
        let replaced = neighbors[place].given_up.yes && (by_plan || replacing > 0);
        replacing -= usize::from(replaced && !by_plan);
        changed |= neighbors[place].goes_by.set_active(!replaced && !takes_place, t_ns);
    }
    changed
}
