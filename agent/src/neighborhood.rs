//! What a robot knows of those it hears: their newest beacons, how old these are, and what
//! silence makes of them; and who takes the place of those lost for long.

mod frames;
mod repair;

use std::iter::repeat_n;

use formation::Vec2;
use formation::desired::{Target, desired};
use formation::frame::LeaderFrame;
use formation::resilient::{Said, resilient_frame, resilient_target};
use protocol::age::{AgeSums, Sawtooth};
use protocol::brief::{AgentBrief, NeighborBrief, SilenceBrief, SilencePolicy};
use protocol::message::{Beacon, Contact, NeighborStatus};
use protocol::planted;

use crate::laws::situation::Heard;
use frames::Frames;
pub use frames::HeardFrame;
use repair::{GivenUp, GoesBy, Opened, Successions};

/// The robots heard and the spares, in the order of the brief: places are counted over both.
pub struct Neighborhood {
    neighbors: Vec<Neighbor>,
    /// From this place on they are spares.
    spares_from: usize,
    is_repaired: bool,
    repair_after_ns: u64,
    successions: Successions,
    silence: SilenceBrief,
    /// F: how many of those heard are left out on either side.
    liars_max: usize,
    /// The frames of leaders that anybody passed on.
    frames: Frames,
    frame_contact: Since,
    /// Stamp of the first sample, ns: silence counts from there.
    first_ns: Option<u64>,
    /// It led before, and hears its deputies, its spares, until it takes back the lead.
    resumes: bool,
}

struct Neighbor {
    index: u64,
    /// Never left out as a liar.
    trusted: bool,
    offset: Vec2,
    /// In place of which in-neighbours it counts, see [`NeighborBrief::replaces`].
    replaces: Vec<u64>,
    /// A spare that replaces anybody; one by which the robot keeps the place of a leader that it takes.
    for_anybody: bool,
    for_place: bool,
    newest: Option<Beacon>,
    contact: Since,
    age: Sawtooth,
    given_up: GivenUp,
    goes_by: GoesBy,
    /// Of a spare, since when it is listened to.
    opened: Option<Opened>,
}

impl Neighbor {
    fn new(own: &AgentBrief, brief: &NeighborBrief, is_spare: bool) -> Neighbor {
        let is_in = |robots: &[usize]| robots.contains(&brief.index);
        let for_place = own.successions.iter().any(|one| is_in(&one.by));
        let is_deputy = own.successions.iter().any(|one| is_in(&one.deputies));
        Neighbor {
            index: brief.index as u64,
            trusted: brief.trusted,
            offset: Vec2::from(brief.offset_m),
            replaces: brief.replaces.iter().map(|&robot| robot as u64).collect(),
            for_anybody: is_spare && !for_place && !is_deputy && brief.replaces.is_empty(),
            for_place,
            newest: None,
            contact: Since::default(),
            age: Sawtooth::default(),
            given_up: GivenUp::default(),
            goes_by: GoesBy { yes: !is_spare, since_t_ns: 0 },
            opened: None,
        }
    }

    /// Whether it is listened to, and not lost.
    fn is_heard(&self) -> bool {
        self.newest.is_some() && self.contact.contact != Contact::Lost
    }

    /// What was known of a spare is forgotten.
    fn close(&mut self) {
        self.newest = None;
        self.contact = Since::default();
        self.age = Sawtooth::default();
        self.given_up = GivenUp::default();
        self.opened = None;
    }
}

/// A frame of `told_ns` at `then_ns`, later or earlier.
fn at(told_ns: u64, frame: LeaderFrame, then_ns: u64) -> LeaderFrame {
    frame.later((then_ns as i64 - told_ns as i64) as f64 / 1e9)
}

/// How somebody is heard, and since when.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Since {
    /// How.
    pub contact: Contact,
    /// Since this tick.
    pub tick: u64,
    /// The same as time since the run's start, ns.
    pub t_ns: u64,
}

impl Since {
    /// Whether it turns into something else now.
    fn turns(&mut self, contact: Contact, tick: u64, t_ns: u64) -> bool {
        let turned = contact != self.contact;
        if turned {
            *self = Since { contact, tick, t_ns };
        }
        turned
    }
}

