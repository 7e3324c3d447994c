//! Newest status of a robot, and the changes in it. Must not depend on how the status arrived.

use protocol::law_message::SentCounts;
use protocol::message::{Contact, NeighborStatus, StatusHeader};

/// Status of a robot, as it last reported it.
#[derive(Debug, Clone)]
pub struct Report {
    /// Contact state of each robot, and since when, ns.
    contacts: Vec<(Contact, u64)>,
    /// Run time, ns, since which each robot is used as a reference, or no longer is; 0 if this never changed.
    gone_by_since_ns: Vec<u64>,
    /// Contact state of the leader's frame, and since when, ns.
    frame: (Contact, u64),
    /// Goal from outside that is in effect, m.
    goal_m: Option<[f64; 2]>,
    moves: bool,
    /// Number of statuses of the present process that were read.
    pub statuses_read: u64,
    /// Counts of earlier incarnations, and of the present incarnation.
    counted: [Counts; 2],
}

/// Counts of a robot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Deadline misses.
    pub misses: u64,
    /// Rejected beacons.
    pub refused: u64,
    /// Odometry samples that were too old for a response.
    pub odometry_old: u64,
    /// Beacons and messages sent.
    pub sent: SentCounts,
}

/// Change in a robot's status.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "`since_ns`: run time; `other`: by place in the scenario")]
pub enum StatusChange {
    /// New contact state of another robot.
    Heard { other: usize, contact: Contact, since_ns: u64 },
    /// New contact state of the leader's frame.
    FrameHeard { contact: Contact, since_ns: u64 },
    /// Start or end of using another robot as a reference, such as a backup neighbor in place of one
    /// declared failed.
    ReferenceUse { other: usize, yes: bool, since_ns: u64 },
    /// New goal, m: one from outside, or `None` for its own.
    GoesTo { outside_m: Option<[f64; 2]>, since_ns: u64 },
}

impl StatusChange {
    /// Returns whether the change may come with a new connection between two robots: to a backup neighbor that was
    /// activated, or to the beacon of a backup leader that a returning leader has opened.
    pub fn may_open_connection(&self) -> bool {
        matches!(self, StatusChange::FrameHeard { .. } | StatusChange::ReferenceUse { .. })
    }
}

impl Report {
    /// Creates the status of one of `robots` robots, without any contact.
    pub fn new(robots: usize) -> Report {
        let unheard = (Contact::Unheard, 0);
        Report {
            contacts: vec![unheard; robots],
            gone_by_since_ns: vec![0; robots],
            frame: unheard,
            goal_m: None,
            moves: false,
            statuses_read: 0,
            counted: Default::default(),
        }
    }

    /// Resets the status for a replacement, which has no contacts and counts from 0.
    pub fn reset(&mut self) {
        *self = Report {
            // The goal is reported again only if it differs from that of the predecessor.
            goal_m: self.goal_m,
            counted: [self.counts(), Counts::default()],
            ..Report::new(self.contacts.len())
        };
    }

    /// Returns the contact state of another robot.
    pub fn contact(&self, other: usize) -> Contact {
        self.contacts[other].0
    }

    /// Returns whether the present process has replied to a sample.
    pub fn has_replied(&self) -> bool {
        self.moves
    }

    /// Returns the counts of all incarnations together.
    pub fn counts(&self) -> Counts {
        let [before, now] = self.counted;
        Counts {
            misses: before.misses + now.misses,
            refused: before.refused + now.refused,
            odometry_old: before.odometry_old + now.odometry_old,
            sent: before.sent.plus_next_incarnation(now.sent),
        }
    }

