//! What a robot knows of those it hears: their newest beacons, how old these are, and what
//! silence makes of them.

use formation::Vec2;
use formation::desired::{Target, desired};
use formation::frame::LeaderFrame;
use protocol::age::{AgeSums, Sawtooth};
use protocol::brief::{NeighborBrief, SilenceBrief, SilencePolicy};
use protocol::message::{Beacon, Contact, NeighborStatus};

use crate::laws::situation::Heard;

/// The robots heard, in the order of the brief.
pub struct Neighborhood {
    neighbors: Vec<Neighbor>,
    silence: SilenceBrief,
    /// The freshest leader's frame that anybody passed on.
    frame: Option<HeardFrame>,
    frame_contact: Since,
    /// Stamp of the first sample, ns: silence counts from there.
    first_ns: Option<u64>,
}

struct Neighbor {
    index: u64,
    offset: Vec2,
    newest: Option<Beacon>,
    contact: Since,
    age: Sawtooth,
}

/// A leader's frame that somebody passed on.
#[derive(Debug, Clone, Copy)]
struct HeardFrame {
    /// Stamp of the leader's sample that it is from, ns.
    stamp_ns: u64,
    frame: LeaderFrame,
    /// When it came, ns.
    heard_ns: u64,
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
    /// Nobody was heard yet.
    pub fn new(neighbors: &[NeighborBrief], silence: SilenceBrief) -> Neighborhood {
        let neighbors = neighbors
            .iter()
            .map(|brief| Neighbor {
                index: brief.index as u64,
                offset: Vec2::from(brief.offset_m),
                newest: None,
                contact: Since::default(),
                age: Sawtooth::default(),
            })
            .collect();
        let frame_contact = Since::default();
        Neighborhood { neighbors, silence, frame: None, frame_contact, first_ns: None }
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
            && self.frame.is_none_or(|freshest| stamp_ns > freshest.stamp_ns)
        {
            self.frame = Some(HeardFrame { stamp_ns, frame, heard_ns: now_ns });
        }
        Ok(())
    }

    /// Judges everybody's silence as of an odometry sample; whether any contact changed.
    pub fn judge(&mut self, tick: u64, t_ns: u64, stamp_ns: u64) -> bool {
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        let silence = &self.silence;
        let judged = |heard_ns: Option<u64>| {
            let since_ns = stamp_ns.saturating_sub(heard_ns.unwrap_or(first_ns));
            match heard_ns {
                _ if since_ns > silence.lost_after_ns => Contact::Lost,
                None => Contact::Unheard,
                Some(_) if since_ns > silence.stale_after_ns => Contact::Stale,
                Some(_) => Contact::Fresh,
            }
        };
        let frame = self.frame.map(|heard| heard.heard_ns);
        // A formation without a leader never hears of one, and lacks nothing.
        let mut changed = frame.is_some() && self.frame_contact.turns(judged(frame), tick, t_ns);
        for neighbor in &mut self.neighbors {
            let heard = neighbor.newest.as_ref().map(|beacon| beacon.stamp_ns);
            changed |= neighbor.contact.turns(judged(heard), tick, t_ns);
        }
        changed
    }

    /// The freshest leader's frame heard, with its stamp, ns: what this robot passes on.
    pub fn frame(&self) -> Option<(u64, LeaderFrame)> {
        self.frame.map(|heard| (heard.stamp_ns, heard.frame))
    }