/// Why a beacon was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BeaconRefusal {
    /// A number in it is NaN or infinite.
    #[error("not finite")]
    NotFinite,
    /// A number in it is larger than any robot's.
    #[error("not plausible")]
    NotPlausible,
    /// Its stamp lies ahead of the clock.
    #[error("from the future")]
    Future,
    /// Not newer, by incarnation and then stamp, than the newest beacon heard.
    #[error("older than the newest heard")]
    Old,
}

impl Neighborhood {
    /// Nobody was heard yet. `incarnation`: how often the robot's process was started before.
    pub fn new(brief: &AgentBrief, incarnation: u64) -> Neighborhood {
        let neighbors = brief.neighbors.iter().map(|sender| Neighbor::new(brief, sender, false));
        let spares = brief.spares.iter().map(|sender| Neighbor::new(brief, sender, true));
        Neighborhood {
            neighbors: neighbors.chain(spares).collect(),
            spares_from: brief.neighbors.len(),
            is_repaired: brief.is_repaired(),
            repair_after_ns: brief.repair_after_ns,
            successions: Successions::new(brief),
            silence: brief.silence.clone(),
            liars_max: brief.liars_max(),
            frames: Frames::new(brief),
            frame_contact: Since::default(),
            first_ns: None,
            resumes: brief.lead.is_some() && !brief.spares.is_empty() && incarnation > 0,
        }
    }

    /// Of each spare its place, and the tick at which it was opened, if it is listened to.
    pub fn spares(&self) -> impl Iterator<Item = (usize, Option<u64>)> {
        let spares = self.neighbors.iter().enumerate().skip(self.spares_from);
        spares.map(|(place, spare)| (place, spare.opened.map(|opened| opened.tick)))
    }

    /// Whether a beacon of this tick counts if the sender at `place` is listened to. What a spare said up to
    /// the tick at which it was opened may or may not be in the queue, and counts for nothing.
    pub fn awaits(&self, place: usize, tick: u64) -> bool {
        place < self.spares_from
            || self.neighbors[place].opened.is_some_and(|opened| tick > opened.tick)
    }

    /// Where in the brief's order a robot is heard, by its place in the scenario from 1.
    pub fn place_of(&self, robot: u64) -> Option<usize> {
        self.neighbors.iter().position(|neighbor| neighbor.index == robot)
    }

    /// Takes a beacon of the neighbour at `place` (in the brief's order).
    pub fn hear(
        &mut self,
        place: usize,
        beacon: &Beacon,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        let neighbor = &mut self.neighbors[place];
        if !beacon.is_finite() {
            return Err(BeaconRefusal::NotFinite);
        }
        if !beacon.is_plausible() {
            return Err(BeaconRefusal::NotPlausible);
        }
        let frame = beacon.frame();
        if beacon.stamp_ns > now_ns || frame.is_some_and(|(stamp_ns, _)| stamp_ns > now_ns) {
            return Err(BeaconRefusal::Future);
        }
        let order = |b: &Beacon| (b.incarnation, b.stamp_ns);
        if neighbor.newest.as_ref().is_some_and(|newest| order(beacon) <= order(newest)) {
            return Err(BeaconRefusal::Old);
        }
        neighbor.newest = Some(*beacon);
        neighbor.age.heard(beacon.stamp_ns, now_ns);
        if let Some((stamp_ns, frame)) = frame
            && self.liars_max == 0
        {
            self.frames.hear(beacon.frame_rank, stamp_ns, frame, now_ns);
        }
        Ok(())
    }

