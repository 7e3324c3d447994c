//! Newest status of a robot, and the changes in it. Must not depend on how the status arrived.

use protocol::law_message::SentCounts;
use protocol::message::{NeighborStatus, ReceptionState, StatusHeader};

/// Status of a robot, as it last reported it.
#[derive(Debug, Clone)]
pub struct RobotReport {
    /// Contact state of each robot, and since when, ns.
    reception_states: Vec<(ReceptionState, u64)>,
    /// Run time, ns, since which each robot is used as a reference, or no longer is; 0 if this never changed.
    reference_use_since_ns: Vec<u64>,
    /// Contact state of the leader's frame, and since when, ns.
    leader_frame_reception: (ReceptionState, u64),
    /// Goal from outside that is in effect, m.
    goal_m: Option<[f64; 2]>,
    has_replied: bool,
    /// Number of statuses of the present process that were read.
    pub statuses_read: u64,
    /// Counts of earlier incarnations, and of the present incarnation.
    earlier_and_current_counts: [RobotCounts; 2],
}

/// Counts of a robot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RobotCounts {
    /// Deadline misses.
    pub deadline_misses: u64,
    /// Rejected beacons.
    pub rejected_beacons: u64,
    /// Odometry samples that were too old for a response.
    pub old_odometry_samples: u64,
    /// Beacons and messages sent.
    pub sent_counts: SentCounts,
}

/// Change in a robot's status.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "`since_ns`: run time; `other`: by place in the scenario")]
pub enum StatusChange {
    /// New contact state of another robot.
    ReceptionChanged { other_robot: usize, reception_state: ReceptionState, since_ns: u64 },
    /// New contact state of the leader's frame.
    LeaderFrameReceptionChanged { reception_state: ReceptionState, since_ns: u64 },
    /// Start or end of using another robot as a reference, such as a backup neighbor in place of one
    /// declared failed.
    ReferenceUseChanged { other_robot: usize, is_used: bool, since_ns: u64 },
    /// New goal, m: one from outside, or `None` for its own.
    GoalChanged { outside_goal_m: Option<[f64; 2]>, since_ns: u64 },
}

impl StatusChange {
    /// Returns whether the change may come with a new connection between two robots: to a backup neighbor that was
    /// activated, or to the beacon of a backup leader that a returning leader has opened.
    pub fn may_open_connection(&self) -> bool {
        matches!(
            self,
            StatusChange::LeaderFrameReceptionChanged { .. }
                | StatusChange::ReferenceUseChanged { .. }
        )
    }
}

impl RobotReport {
    /// Creates the status of one of `robots` robots, without any contact.
    pub fn new(robots: usize) -> RobotReport {
        let unheard = (ReceptionState::NothingReceived, 0);
        RobotReport {
            reception_states: vec![unheard; robots],
            reference_use_since_ns: vec![0; robots],
            leader_frame_reception: unheard,
            goal_m: None,
            has_replied: false,
            statuses_read: 0,
            earlier_and_current_counts: Default::default(),
        }
    }

    /// Resets the status for a replacement, which has no contacts and counts from 0.
    pub fn reset(&mut self) {
        *self = RobotReport {
            // The goal is reported again only if it differs from that of the predecessor.
            goal_m: self.goal_m,
            earlier_and_current_counts: [self.counts(), RobotCounts::default()],
            ..RobotReport::new(self.reception_states.len())
        };
    }

    /// Returns the contact state of another robot.
    pub fn reception_state(&self, other: usize) -> ReceptionState {
        self.reception_states[other].0
    }

    /// Returns whether the present process has replied to a sample.
    pub fn has_replied(&self) -> bool {
        self.has_replied
    }

    /// Returns the counts of all incarnations together.
    pub fn counts(&self) -> RobotCounts {
        let [before, now] = self.earlier_and_current_counts;
        RobotCounts {
            deadline_misses: before.deadline_misses + now.deadline_misses,
            rejected_beacons: before.rejected_beacons + now.rejected_beacons,
            old_odometry_samples: before.old_odometry_samples + now.old_odometry_samples,
            sent_counts: before.sent_counts.plus_next_incarnation(now.sent_counts),
        }
    }

    /// Updates what the present process has sent, unless the counts are older than those known.
    pub fn update_sent_counts(&mut self, sent: SentCounts) {
        let age = |counts: &SentCounts| (counts.beacons, counts.dropped_messages);
        let known = &mut self.earlier_and_current_counts[1].sent_counts;
        if age(&sent) >= age(known) {
            *known = sent;
        }
    }

