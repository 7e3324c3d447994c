//! What becomes of the stamps of a sample that crosses: on the wire all are the plant's, and on every
//! host those of its own clock.
//!
//! Where a stamp decides something, it is read as the earliest time that it may mean, so that a sample
//! is never taken for younger than it is; `sent_ns`, which only measures, as the most plausible.

use std::collections::BTreeMap;

use protocol::dropped::Dropped;
use protocol::message::{Beacon, Command, Odometry};

use crate::clock::{Bounds, Offset, Stamps};

/// What a host knows of time.
pub struct Times {
    is_plants: bool,
    offset: Offset,
    /// Of the samples delivered here, by their stamps here, ns: the plant's own, ns. An agent answers a sample by the
    /// former, and what crosses back carries the latter, exactly, so that a command's lifetime counts on the plant's
    /// clock alone.
    plant_stamps_ns: BTreeMap<u64, u64>,
    kept_ns: u64,
    /// The newest odometry delivered to each robot: its stamp here, ns.
    delivered_ns: Vec<u64>,
    /// The stamp of t = 0, by the plant's clock, ns.
    began_ns: Option<u64>,
    /// The round trip measured last, ns.
    round_trip_ns: u64,
    uncertainty_ns_max: u64,
}

impl Times {
    /// On the plant's host or on another. `kept_ns`: how long a stamp delivered here may be answered.
    pub fn new(is_plants: bool, robots: usize, kept_ns: u64) -> Times {
        Times {
            is_plants,
            offset: Offset::default(),
            plant_stamps_ns: BTreeMap::new(),
            kept_ns,
            delivered_ns: vec![0; robots],
            began_ns: None,
            round_trip_ns: 0,
            uncertainty_ns_max: 0,
        }
    }

    /// The clocks were compared; whether that went well.
    pub fn measured(&mut self, stamps: &Stamps) -> bool {
        self.round_trip_ns = stamps.round_trip_ns().unwrap_or(self.round_trip_ns);
        self.offset.take(stamps)
    }

    /// The round trip measured last, and the largest error of a stamp so far, ns.
    pub fn quality(&self) -> [u64; 2] {
        [self.round_trip_ns, self.uncertainty_ns_max]
    }

    fn bounds(&mut self, now_ns: u64) -> Result<Bounds, Dropped> {
        if self.is_plants {
            return Ok(Bounds::SAME);
        }
        let bounds = self.offset.at(now_ns).ok_or(Dropped::Clock)?;
        self.uncertainty_ns_max = self.uncertainty_ns_max.max(bounds.uncertainty_ns());
        Ok(bounds)
    }

    /// The time by the plant's clock, ns, as far as it is known.
    pub fn plant_ns(&mut self, now_ns: u64) -> Option<u64> {
        Some(self.bounds(now_ns).ok()?.middle_there(now_ns))
    }

    /// The stamp of t = 0, by the plant's clock, ns.
    pub fn run_began(&mut self, plant_ns: u64) {
        self.began_ns = Some(plant_ns);
    }

    /// Time since the run's start, ns; `None` before it.
    pub fn run_ns(&mut self, now_ns: u64) -> Option<u64> {
        let began_ns = self.began_ns?;
        Some(self.plant_ns(now_ns)?.saturating_sub(began_ns))
    }

    /// Nobody answers what is older than is kept.
    pub fn forget(&mut self, now_ns: u64) {
        let kept = self.plant_stamps_ns.split_off(&now_ns.saturating_sub(self.kept_ns));
        self.plant_stamps_ns = kept;
    }

    /// The plant's own stamp of what was delivered here under this one.
    fn own(&self, here_ns: u64) -> Result<u64, Dropped> {
        match self.is_plants {
            true => Ok(here_ns),
            false => self.plant_stamps_ns.get(&here_ns).copied().ok_or(Dropped::Unmatched),
        }
    }

    /// A beacon of this host, as it goes to others.
    pub fn beacon_out(&mut self, beacon: Beacon, now_ns: u64) -> Result<Beacon, Dropped> {
        let bounds = self.bounds(now_ns)?;
        let frame_ns = beacon.frame_stamp_ns;
        // The leader may have been lost long ago.
        let frame_ns = self.own(frame_ns).unwrap_or_else(|_| bounds.earliest_there(frame_ns));
        Ok(Beacon {
            stamp_ns: self.own(beacon.stamp_ns)?,
            sent_ns: bounds.middle_there(beacon.sent_ns),
            frame_stamp_ns: if beacon.frame_known == 1 { frame_ns } else { 0 },
            ..beacon
        })
    }

    /// A command of this host, as it goes to the plant's: it carries the plant's own stamp, exactly.
    pub fn command_out(&mut self, command: Command, now_ns: u64) -> Result<Command, Dropped> {
        let bounds = self.bounds(now_ns)?;
        let (stamp_ns, sent_ns) =
            (self.own(command.stamp_ns)?, bounds.middle_there(command.sent_ns));
        Ok(Command { stamp_ns, sent_ns, ..command })
    }