    /// Judges everybody's silence as of an odometry sample, and whom to go by; whether any of it changed.
    pub fn judge(&mut self, tick: u64, t_ns: u64, stamp_ns: u64) -> bool {
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        if self.liars_max > 0 {
            self.agree_on_a_frame(stamp_ns);
        }
        let silence = &self.silence;
        let judged = |heard_ns: Option<u64>, from_ns: u64| {
            let since_ns = stamp_ns.saturating_sub(heard_ns.unwrap_or(from_ns));
            match heard_ns {
                _ if since_ns > silence.lost_after_ns => Contact::Lost,
                None => Contact::Unheard,
                Some(_) if since_ns > silence.stale_after_ns => Contact::Stale,
                Some(_) => Contact::Fresh,
            }
        };
        let frame = self.frames.in_force(stamp_ns).map(|heard| heard.heard_ns);
        // A formation without a leader never hears of one, and lacks nothing.
        let mut changed =
            frame.is_some() && self.frame_contact.turns(judged(frame, first_ns), tick, t_ns);
        self.resumes &= judged(frame, first_ns) != Contact::Lost;
        let (neighbors, spares) = self.neighbors.split_at_mut(self.spares_from);
        let listened = spares.iter_mut().filter_map(|spare| {
            let from_ns = spare.opened?.stamp_ns;
            Some((spare, from_ns))
        });
        for (sender, from_ns) in neighbors.iter_mut().map(|it| (it, first_ns)).chain(listened) {
            let heard = sender.newest.as_ref().map(|beacon| beacon.stamp_ns);
            changed |= sender.contact.turns(judged(heard, from_ns), tick, t_ns);
        }
        let now = Opened { tick, stamp_ns };
        if self.resumes {
            spares.iter_mut().for_each(|spare| _ = spare.opened.get_or_insert(now));
        } else if self.is_repaired {
            let (successions, after_ns) = (&mut self.successions, self.repair_after_ns);
            changed |= repair::repair(neighbors, spares, successions, after_ns, now, t_ns);
        }
        changed
    }

    /// The frame to go by at `stamp_ns`, and to pass on: that of the best rank that is not lost, or else the last
    /// that was heard.
    pub fn frame(&self, stamp_ns: u64) -> Option<&HeardFrame> {
        self.frames.in_force(stamp_ns)
    }

    /// Whether the robot led before, and has not taken back the lead: a deputy is heard that leads, and it is not
    /// on its path yet.
    pub fn resumes(&self) -> bool {
        self.resumes
    }

    /// The robot is on its path, and takes back the lead if somebody told it how the frame goes on.
    pub fn arrived(&mut self) {
        self.resumes &= self.frame_contact.contact == Contact::Unheard;
    }

    /// The leader's frame at `stamp_ns`, extrapolated by its age. Once no newer one has come for as
    /// long as makes a neighbour lost, it stands still, so that nobody spins for ever around a dead
    /// leader. It is the silence that counts, not the age: a relay of many hops is old and well.
    pub fn frame_at(&self, stamp_ns: u64) -> Option<LeaderFrame> {
        let &HeardFrame { stamp_ns: told_ns, frame, heard_ns, .. } = self.frame(stamp_ns)?;
        let lost_after_ns = self.silence.lost_after_ns;
        let lost = stamp_ns.saturating_sub(heard_ns) > lost_after_ns;
        // All that have heard the same last of the leader stand by the same frame, whoever heard it
        // when: frames that differ by a hair would let mutual neighbours walk away together.
        let age_ns = if lost { lost_after_ns } else { stamp_ns.saturating_sub(told_ns) };
        let age_ns = if planted::is("frame-not-extrapolated") { 0 } else { age_ns };
        let later = frame.later(age_ns as f64 / 1e9);
        Some(if lost { later.frozen() } else { later })
    }