    /// Updates the status from a message of the present process. Returns the changes.
    pub fn update(
        &mut self,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
    ) -> Vec<StatusChange> {
        self.moves |= header.moving == 1;
        self.statuses_read += 1;
        self.counted[1] = Counts {
            misses: header.deadline_misses,
            refused: header.beacons_refused,
            odometry_old: header.odometry_old,
            sent: SentCounts {
                beacons: header.beacons_sent,
                messages: header.messages_sent,
                message_hash: header.message_hash,
            },
        };
        let mut news = Vec::new();
        if let Some(contact) = Contact::from_number(header.frame) {
            let since_ns = header.frame_since_t_ns;
            if contact_changes(&mut self.frame, contact, since_ns) {
                news.push(StatusChange::FrameHeard { contact, since_ns });
            }
        }
        let outside_m = header.goal().map(|(_, goal_m)| goal_m);
        if header.moving == 1 && outside_m != self.goal_m {
            self.goal_m = outside_m;
            let since_ns = header.goal().map_or(header.t_ns, |(since_ns, _)| since_ns);
            news.push(StatusChange::GoesTo { outside_m, since_ns });
        }
        for status in neighbors {
            let Some(contact) = Contact::from_number(status.contact) else { continue };
            let Some(other) = (status.robot as usize).checked_sub(1) else { continue };
            let Some(known) = self.contacts.get_mut(other) else { continue };
            if contact_changes(known, contact, status.since_t_ns) {
                news.push(StatusChange::Heard { other, contact, since_ns: status.since_t_ns });
            }
            let since_ns = status.goes_by_since_t_ns;
            if std::mem::replace(&mut self.gone_by_since_ns[other], since_ns) != since_ns {
                news.push(StatusChange::ReferenceUse { other, yes: status.goes_by == 1, since_ns });
            }
        }
        news
    }
}

/// Returns whether a contact state is a change to report, and stores it. The initial states, without
/// contact or with a closed backup edge, are not reported.
fn contact_changes(known: &mut (Contact, u64), contact: Contact, since_ns: u64) -> bool {
    std::mem::replace(known, (contact, since_ns)) != *known && contact != Contact::Unheard
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(contact: Contact, since_t_ns: u64) -> NeighborStatus {
        NeighborStatus { robot: 2, contact: contact as u64, since_t_ns, ..Default::default() }
    }

    #[test]
    fn replacement_reports_its_contacts_with_its_own_times() {
        let mut report = Report::new(2);
        let mut told = |contact: Contact, since_ns: u64| {
            let header = StatusHeader {
                frame: contact as u64,
                frame_since_t_ns: since_ns,
                deadline_misses: 3,
                beacons_refused: 1,
                odometry_old: 2,
                beacons_sent: 5,
                messages_sent: 4,
                ..StatusHeader::default()
            };
            if contact == Contact::Unheard {
                report.reset();
            }
            (report.update(&header, &[status(contact, since_ns)]), report.counts())
        };
        let heard = |since_ns| {
            let contact = Contact::Fresh;
            let other = StatusChange::Heard { other: 1, contact, since_ns };
            vec![StatusChange::FrameHeard { contact, since_ns }, other]
        };
        assert_eq!(told(Contact::Fresh, 5).0, heard(5));
        assert_eq!(told(Contact::Fresh, 5).0, []);
        // Reported before it receives any beacon, as of the start of the run.
        assert_eq!(told(Contact::Unheard, 0).0, []);
        let (again, counts) = told(Contact::Fresh, 90);
        assert_eq!(again, heard(90));
        let sent = SentCounts { beacons: 10, messages: 8, message_hash: counts.sent.message_hash };
        assert_eq!(counts, Counts { misses: 6, refused: 2, odometry_old: 4, sent }, "of both");
    }

    #[test]
    fn goal_is_reported_on_change_and_when_a_replacement_drops_it() {
        let mut report = Report::new(1);
        let status = |goal_since_t_ns, x_m, t_ns| StatusHeader {
            moving: 1,
            goal_stamp_ns: goal_since_t_ns,
            goal_since_t_ns,
            goal_m: [x_m, 2.0],
            t_ns,
            ..StatusHeader::default()
        };
        let to = |x_m| Some([x_m, 2.0]);
        assert!(report.update(&status(0, 0.0, 5), &[]).is_empty(), "to its own from the beginning");
        for (status, news) in [
            (status(10, 1.0, 12), Some((to(1.0), 10))),
            (status(10, 1.0, 20), None),
            (status(30, 1.0, 31), None),
            (status(40, 3.0, 42), Some((to(3.0), 40))),
        ] {
            let expected =
                news.map(|(outside_m, since_ns)| StatusChange::GoesTo { outside_m, since_ns });
            assert_eq!(report.update(&status, &[]), Vec::from_iter(expected));
        }
        report.reset();
        let born = StatusHeader { moving: 0, ..status(0, 0.0, 0) };
        assert!(report.update(&born, &[]).is_empty(), "it has not begun to move");
        let own = StatusChange::GoesTo { outside_m: None, since_ns: 90 };
        assert_eq!(report.update(&status(0, 0.0, 90), &[]), [own]);
    }
}