    /// The leader's frame at `stamp_ns`, extrapolated by its age. Once no newer one has come for as
    /// long as makes a neighbour lost, it stands still, so that nobody spins for ever around a dead
    /// leader. It is the silence that counts, not the age: a relay of many hops is old and well.
    pub fn frame_at(&self, stamp_ns: u64) -> Option<LeaderFrame> {
        let HeardFrame { stamp_ns: told_ns, frame, heard_ns } = self.frame?;
        let lost_after_ns = self.silence.lost_after_ns;
        let lost = stamp_ns.saturating_sub(heard_ns) > lost_after_ns;
        // All that have heard the same last of the leader stand by the same frame, whoever heard it
        // when: frames that differ by a hair would let mutual neighbours walk away together.
        let age_ns = if lost { lost_after_ns } else { stamp_ns.saturating_sub(told_ns) };
        let later = frame.later(age_ns as f64 / 1e9);
        Some(if lost { later.frozen() } else { later })
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

    /// alpha* by what was recalled: the mean of what all of them ask for. `None` where the robot is
    /// to stop: nobody left to go by, or somebody lost under `stop`. (13) (24) (45) (46)
    ///
    /// Once the leader's frame is lost, velocities count as 0: they are somebody's echo, and
    /// without a path from the leader an echo never dies away.
    pub fn desired(&self, heard: &[Heard]) -> Option<Target> {
        let lost = |neighbor: &Neighbor| neighbor.contact.contact == Contact::Lost;
        if self.silence.policy == SilencePolicy::Stop && self.neighbors.iter().any(lost) {
            return None;
        }
        let all_lost = heard.iter().all(|one| one.contact == Contact::Lost);
        let keep = match self.silence.policy {
            SilencePolicy::Keep => true,
            SilencePolicy::Last => all_lost,
            SilencePolicy::Ignore | SilencePolicy::Stop => false,
        };
        let counted = heard.iter().filter(|one| keep || one.contact != Contact::Lost);
        let target = desired(counted.map(|&Heard { position, velocity, offset, .. }| {
            (Target { position, velocity }, offset)
        }))?;
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
        self.neighbors
            .iter_mut()
            .map(move |neighbor| (neighbor.index as usize, neighbor.age.take(now_ns)))
    }

    /// How everybody is heard, for the supervisor.
    pub fn status(&self) -> impl ExactSizeIterator<Item = NeighborStatus> {
        self.neighbors.iter().map(|neighbor| NeighborStatus {
            robot: neighbor.index,
            contact: neighbor.contact.contact as u64,
            since_tick: neighbor.contact.tick,
            since_t_ns: neighbor.contact.t_ns,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn neighborhood(policy: SilencePolicy) -> Neighborhood {
        let neighbor = |name: &str, index| NeighborBrief {
            name: name.into(),
            index,
            offset_m: [0.0, 1.0],
            faults: Vec::new(),
        };
        let silence = SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy };
        Neighborhood::new(&[neighbor("a", 1), neighbor("b", 2)], silence)
    }

    fn beacon(incarnation: u64, stamp_ns: u64, x_m: f64) -> Beacon {
        Beacon {
            tick: 0,
            stamp_ns,
            sent_ns: 0,
            incarnation,
            x_m,
            y_m: 0.0,
            vx_m_s: 1e6,
            vy_m_s: 0.0,
            ..Beacon::default()
        }
    }

    fn desired(hood: &Neighborhood, stamp_ns: u64) -> Option<Target> {
        let mut heard = Vec::new();
        hood.recall(stamp_ns, Target::still, &mut heard);
        hood.desired(&heard)
    }

    fn contacts(neighborhood: &Neighborhood) -> Vec<u64> {
        neighborhood.status().map(|status| status.contact).collect()
    }

    #[test]
    fn a_silent_neighbor_turns_stale_then_lost_and_comes_back_with_its_next_incarnation() {
        let mut hood = neighborhood(SilencePolicy::Ignore);
        hood.hear(0, &beacon(0, 100, 1.0), 100).unwrap();
        for (stamp, contact) in [(100, 1), (130, 1), (131, 2), (300, 2), (301, 3)] {
            hood.judge(stamp, stamp, stamp);
            // b was never heard, and is given up as soon as if it had fallen silent at the start.
            let b = if stamp > 300 { Contact::Lost } else { Contact::Unheard };
            assert_eq!(contacts(&hood), [contact, b as u64], "at {stamp}");
            let age = (stamp <= 300).then_some((1, stamp - 100));
            assert_eq!(hood.ages(stamp).collect::<Vec<_>>(), Vec::from_iter(age));
        }
        hood.hear(0, &beacon(1, 290, 1.0), 301).unwrap();
        assert!(hood.judge(302, 302, 302));
        assert_eq!(contacts(&hood), [1, 3]);
    }

    #[test]
    fn beacons_that_lie_about_time_or_are_no_numbers_change_nothing() {
        let mut hood = neighborhood(SilencePolicy::Ignore);
        hood.hear(0, &beacon(1, 100, 1.0), 100).unwrap();
        let before = desired(&hood, 100);
        let refused = [
            (beacon(1, 100, 2.0), BeaconRefusal::Old),
            (beacon(1, 99, 2.0), BeaconRefusal::Old),
            (beacon(0, 101, 2.0), BeaconRefusal::Old),
            (beacon(1, 111, 2.0), BeaconRefusal::Future),
            (beacon(1, 105, f64::NAN), BeaconRefusal::NotFinite),
            (beacon(1, 105, f64::INFINITY), BeaconRefusal::NotFinite),
            (beacon(1, 105, 1e300), BeaconRefusal::NotPlausible),
            (beacon(1, 105, -1.001e9), BeaconRefusal::NotPlausible),
            (Beacon { vy_m_s: 1e300, ..beacon(1, 105, 2.0) }, BeaconRefusal::NotPlausible),
            (
                Beacon { frame_heading_rad: -1e300, ..beacon(1, 105, 2.0) },
                BeaconRefusal::NotPlausible,
            ),
            // It would be newer than whatever the honest robot says for the rest of the run.
            (beacon(u64::MAX, 105, 2.0), BeaconRefusal::NotPlausible),
        ];
        for (beacon, why) in refused {
            assert_eq!(hood.hear(0, &beacon, 110), Err(why));
        }
        assert_eq!(desired(&hood, 100), before);
    }

    #[test]
    fn the_lost_are_left_out_kept_standing_or_stop_the_robot_by_policy() {
        for (policy, at_lost) in [
            (SilencePolicy::Ignore, Some(Vec2::new(5.0, 1.0))),
            // a: 1 m + 200 ns of 1e6 m/s, b: 5 m; both + (0, 1)
            (SilencePolicy::Keep, Some(Vec2::new(3.1, 1.0))),
            (SilencePolicy::Stop, None),
        ] {
            let mut hood = neighborhood(policy);
            hood.hear(0, &beacon(0, 100, 1.0), 100).unwrap();
            hood.hear(1, &beacon(0, 400, 5.0), 400).unwrap();
            hood.judge(400, 400, 400);
            let desired = desired(&hood, 400).map(|target| target.position);
            assert_eq!(desired, at_lost, "{policy:?}");
        }
    }

    #[test]
    fn with_nobody_left_the_last_heard_say_where_to_stand() {
        let mut hood = neighborhood(SilencePolicy::Last);
        hood.hear(0, &beacon(0, 100, 1.0), 100).unwrap();
        hood.hear(1, &beacon(0, 400, 5.0), 400).unwrap();
        // a is lost: b alone counts; then both are: the middle of (1.2, 0) and (5.2, 0), + (0, 1).
        for (stamp_ns, expected) in [(400, Vec2::new(5.0, 1.0)), (900, Vec2::new(3.2, 1.0))] {
            hood.judge(stamp_ns, stamp_ns, stamp_ns);
            let target = desired(&hood, stamp_ns).unwrap();
            assert!((target.position - expected).norm() < 1e-9, "at {stamp_ns}: {target:?}");
        }
        assert_eq!(desired(&hood, 900).unwrap().velocity, Vec2::zeros());
    }

    #[test]
    fn the_freshest_frame_wins_ages_and_stands_still_once_lost() {
        let mut hood = neighborhood(SilencePolicy::Ignore);
        let frame =
            |heading_rad| LeaderFrame { heading_rad, turn_rate_rad_s: 1e7, ..LeaderFrame::STILL };
        assert_eq!(hood.frame_at(0), None);
        hood.hear(0, &beacon(0, 100, 1.0).with_frame(Some((90, frame(0.5)))), 100).unwrap();
        hood.hear(1, &beacon(0, 100, 1.0).with_frame(Some((80, frame(9.0)))), 100).unwrap();
        let close = |found: Option<LeaderFrame>, heading: f64, rate: f64| {
            let found = found.unwrap();
            (found.heading_rad - heading).abs() < 1e-9 && found.turn_rate_rad_s == rate
        };
        assert!(close(hood.frame_at(100), 0.6, 1e7));
        assert!(close(hood.frame_at(300), 2.6, 1e7), "heard at 100 ns, for a neighbour's 200 ns");
        assert!(close(hood.frame_at(1000), 2.5, 0.0), "then it is lost, 200 ns after it was told");
        for (stamp_ns, contact) in
            [(130, Contact::Fresh), (131, Contact::Stale), (301, Contact::Lost)]
        {
            assert!(hood.judge(stamp_ns, stamp_ns, stamp_ns) || contact == Contact::Lost);
            assert_eq!(hood.frame_contact().contact, contact, "at {stamp_ns} ns");
        }
    }

    #[test]
    fn a_frame_counts_as_heard_when_it_was_first_and_not_if_it_is_from_the_future() {
        let frame = |stamp_ns| Some((stamp_ns, LeaderFrame::STILL));
        let mut hood = neighborhood(SilencePolicy::Ignore);
        let early = beacon(0, 100, 1.0).with_frame(frame(101));
        assert_eq!(hood.hear(0, &early, 100), Err(BeaconRefusal::Future));
        assert_eq!(hood.hear(0, &beacon(0, 100, 1.0).with_frame(frame(100)), 100), Ok(()));
        // The same once more, by way of another: no news of the leader.
        assert_eq!(hood.hear(1, &beacon(0, 125, 1.0).with_frame(frame(100)), 125), Ok(()));
        hood.judge(131, 131, 131);
        assert_eq!(hood.frame_contact().contact, Contact::Stale);
    }

    #[test]
    fn everybody_has_a_place_and_an_age_that_is_summed_up_whoever_is_silent() {
        let mut hood = neighborhood(SilencePolicy::Ignore);
        assert_eq!([1, 2, 3].map(|robot| hood.place_of(robot)), [Some(0), Some(1), None]);
        hood.hear(1, &beacon(0, 100, 1.0), 110).unwrap();
        let sums: Vec<(usize, AgeSums)> = hood.take_ages(150).collect();
        // Over 40 ns from 10 to 50 ns: on average 30 ns.
        assert_eq!(sums[0], (1, AgeSums::default()));
        let (robot, AgeSums { heard, over_ns, peak_ns, .. }) = sums[1];
        assert_eq!((sums.len(), robot, heard, over_ns, peak_ns), (2, 2, 1, 40, 50));
        assert!((sums[1].1.mean_ns().unwrap() - 30.0).abs() < 1e-9);
        let again: Vec<u64> = hood.take_ages(160).map(|(_, sums)| sums.over_ns).collect();
        assert_eq!(again, [0, 10]);
    }

    #[test]
    fn a_frame_that_is_old_but_comes_regularly_is_not_lost() {
        let mut hood = neighborhood(SilencePolicy::Ignore);
        let frame = LeaderFrame { turn_rate_rad_s: 1e7, ..LeaderFrame::STILL };
        for now_ns in 1000..1100 {
            let heard = beacon(0, now_ns, 1.0).with_frame(Some((now_ns - 500, frame)));
            hood.hear(0, &heard, now_ns).unwrap();
            hood.judge(now_ns, now_ns, now_ns);
            assert_eq!(hood.frame_contact().contact, Contact::Fresh);
            let known = hood.frame_at(now_ns).unwrap();
            assert!((known.heading_rad - 5.0).abs() < 1e-9 && known.turn_rate_rad_s == 1e7);
        }
    }

    #[test]
    fn with_nobody_heard_there_is_nowhere_to_go() {
        assert_eq!(desired(&neighborhood(SilencePolicy::Ignore), 0), None);
    }

    #[test]
    fn what_is_recalled_of_each_is_extrapolated_and_says_how_old_it_is() {
        let mut hood = neighborhood(SilencePolicy::Ignore);
        hood.hear(0, &beacon(0, 100, 1.0), 100).unwrap();
        let mut heard = Vec::new();
        let turned = Target { position: Vec2::new(-1.0, 0.0), velocity: Vec2::new(0.0, 2.0) };
        let offset = |c_ji| {
            assert_eq!(c_ji, Vec2::new(0.0, 1.0));
            turned
        };
        for (stamp_ns, x_m, vx_m_s, contact) in [
            (120, 1.02, 1e6, Contact::Fresh),
            (200, 1.1, 1e6, Contact::Stale),
            (900, 1.2, 0.0, Contact::Lost), // given up 200 ns after it was heard
        ] {
            hood.judge(stamp_ns, stamp_ns, stamp_ns);
            hood.recall(stamp_ns, offset, &mut heard);
            let [one] = heard[..] else { panic!("b was never heard: {heard:?}") };
            assert!((one.position - Vec2::new(x_m, 0.0)).norm() < 1e-12, "{one:?}");
            assert_eq!(
                (one.index, one.velocity, one.contact),
                (1, Vec2::new(vx_m_s, 0.0), contact)
            );
            assert_eq!((one.offset, one.age_s), (turned, (stamp_ns - 100) as f64 / 1e9));
        }
    }

    /// theta_n with constant jerk and delta with constant acceleration, rad/s^3 and 1/s^2.
    #[derive(Debug, Clone, Copy)]
    struct Leader {
        start: LeaderFrame,
        jerk: f64,
        scale_acceleration: f64,
    }

    impl Leader {
        fn at(&self, t_s: f64) -> LeaderFrame {
            let frame = self.start.later(t_s);
            LeaderFrame {
                heading_rad: frame.heading_rad + self.jerk * t_s.powi(3) / 6.0,
                turn_rate_rad_s: frame.turn_rate_rad_s + self.jerk * t_s.powi(2) / 2.0,
                turn_acceleration_rad_s2: frame.turn_acceleration_rad_s2 + self.jerk * t_s,
                scale: frame.scale + self.scale_acceleration * t_s.powi(2) / 2.0,
                scale_rate_per_s: frame.scale_rate_per_s + self.scale_acceleration * t_s,
            }
        }
    }

    fn leaders() -> impl Strategy<Value = Leader> {
        let steady = prop_oneof![Just((0.0, 0.0)), (-4.0..4.0f64, -1.0..1.0f64)];
        let start = (-3.0..3.0f64, -2.0..2.0f64, -3.0..3.0f64, 0.5..2.0f64, -0.3..0.3f64);
        (start, steady).prop_map(|((heading, rate, acceleration, scale, growth), (jerk, bend))| {
            let start = LeaderFrame {
                heading_rad: heading,
                turn_rate_rad_s: rate,
                turn_acceleration_rad_s2: acceleration,
                scale,
                scale_rate_per_s: growth,
            };
            Leader { start, jerk, scale_acceleration: bend }
        })
    }

    proptest! {
        /// In lockstep, robot 0 leads and robot i hears a robot before it. What a robot d hops
        /// away knows is d ticks old, and off by what jerk did since: nothing, without any.
        #[test]
        fn on_any_tree_the_leaders_frame_arrives_after_as_many_ticks_as_hops_and_is_its_frame_now(
            parents in proptest::collection::vec(any::<proptest::sample::Index>(), 1..12),
            leader in leaders(),
            period_ns in 1_000_000..20_000_000u64,
        ) {
            let parents: Vec<usize> =
                parents.iter().enumerate().map(|(i, parent)| parent.index(i + 1)).collect();
            let mut depth = vec![0u64];
            for parent in &parents {
                depth.push(depth[*parent] + 1);
            }
            let lost_after_ns = 100 * period_ns;
            let policy = SilencePolicy::Ignore;
            let silence = SilenceBrief { stale_after_ns: lost_after_ns, lost_after_ns, policy };
            let mut hoods: Vec<Neighborhood> = parents
                .iter()
                .map(|parent| {
                    let index = parent + 1;
                    let heard = NeighborBrief {
                        name: "".into(),
                        index,
                        offset_m: [0.0, 0.0],
                        faults: Vec::new(),
                    };
                    Neighborhood::new(&[heard], silence.clone())
                })
                .collect();
            let mut said: Vec<Beacon> = Vec::new();
            for tick in 0..20 {
                let stamp_ns = tick * period_ns;
                let truth = leader.at(stamp_ns as f64 / 1e9);
                for (i, hood) in hoods.iter_mut().enumerate() {
                    if let Some(beacon) = said.get(parents[i]) {
                        hood.hear(0, beacon, stamp_ns).unwrap();
                    }
                    let known = hood.frame_at(stamp_ns);
                    prop_assert_eq!(known.is_some(), tick >= depth[i + 1]);
                    let Some(known) = known else { continue };
                    let age_s = (depth[i + 1] * period_ns) as f64 / 1e9;
                    let jerk = leader.jerk.abs();
                    let bend = leader.scale_acceleration.abs();
                    for (known, truth, bound) in [
                        (known.heading_rad, truth.heading_rad, jerk * age_s.powi(3) / 6.0),
                        (known.turn_rate_rad_s, truth.turn_rate_rad_s, jerk * age_s.powi(2) / 2.0),
                        (known.scale, truth.scale, bend * age_s.powi(2) / 2.0),
                    ] {
                        prop_assert!((known - truth).abs() <= bound + 1e-12, "{known} {truth}");
                    }
                }
                let frames = hoods.iter().map(Neighborhood::frame);
                let frames = std::iter::once(Some((stamp_ns, truth))).chain(frames);
                said = frames.map(|frame| beacon(0, stamp_ns, 0.0).with_frame(frame)).collect();
            }
        }
    }
}