    /// Where some of those heard may lie: goes by the frame of the leader itself, if that is heard, and else by
    /// what W-MSR makes of what the others pass on, at a stamp that `liars_max` of them surpass.
    fn agree_on_a_frame(&mut self, now_ns: u64) {
        let heard = self.neighbors.iter().filter(|one| one.contact.contact != Contact::Lost);
        let heard = heard.filter_map(|one| Some((one.trusted, one.newest.as_ref()?.frame()?)));
        let (trusted, others): (Vec<_>, Vec<_>) = heard.partition(|(trusted, _)| *trusted);
        let mut stamps: Vec<u64> = others.iter().map(|(_, (stamp_ns, _))| *stamp_ns).collect();
        stamps.sort_unstable_by(|a, b| b.cmp(a));
        let own = self.frames.of_the_main_leader().copied();
        let is_news = |stamp_ns: &u64| own.is_none_or(|own| *stamp_ns > own.stamp_ns);
        let own_at = |stamp_ns| own.map(|own| at(own.stamp_ns, own.frame, stamp_ns));
        let newest = trusted.iter().map(|(_, told)| *told).max_by_key(|(stamp_ns, _)| *stamp_ns);
        let agreed = match (newest, stamps.get(self.liars_max)) {
            (Some((stamp_ns, frame)), _) => is_news(&stamp_ns).then_some((stamp_ns, frame)),
            (None, Some(&stamp_ns)) => {
                let then = others.iter().map(|&(_, (told_ns, frame))| at(told_ns, frame, stamp_ns));
                let then: Vec<LeaderFrame> = then.collect();
                let agreed = is_news(&stamp_ns)
                    .then(|| resilient_frame(own_at(stamp_ns), &then, self.liars_max));
                agreed.flatten().map(|frame| (stamp_ns, frame))
            }
            (None, None) => None,
        };
        if let Some((stamp_ns, frame)) = agreed {
            self.frames.hear(0, stamp_ns, frame, now_ns);
        }
    }

    /// How the leader's frame is heard, and since when.
    pub fn frame_contact(&self) -> Since {
        self.frame_contact
    }

    /// Fills `heard` with what is known of everybody who was ever heard, as of `stamp_ns`, with
    /// offsets C_ji = `offset`(c_ji). Positions are extrapolated by the published velocity; those
    /// of the lost stand still where they were given up.
    pub fn recall(&self, stamp_ns: u64, offset: impl Fn(Vec2) -> Target, heard: &mut Vec<Heard>) {
        heard.clear();
        heard.extend(self.neighbors.iter().filter_map(|neighbor| {
            let beacon = neighbor.newest.as_ref()?;
            let age_s = (stamp_ns as i64 - beacon.stamp_ns as i64) as f64 / 1e9;
            let said = Target { position: beacon.position(), velocity: beacon.velocity() };
            let contact = neighbor.contact.contact;
            let alpha_j = match contact {
                Contact::Lost => {
                    Target::still(said.later(self.silence.lost_after_ns as f64 / 1e9).position)
                }
                _ => said.later(age_s),
            };
            Some(Heard {
                index: neighbor.index as usize,
                position: alpha_j.position,
                velocity: alpha_j.velocity,
                offset: offset(neighbor.offset),
                age_s,
                contact,
            })
        }));
    }

    /// Whether somebody whom it hears as planned was lost for so long that others replace it, if there are any.
    pub fn has_given_up(&self) -> bool {
        self.neighbors[..self.spares_from].iter().any(|neighbor| neighbor.given_up.yes)
    }

    /// Whether it takes the place of a leader that is given up, and keeps it by those that it hears for that alone.
    pub fn takes_place(&self) -> bool {
        self.successions.takes_place
    }

    /// How often a sender that is gone by counts.
    fn times(&self, place: usize) -> usize {
        let Neighbor { index, replaces, for_anybody, for_place, .. } = &self.neighbors[place];
        let in_neighbors = &self.neighbors[..self.spares_from];
        let is_replaced =
            |robot: &u64| in_neighbors.iter().any(|one| one.index == *robot && !one.goes_by.yes);
        let once = place < self.spares_from || *for_anybody || *for_place;
        let replaced = replaces.iter().copied().chain(self.successions.taken_by(*index));
        usize::from(once) + replaced.filter(is_replaced).count()
    }

    /// alpha* by what was recalled: the mean of what all of them ask for, but for in-neighbours that others
    /// replace. `None` where the robot is to stop: nobody left to go by, or somebody lost under `stop`.
    /// (13) (24) (45) (46)
    ///
    /// Once the leader's frame is lost, velocities count as 0: they are somebody's echo, and
    /// without a path from the leader an echo never dies away.
    pub fn desired(&self, heard: &[Heard]) -> Option<Target> {
        self.desired_by(heard, |said| desired(said.map(|(alpha_j, c_ji, _)| (alpha_j, c_ji))))
    }

