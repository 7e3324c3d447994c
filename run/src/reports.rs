//! Newest status of a robot, and the changes in it. Must not depend on how the status arrived.

use protocol::law_message::SentCounts;
use protocol::message::{NeighborStatus, ReceptionState, StatusHeader};

/// Status of a robot, as it last reported it.
#[derive(Debug, Clone)]
pub struct RobotReport {
    /// Reception state of each robot, and since when, ns.
    reception_states: Vec<(ReceptionState, u64)>,
    /// Run time, ns, since which each robot is used as a reference, or no longer is; 0 if this never changed.
    reference_use_since_ns: Vec<u64>,
    /// Reception state of the leader's frame, and since when, ns.
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
#[expect(missing_docs, reason = "`since_ns`: run time; `other_robot`: by index in the scenario")]
pub enum StatusChange {
    /// New reception state of another robot.
    ReceptionChanged { other_robot: usize, reception_state: ReceptionState, since_ns: u64 },
    /// New reception state of the leader's frame.
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
    /// Creates the status of one of `robots` robots, without any reception.
    pub fn new(robots: usize) -> RobotReport {
        let nothing_received = (ReceptionState::NothingReceived, 0);
        RobotReport {
            reception_states: vec![nothing_received; robots],
            reference_use_since_ns: vec![0; robots],
            leader_frame_reception: nothing_received,
            goal_m: None,
            has_replied: false,
            statuses_read: 0,
            earlier_and_current_counts: Default::default(),
        }
    }

    /// Resets the status for a replacement, which has received nothing and counts from 0.
    pub fn reset(&mut self) {
        *self = RobotReport {
            // The goal is reported again only if it differs from that of the predecessor.
            goal_m: self.goal_m,
            earlier_and_current_counts: [self.counts(), RobotCounts::default()],
            ..RobotReport::new(self.reception_states.len())
        };
    }

    /// Returns the reception state of another robot.
    pub fn reception_state(&self, other: usize) -> ReceptionState {
        self.reception_states[other].0
    }

    /// Returns whether the present process has replied to a sample.
    pub fn has_replied(&self) -> bool {
        self.has_replied
    }

    /// Returns the counts of all incarnations together.
    pub fn counts(&self) -> RobotCounts {
        let [earlier, current] = self.earlier_and_current_counts;
        RobotCounts {
            deadline_misses: earlier.deadline_misses + current.deadline_misses,
            rejected_beacons: earlier.rejected_beacons + current.rejected_beacons,
            old_odometry_samples: earlier.old_odometry_samples + current.old_odometry_samples,
            sent_counts: earlier.sent_counts.plus_next_incarnation(current.sent_counts),
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
        let mut changes = Vec::new();
        if let Some(reception_state) = ReceptionState::from_number(header.frame) {
            let since_ns = header.frame_since_t_ns;
            if update_reception_state(&mut self.leader_frame_reception, reception_state, since_ns) {
                changes
                    .push(StatusChange::LeaderFrameReceptionChanged { reception_state, since_ns });
            }
        }
        let outside_goal_m = header.goal().map(|(_, goal_m)| goal_m);
        if header.moving == 1 && outside_goal_m != self.goal_m {
            self.goal_m = outside_goal_m;
            let since_ns = header.goal().map_or(header.t_ns, |(since_ns, _)| since_ns);
            changes.push(StatusChange::GoalChanged { outside_goal_m, since_ns });
        }
        for status in neighbors {
            let Some(reception_state) = ReceptionState::from_number(status.contact) else {
                continue;
            };
            let Some(other_robot) = (status.robot as usize).checked_sub(1) else { continue };
            let Some(known_state) = self.reception_states.get_mut(other_robot) else { continue };
            if update_reception_state(known_state, reception_state, status.since_t_ns) {
                changes.push(StatusChange::ReceptionChanged {
                    other_robot,
                    reception_state,
                    since_ns: status.since_t_ns,
                });
            }
            let since_ns = status.goes_by_since_t_ns;
            if std::mem::replace(&mut self.reference_use_since_ns[other_robot], since_ns)
                != since_ns
            {
                changes.push(StatusChange::ReferenceUseChanged {
                    other_robot,
                    is_used: status.goes_by == 1,
                    since_ns,
                });
            }
        }
        changes
    }
}

/// Returns whether a reception state is a change to report, and stores it. The initial states, without
/// reception or with a closed backup edge, are not reported.
fn update_reception_state(
    known_state: &mut (ReceptionState, u64),
    reception_state: ReceptionState,
    since_ns: u64,
) -> bool {
    std::mem::replace(known_state, (reception_state, since_ns)) != *known_state
        && reception_state != ReceptionState::NothingReceived
}

#[cfg(test)]
mod tests {
    use super::*;

    fn neighbor_status(reception_state: ReceptionState, since_t_ns: u64) -> NeighborStatus {
        NeighborStatus {
            robot: 2,
            contact: reception_state as u64,
            since_t_ns,
            ..Default::default()
        }
    }

    #[test]
    fn replacement_reports_its_contacts_with_its_own_times() {
        let mut report = RobotReport::new(2);
        let mut update_report = |reception_state: ReceptionState, since_ns: u64| {
            let header = StatusHeader {
                frame: reception_state as u64,
                frame_since_t_ns: since_ns,
                deadline_misses: 3,
                beacons_refused: 1,
                odometry_old: 2,
                beacons_sent: 5,
                messages_sent: 4,
                ..StatusHeader::default()
            };
            if reception_state == ReceptionState::NothingReceived {
                report.reset();
            }
            (report.update(&header, &[neighbor_status(reception_state, since_ns)]), report.counts())
        };
        let reception_changes = |since_ns| {
            let reception_state = ReceptionState::Fresh;
            let other =
                StatusChange::ReceptionChanged { other_robot: 1, reception_state, since_ns };
            vec![StatusChange::LeaderFrameReceptionChanged { reception_state, since_ns }, other]
        };
        assert_eq!(update_report(ReceptionState::Fresh, 5).0, reception_changes(5));
        assert_eq!(update_report(ReceptionState::Fresh, 5).0, []);
        // Reported before it receives any beacon, as of the start of the run.
        assert_eq!(update_report(ReceptionState::NothingReceived, 0).0, []);
        let (second_changes, counts) = update_report(ReceptionState::Fresh, 90);
        assert_eq!(second_changes, reception_changes(90));
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
        let goal = |x_m| Some([x_m, 2.0]);
        assert!(report.update(&status(0, 0.0, 5), &[]).is_empty(), "to its own from the beginning");
        for (status, expected_change) in [
            (status(10, 1.0, 12), Some((goal(1.0), 10))),
            (status(10, 1.0, 20), None),
            (status(30, 1.0, 31), None),
            (status(40, 3.0, 42), Some((goal(3.0), 40))),
        ] {
            let expected = expected_change.map(|(outside_goal_m, since_ns)| {
                StatusChange::GoalChanged { outside_goal_m, since_ns }
            });
            assert_eq!(report.update(&status, &[]), Vec::from_iter(expected));
        }
        report.reset();
        let first_status = StatusHeader { moving: 0, ..status(0, 0.0, 0) };
        assert!(report.update(&first_status, &[]).is_empty(), "it has not begun to move");
        let own_goal = StatusChange::GoalChanged { outside_goal_m: None, since_ns: 90 };
        assert_eq!(report.update(&status(0, 0.0, 90), &[]), [own_goal]);
    }
}