    /// Updates the status from a message of the present process. Returns the changes.
    pub fn update(
        &mut self,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
    ) -> Vec<StatusChange> {
        self.has_replied |= header.moving == 1;
        self.statuses_read += 1;
        let counts = &mut self.earlier_and_current_counts[1];
        counts.deadline_misses = header.deadline_misses;
        counts.rejected_beacons = header.beacons_refused;
        counts.old_odometry_samples = header.odometry_old;
        self.update_sent_counts(SentCounts {
            beacons: header.beacons_sent,
            messages: header.messages_sent,
            message_hash: header.message_hash,
            dropped_messages: header.messages_dropped,
        });
        let mut news = Vec::new();
        if let Some(contact) = ReceptionState::from_number(header.frame) {
            let since_ns = header.frame_since_t_ns;
            if update_reception_state(&mut self.leader_frame_reception, contact, since_ns) {
                news.push(StatusChange::LeaderFrameReceptionChanged {
                    reception_state: contact,
                    since_ns,
                });
            }
        }
        let outside_m = header.goal().map(|(_, goal_m)| goal_m);
        if header.moving == 1 && outside_m != self.goal_m {
            self.goal_m = outside_m;
            let since_ns = header.goal().map_or(header.t_ns, |(since_ns, _)| since_ns);
            news.push(StatusChange::GoalChanged { outside_goal_m: outside_m, since_ns });
        }
        for status in neighbors {
            let Some(contact) = ReceptionState::from_number(status.contact) else { continue };
            let Some(other) = (status.robot as usize).checked_sub(1) else { continue };
            let Some(known) = self.reception_states.get_mut(other) else { continue };
            if update_reception_state(known, contact, status.since_t_ns) {
                news.push(StatusChange::ReceptionChanged {
                    other_robot: other,
                    reception_state: contact,
                    since_ns: status.since_t_ns,
                });
            }
            let since_ns = status.goes_by_since_t_ns;
            if std::mem::replace(&mut self.reference_use_since_ns[other], since_ns) != since_ns {
                news.push(StatusChange::ReferenceUseChanged {
                    other_robot: other,
                    is_used: status.goes_by == 1,
                    since_ns,
                });
            }
        }
        news
    }
}

/// Returns whether a contact state is a change to report, and stores it. The initial states, without
/// contact or with a closed backup edge, are not reported.
fn update_reception_state(
    known: &mut (ReceptionState, u64),
    contact: ReceptionState,
    since_ns: u64,
) -> bool {
    std::mem::replace(known, (contact, since_ns)) != *known
        && contact != ReceptionState::NothingReceived
}

#[cfg(test)]
mod tests {
    use super::*;

    fn neighbor_status(contact: ReceptionState, since_t_ns: u64) -> NeighborStatus {
        NeighborStatus { robot: 2, contact: contact as u64, since_t_ns, ..Default::default() }
    }

    #[test]
    fn replacement_reports_its_contacts_with_its_own_times() {
        let mut report = RobotReport::new(2);
        let mut told = |contact: ReceptionState, since_ns: u64| {
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
            if contact == ReceptionState::NothingReceived {
                report.reset();
            }
            (report.update(&header, &[neighbor_status(contact, since_ns)]), report.counts())
        };
        let heard = |since_ns| {
            let reception_state = ReceptionState::Fresh;
            let other =
                StatusChange::ReceptionChanged { other_robot: 1, reception_state, since_ns };
            vec![StatusChange::LeaderFrameReceptionChanged { reception_state, since_ns }, other]
        };
        assert_eq!(told(ReceptionState::Fresh, 5).0, heard(5));
        assert_eq!(told(ReceptionState::Fresh, 5).0, []);
        // Reported before it receives any beacon, as of the start of the run.
        assert_eq!(told(ReceptionState::NothingReceived, 0).0, []);
        let (again, counts) = told(ReceptionState::Fresh, 90);
        assert_eq!(again, heard(90));
        let message_hash = counts.sent_counts.message_hash;
        let sent = SentCounts { beacons: 10, messages: 8, message_hash, dropped_messages: 0 };
        assert_eq!(
            counts,
            RobotCounts {
                deadline_misses: 6,
                rejected_beacons: 2,
                old_odometry_samples: 4,
                sent_counts: sent
            },
            "of both"
        );
    }

    #[test]
    fn goal_is_reported_on_change_and_when_a_replacement_drops_it() {
        let mut report = RobotReport::new(1);
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
            let expected = news.map(|(outside_m, since_ns)| StatusChange::GoalChanged {
                outside_goal_m: outside_m,
                since_ns,
            });
            assert_eq!(report.update(&status, &[]), Vec::from_iter(expected));
        }
        report.reset();
        let born = StatusHeader { moving: 0, ..status(0, 0.0, 0) };
        assert!(report.update(&born, &[]).is_empty(), "it has not begun to move");
        let own = StatusChange::GoalChanged { outside_goal_m: None, since_ns: 90 };
        assert_eq!(report.update(&status(0, 0.0, 90), &[]), [own]);
    }
}
