//! What a robot said of itself up to now, and what of it is new. Must not: know how it was said.

use protocol::message::{Contact, NeighborStatus, StatusHeader};

/// How a robot is doing, as it says itself.
#[derive(Debug, Clone)]
pub struct Report {
    /// How it hears each robot, and since when, ns.
    contacts: Vec<(Contact, u64)>,
    /// Since when it goes by each robot, or no longer does, ns; 0: it always did, or never.
    gone_by_since_ns: Vec<u64>,
    /// How it hears the leader's frame, and since when, ns.
    frame: (Contact, u64),
    /// The goal from outside that is in force, m.
    goal_m: Option<[f64; 2]>,
    moves: bool,
    /// How many statuses of the process that is there now were taken.
    pub taken: u64,
    /// Counted by earlier incarnations, and by this one so far.
    counted: [Counts; 2],
}

/// What a robot counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Deadlines missed.
    pub misses: u64,
    /// Beacons refused.
    pub refused: u64,
    /// Samples that were too old for an answer, and got none.
    pub odometry_old: u64,
}

/// Something that a robot says for the first time.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "`since_ns`: run time; `other`: by place in the scenario")]
pub enum News {
    /// How it hears another.
    Heard { other: usize, contact: Contact, since_ns: u64 },
    /// How it hears the leader's frame.
    FrameHeard { contact: Contact, since_ns: u64 },
    /// That it goes by another, or no longer does: by a spare in place of whom it has given up.
    GoesBy { other: usize, yes: bool, since_ns: u64 },
    /// Where it goes, m: to a goal from outside, or again to its own.
    GoesTo { outside_m: Option<[f64; 2]>, since_ns: u64 },
}

impl Report {
    /// Of one of so many robots: it hears nobody yet.
    pub fn new(robots: usize) -> Report {
        let unheard = (Contact::Unheard, 0);
        Report {
            contacts: vec![unheard; robots],
            gone_by_since_ns: vec![0; robots],
            frame: unheard,
            goal_m: None,
            moves: false,
            taken: 0,
            counted: Default::default(),
        }
    }

    /// A replacement is started: it hears nobody, and counts from 0.
    pub fn begins_anew(&mut self) {
        *self = Report {
            // Where it goes is news only if that is elsewhere than before.
            goal_m: self.goal_m,
            counted: [self.counts(), Counts::default()],
            ..Report::new(self.contacts.len())
        };
    }

    /// How it hears another robot.
    pub fn contact(&self, other: usize) -> Contact {
        self.contacts[other].0
    }

    /// Whether the process that is there now has answered a sample.
    pub fn moves(&self) -> bool {
        self.moves
    }

    /// What it counted, all incarnations together.
    pub fn counts(&self) -> Counts {
        let [before, now] = self.counted;
        Counts {
            misses: before.misses + now.misses,
            refused: before.refused + now.refused,
            odometry_old: before.odometry_old + now.odometry_old,
        }
    }

    /// Takes in a status of the process that is there now; what is new of it.
    pub fn take(&mut self, header: &StatusHeader, neighbors: &[NeighborStatus]) -> Vec<News> {
        self.moves |= header.moving == 1;
        self.taken += 1;
        self.counted[1] = Counts {
            misses: header.deadline_misses,
            refused: header.beacons_refused,
            odometry_old: header.odometry_old,
        };
        let mut news = Vec::new();
        if let Some(contact) = Contact::from_number(header.frame) {
            let since_ns = header.frame_since_t_ns;
            if turns(&mut self.frame, contact, since_ns) {
                news.push(News::FrameHeard { contact, since_ns });
            }
        }
        let outside_m = header.goal().map(|(_, goal_m)| goal_m);
        if header.moving == 1 && outside_m != self.goal_m {
            self.goal_m = outside_m;
            let since_ns = header.goal().map_or(header.t_ns, |(since_ns, _)| since_ns);
            news.push(News::GoesTo { outside_m, since_ns });
        }
        for status in neighbors {
            let Some(contact) = Contact::from_number(status.contact) else { continue };
            let Some(other) = (status.robot as usize).checked_sub(1) else { continue };
            let Some(known) = self.contacts.get_mut(other) else { continue };
            if turns(known, contact, status.since_t_ns) {
                news.push(News::Heard { other, contact, since_ns: status.since_t_ns });
            }
            let since_ns = status.goes_by_since_t_ns;
            if std::mem::replace(&mut self.gone_by_since_ns[other], since_ns) != since_ns {
                news.push(News::GoesBy { other, yes: status.goes_by == 1, since_ns });
            }
        }
        news
    }
}

/// Whether it is news; that nobody was heard yet, or a spare is closed, is none.
fn turns(known: &mut (Contact, u64), contact: Contact, since_ns: u64) -> bool {
    std::mem::replace(known, (contact, since_ns)) != *known && contact != Contact::Unheard
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(contact: Contact, since_t_ns: u64) -> NeighborStatus {
        NeighborStatus { robot: 2, contact: contact as u64, since_t_ns, ..Default::default() }
    }

    #[test]
    fn a_replacement_says_anew_whom_it_hears_with_times_of_its_own() {
        let mut report = Report::new(2);
        let mut told = |contact: Contact, since_ns: u64| {
            let header = StatusHeader {
                frame: contact as u64,
                frame_since_t_ns: since_ns,
                deadline_misses: 3,
                beacons_refused: 1,
                odometry_old: 2,
                ..StatusHeader::default()
            };
            if contact == Contact::Unheard {
                report.begins_anew();
            }
            (report.take(&header, &[status(contact, since_ns)]), report.counts())
        };
        let heard = |since_ns| {
            let contact = Contact::Fresh;
            let other = News::Heard { other: 1, contact, since_ns };
            vec![News::FrameHeard { contact, since_ns }, other]
        };
        assert_eq!(told(Contact::Fresh, 5).0, heard(5));
        assert_eq!(told(Contact::Fresh, 5).0, []);
        // It says so before it hears anybody, as of the run's start.
        assert_eq!(told(Contact::Unheard, 0).0, []);
        let (again, counts) = told(Contact::Fresh, 90);
        assert_eq!(again, heard(90));
        assert_eq!(counts, Counts { misses: 6, refused: 2, odometry_old: 4 }, "of both");
    }

    #[test]
    fn where_a_robot_goes_is_news_once_and_again_when_its_replacement_goes_to_its_own_goal() {
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
        assert!(report.take(&status(0, 0.0, 5), &[]).is_empty(), "to its own from the beginning");
        for (status, news) in [
            (status(10, 1.0, 12), Some((to(1.0), 10))),
            (status(10, 1.0, 20), None),
            (status(30, 1.0, 31), None),
            (status(40, 3.0, 42), Some((to(3.0), 40))),
        ] {
            let expected = news.map(|(outside_m, since_ns)| News::GoesTo { outside_m, since_ns });
            assert_eq!(report.take(&status, &[]), Vec::from_iter(expected));
        }
        report.begins_anew();
        let born = StatusHeader { moving: 0, ..status(0, 0.0, 0) };
        assert!(report.take(&born, &[]).is_empty(), "it has not begun to move");
        let own = News::GoesTo { outside_m: None, since_ns: 90 };
        assert_eq!(report.take(&status(0, 0.0, 90), &[]), [own]);
    }
}
