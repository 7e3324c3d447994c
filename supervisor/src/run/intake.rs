//! What the plant and the robots say: truths, statuses, latencies. Must not: decide what follows.

use std::time::{Duration, Instant};

use protocol::message::{
    Contact, LatencyHeader, LatencyRow, NeighborStatus, StatusHeader, TruthHeader, TruthRow,
};
use protocol::service::{ServiceError, Subscriber};

use super::error::RunError;
use super::lives::Lives;
use super::services::Services;
use metrics::summary::ProcessUsage;
use results::latency::Latency;
use results::outcome::Outcome;

/// How often latencies are looked at, and in real time reports; each look costs a little for every
/// robot.
const REPORTS_EVERY: Duration = Duration::from_millis(10);

/// What was said, and through which ports.
pub(super) struct Intake {
    pub(super) truths: Subscriber<[TruthRow], TruthHeader>,
    /// Of the robots in scenario order.
    pub(super) statuses: Vec<Subscriber<[NeighborStatus], StatusHeader>>,
    /// Of the plant, then of the robots in scenario order, then of the control timer if there is one.
    latencies: Vec<Subscriber<[LatencyRow], LatencyHeader>>,
    /// How many reports had been sent when they were taken last, in lockstep.
    pub(super) reports_taken: Option<u32>,
    /// What the robots say, in scenario order.
    pub(super) reports: Vec<Report>,
    /// The newest truth.
    pub(super) newest: Option<TruthHeader>,
    /// When it was taken; or when a robot was started, which may take long.
    pub(super) last_news: Instant,
    /// When the first truth was taken.
    pub(super) began: Option<Instant>,
    pub(super) latency: Latency,
    taken: Instant,
}

impl Intake {
    /// Nothing was said yet.
    pub(super) fn new(services: &Services, latency: Latency) -> Result<Intake, ServiceError> {
        let statuses: Vec<_> =
            services.status.iter().map(|service| service.subscriber()).collect::<Result<_, _>>()?;
        let now = Instant::now();
        Ok(Intake {
            truths: services.truth.subscriber()?,
            latencies: services
                .latencies
                .iter()
                .map(|service| service.subscriber())
                .collect::<Result<_, _>>()?,
            reports: vec![Report::new(statuses.len()); statuses.len()],
            statuses,
            reports_taken: None,
            newest: None,
            last_news: now,
            began: None,
            latency,
            taken: now,
        })
    }

    /// Run time of the newest truth, ns.
    pub(super) fn now_ns(&self) -> u64 {
        self.newest.map_or(0, |header| header.t_ns)
    }

    /// Whether it is time to look for reports.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.taken.elapsed() >= REPORTS_EVERY;
        if due {
            self.taken = Instant::now();
        }
        due
    }

    /// Takes in what everybody measured of delays.
    pub(super) fn take_latencies(&mut self) -> Result<(), RunError> {
        self.latency.now(self.now_ns());
        for (process, subscriber) in self.latencies.iter().enumerate() {
            // Robots are late from their first sample on, and the control timer with them.
            let counts = self.began.is_some() || process <= self.reports.len();
            while let Some(sample) = subscriber.receive()? {
                let (header, rows) = (sample.user_header(), sample.payload());
                match counts {
                    true => self.latency.take(process, header, rows),
                    false => self.latency.leave_out(process, header, rows),
                }
            }
        }
        Ok(())
    }

    /// What it all came to.
    pub(super) fn into_outcome(
        self,
        launched: Instant,
        lives: &Lives,
        interrupted: bool,
        usages: Vec<ProcessUsage>,
    ) -> Outcome {
        let robots = 0..self.reports.len();
        Outcome {
            interrupted,
            startup: self.began.map(|at| at - launched),
            wall: self.began.map_or(Duration::ZERO, |at| self.last_news - at),
            truth: self.newest,
            deadline_misses: self.reports.iter().map(Report::misses).sum(),
            beacons_refused: self.reports.iter().map(Report::refused).collect(),
            restarts: robots.map(|robot| lives.incarnation(robot)).collect(),
            latency: self.latency,
            usages,
        }
    }
}