    /// A beacon of another host, unless it is too old.
    pub fn beacon_in(
        &mut self,
        beacon: Beacon,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Beacon, Dropped> {
        let bounds = self.bounds(now_ns)?;
        let stamp_ns = self.read(&bounds, beacon.stamp_ns, now_ns, age_ns_max)?;
        let mut frame_stamp_ns = 0;
        if beacon.frame_known == 1 {
            frame_stamp_ns = bounds.earliest_here(beacon.frame_stamp_ns);
            self.deliver(frame_stamp_ns, beacon.frame_stamp_ns);
        }
        let sent_ns = bounds.middle_here(beacon.sent_ns);
        Ok(Beacon { stamp_ns, sent_ns, frame_stamp_ns, ..beacon })
    }

    /// The plant's sample for a robot of this host, unless it is too old.
    pub fn odometry_in(
        &mut self,
        robot: usize,
        odometry: Odometry,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Odometry, Dropped> {
        self.run_began(odometry.stamp_ns.saturating_sub(odometry.t_ns));
        let bounds = self.bounds(now_ns)?;
        let stamp_ns = self.read(&bounds, odometry.stamp_ns, now_ns, age_ns_max)?;
        // What is known of the clock may have become less; a robot's time does not go back.
        if stamp_ns <= self.delivered_ns[robot] {
            return Err(Dropped::Clock);
        }
        self.delivered_ns[robot] = stamp_ns;
        self.deliver(stamp_ns, odometry.stamp_ns);
        Ok(Odometry { stamp_ns, sent_ns: bounds.middle_here(odometry.sent_ns), ..odometry })
    }

    /// A command for the plant of this host, unless it is too old.
    pub fn command_in(
        &mut self,
        command: Command,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Command, Dropped> {
        let bounds = self.bounds(now_ns)?;
        self.read(&bounds, command.stamp_ns, now_ns, age_ns_max)?;
        Ok(command)
    }

    /// The earliest time here that a stamp may mean, ns, if it is neither too old nor from the future.
    fn read(
        &self,
        bounds: &Bounds,
        plant_ns: u64,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<u64, Dropped> {
        let here_ns = bounds.earliest_here(plant_ns);
        match now_ns.checked_sub(here_ns) {
            Some(age_ns) if age_ns > age_ns_max => Err(Dropped::Old),
            Some(_) => Ok(here_ns),
            None => Err(Dropped::Implausible),
        }
    }

    fn deliver(&mut self, here_ns: u64, plant_ns: u64) {
        if !self.is_plants {
            self.plant_stamps_ns.insert(here_ns, plant_ns);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A host whose clock is 1 s behind the plant's; messages take 10 us.
    fn times() -> Times {
        let mut times = Times::new(false, 1, 1_000_000_000);
        assert!(times.measured(&Stamps {
            sent_ns: 5_000_000_000,
            there_taken_ns: 6_000_010_000,
            there_sent_ns: 6_000_010_000,
            taken_ns: 5_000_020_000,
        }));
        times
    }

    const NOW_NS: u64 = 5_001_000_000;

    fn odometry(stamp_ns: u64) -> Odometry {
        Odometry { stamp_ns, sent_ns: stamp_ns, t_ns: 500, ..Odometry::default() }
    }

    #[test]
    fn an_answer_carries_the_plants_own_stamp_exactly() {
        let mut times = times();
        let own_ns = 6_000_987_654;
        let sample = times.odometry_in(0, odometry(own_ns), NOW_NS, 10_000_000).unwrap();
        assert!(sample.stamp_ns < own_ns - 1_000_000_000, "read as older than it may be");
        let command = Command { stamp_ns: sample.stamp_ns, ..Command::default() };
        assert_eq!(times.command_out(command, NOW_NS).unwrap().stamp_ns, own_ns);
        let beacon = Beacon { stamp_ns: sample.stamp_ns, ..Beacon::default() };
        assert_eq!(times.beacon_out(beacon, NOW_NS).unwrap().stamp_ns, own_ns);
        let other = Command { stamp_ns: sample.stamp_ns + 1, ..Command::default() };
        assert_eq!(times.command_out(other, NOW_NS), Err(Dropped::Unmatched));
        times.forget(sample.stamp_ns + times.kept_ns);
        assert_eq!(times.command_out(command, NOW_NS).unwrap().stamp_ns, own_ns, "it is kept");
        times.forget(sample.stamp_ns + times.kept_ns + 1);
        assert_eq!(
            times.command_out(command, NOW_NS),
            Err(Dropped::Unmatched),
            "nobody answers it"
        );
        assert_eq!(times.run_ns(NOW_NS).unwrap() / 1_000, 12);
    }

    #[test]
    fn what_is_too_old_or_goes_back_is_dropped_with_its_reason() {
        let mut times = times();
        let mut take = |ns: u64| times.odometry_in(0, odometry(ns), NOW_NS, 10_000_000).map(drop);
        assert_eq!(take(6_000_900_000), Ok(()));
        assert_eq!(take(6_000_900_000), Err(Dropped::Clock));
        assert_eq!(take(5_990_000_000), Err(Dropped::Old));
        assert_eq!(take(6_002_000_000), Err(Dropped::Implausible));
        let mut unmeasured = Times::new(false, 1, 1);
        let early = unmeasured.odometry_in(0, odometry(1), NOW_NS, 10_000_000);
        assert_eq!(early, Err(Dropped::Clock));
    }

    #[test]
    fn a_commands_age_counts_on_the_plants_clock_alone() {
        let mut times = Times::new(true, 1, 1);
        let command = |stamp_ns| Command { stamp_ns, ..Command::default() };
        assert_eq!(times.command_in(command(900), 1_000, 100), Ok(command(900)));
        assert_eq!(times.command_in(command(899), 1_000, 100), Err(Dropped::Old));
        assert_eq!(times.command_in(command(1_001), 1_000, 100), Err(Dropped::Implausible));
    }
}