    /// The same without what liars may have said: W-MSR in place of the mean. `own`: where the robot is, m,
    /// and the velocity that it last desired, m/s.
    pub fn desired_despite_liars(&self, heard: &[Heard], own: Target) -> Option<Target> {
        self.desired_by(heard, |said| {
            let place = |(alpha_j, c_ji, trusted): (Target, Target, bool)| Said {
                value: Target {
                    position: alpha_j.position + c_ji.position,
                    velocity: alpha_j.velocity + c_ji.velocity,
                },
                trusted,
            };
            let said: Vec<Said<Target>> = said.map(place).collect();
            (!said.is_empty()).then(|| resilient_target(own, &said, self.liars_max))
        })
    }

    /// alpha* by what `mean` makes of alpha_j, C_ji and whether R_j is trusted.
    fn desired_by(
        &self,
        heard: &[Heard],
        mean: impl FnOnce(&mut dyn Iterator<Item = (Target, Target, bool)>) -> Option<Target>,
    ) -> Option<Target> {
        let lost = |neighbor: &Neighbor| neighbor.contact.contact == Contact::Lost;
        let mut gone_by = self.neighbors.iter().filter(|neighbor| neighbor.goes_by.yes);
        if self.silence.policy == SilencePolicy::Stop && gone_by.any(lost) {
            return None;
        }
        // In the order in which they were recalled.
        let places = self.neighbors.iter().enumerate();
        let known = places.filter(|(_, neighbor)| neighbor.newest.is_some());
        let gone_by = || heard.iter().zip(known.clone()).filter(|(_, (_, one))| one.goes_by.yes);
        let all_lost = gone_by().all(|(one, _)| one.contact == Contact::Lost);
        let keep = match self.silence.policy {
            SilencePolicy::Keep => true,
            SilencePolicy::Last => all_lost,
            SilencePolicy::Ignore | SilencePolicy::Stop => false,
        };
        let counted = gone_by().filter(|(one, _)| keep || one.contact != Contact::Lost);
        let mut said =
            counted.flat_map(|(&Heard { position, velocity, offset, .. }, (k, known))| {
                repeat_n((Target { position, velocity }, offset, known.trusted), self.times(k))
            });
        let target = mean(&mut said)?;
        let echo = self.frame_contact.contact == Contact::Lost;
        Some(if echo { Target::still(target.position) } else { target })
    }

    /// The age at `now_ns` of each beacon that is gone by, ns, with its sender's place in the
    /// scenario, from 1. Those never heard or lost are left out.
    pub fn ages(&self, now_ns: u64) -> impl Iterator<Item = (usize, u64)> {
        self.neighbors.iter().filter_map(move |neighbor| {
            let beacon = neighbor.newest.as_ref()?;
            let used = neighbor.contact.contact != Contact::Lost;
            used.then(|| (neighbor.index as usize, now_ns.saturating_sub(beacon.stamp_ns)))
        })
    }

    /// What the information age of everybody came to since this was asked last, with the sender's
    /// place in the scenario, from 1. The silent have one as well.
    pub fn take_ages(&mut self, now_ns: u64) -> impl Iterator<Item = (usize, AgeSums)> {
        let (neighbors, spares) = self.neighbors.split_at_mut(self.spares_from);
        let open = spares.iter_mut().filter(|spare| spare.opened.is_some());
        neighbors
            .iter_mut()
            .chain(open)
            .map(move |sender| (sender.index as usize, sender.age.take(now_ns)))
    }

    /// How everybody is heard, for the supervisor.
    pub fn status(&self) -> impl ExactSizeIterator<Item = NeighborStatus> {
        self.neighbors.iter().map(|neighbor| NeighborStatus {
            robot: neighbor.index,
            contact: neighbor.contact.contact as u64,
            since_tick: neighbor.contact.tick,
            since_t_ns: neighbor.contact.t_ns,
            goes_by: u64::from(neighbor.goes_by.yes),
            goes_by_since_t_ns: neighbor.goes_by.since_t_ns,
        })
    }
}

#[cfg(test)]
mod tests;