/// How a robot is doing, as it says itself.
#[derive(Debug, Clone)]
pub(super) struct Report {
    /// How it hears each robot, and since when, ns.
    contacts: Vec<(Contact, u64)>,
    /// How it hears the leader's frame, and since when, ns.
    frame: (Contact, u64),
    /// Deadline misses of earlier incarnations, and of this one so far.
    misses: [u64; 2],
    /// Beacons refused by earlier incarnations, and by this one so far.
    refused: [u64; 2],
}

/// Something that a robot says for the first time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum News {
    /// How it hears another.
    Heard { other: usize, contact: Contact, since_ns: u64 },
    /// How it hears the leader's frame.
    FrameHeard { contact: Contact, since_ns: u64 },
}

impl Report {
    fn new(robots: usize) -> Report {
        let unheard = (Contact::Unheard, 0);
        Report { contacts: vec![unheard; robots], frame: unheard, misses: [0; 2], refused: [0; 2] }
    }

    /// A replacement is started: it hears nobody, and counts from 0.
    pub(super) fn begins_anew(&mut self) {
        let [misses, refused] = [self.misses, self.refused].map(|counts| counts.iter().sum());
        let fresh = Report::new(self.contacts.len());
        *self = Report { misses: [misses, 0], refused: [refused, 0], ..fresh };
    }

    /// How it hears another robot.
    pub(super) fn contact(&self, other: usize) -> Contact {
        self.contacts[other].0
    }

    /// Deadlines it missed.
    pub(super) fn misses(&self) -> u64 {
        self.misses.iter().sum()
    }

    /// Beacons it refused.
    pub(super) fn refused(&self) -> u64 {
        self.refused.iter().sum()
    }

    /// Takes in a status of the process that is there now; what is new of it.
    pub(super) fn take(
        &mut self,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
    ) -> Vec<News> {
        self.misses[1] = header.deadline_misses;
        self.refused[1] = header.beacons_refused;
        let mut news = Vec::new();
        if let Some(contact) = Contact::from_number(header.frame) {
            let since_ns = header.frame_since_t_ns;
            if turns(&mut self.frame, contact, since_ns) {
                news.push(News::FrameHeard { contact, since_ns });
            }
        }
        for &NeighborStatus { robot, contact, since_t_ns: since_ns, .. } in neighbors {
            let Some(contact) = Contact::from_number(contact) else { continue };
            let Some(other) = (robot as usize).checked_sub(1) else { continue };
            let Some(known) = self.contacts.get_mut(other) else { continue };
            if turns(known, contact, since_ns) {
                news.push(News::Heard { other, contact, since_ns });
            }
        }
        news
    }
}

/// Whether it is news; that nobody was heard yet is none.
fn turns(known: &mut (Contact, u64), contact: Contact, since_ns: u64) -> bool {
    contact != Contact::Unheard && std::mem::replace(known, (contact, since_ns)) != *known
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(contact: Contact, since_t_ns: u64) -> NeighborStatus {
        NeighborStatus { robot: 2, contact: contact as u64, since_tick: 0, since_t_ns }
    }

    #[test]
    fn a_replacement_says_anew_whom_it_hears_with_times_of_its_own() {
        let mut report = Report::new(2);
        let frame = |contact: Contact, frame_since_t_ns| StatusHeader {
            frame: contact as u64,
            frame_since_t_ns,
            deadline_misses: 3,
            beacons_refused: 1,
            ..StatusHeader::default()
        };
        let heard = |since_ns| News::Heard { other: 1, contact: Contact::Fresh, since_ns };
        let frame_heard = |since_ns| News::FrameHeard { contact: Contact::Fresh, since_ns };
        let first = report.take(&frame(Contact::Fresh, 5), &[status(Contact::Fresh, 4)]);
        assert_eq!(first, [frame_heard(5), heard(4)]);
        assert!(report.take(&frame(Contact::Fresh, 5), &[status(Contact::Fresh, 4)]).is_empty());
        report.begins_anew();
        assert_eq!(report.contact(1), Contact::Unheard);
        // It says so before it hears anybody, as of the run's start.
        let born = report.take(&frame(Contact::Unheard, 0), &[status(Contact::Unheard, 0)]);
        assert!(born.is_empty(), "{born:?}");
        let again = report.take(&frame(Contact::Fresh, 95), &[status(Contact::Fresh, 90)]);
        assert_eq!(again, [frame_heard(95), heard(90)]);
        assert_eq!((report.misses(), report.refused()), (6, 2), "of both");
    }
}
