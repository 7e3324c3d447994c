//! Conversion of the stamps of samples between hosts: on the wire they are times of the plant's clock, and on
//! each host times of its own clock.
//!
//! A stamp on which decisions depend is converted to the earliest time that it may mean, so that a sample is
//! never taken for newer than it is; `sent_ns`, which is used only for measurements, to the most plausible time.

use std::collections::BTreeMap;

use protocol::dropped::Dropped;
use protocol::message::{Beacon, Command, Odometry};

use crate::clock::{Bounds, Offset, Stamps};

/// Clock estimate and stamps of a host.
pub struct Times {
    is_plants: bool,
    offset: Offset,
    /// Original stamps of the plant by the stamps that were delivered here, ns. An agent answers a sample with
    /// the stamp delivered here; the answer is sent to the plant with the original one, so that the command
    /// timeout counts on the plant's clock alone.
    plant_stamps_ns: BTreeMap<u64, u64>,
    kept_ns: u64,
    /// Stamp of the newest odometry delivered to each robot, by the local clock, ns.
    delivered_ns: Vec<u64>,
    /// Stamp of t = 0 by the plant's clock, ns.
    began_ns: Option<u64>,
    /// Last measured round-trip time, ns.
    round_trip_ns: u64,
    uncertainty_ns_max: u64,
}

impl Times {
    /// Creates the times of a host. `kept_ns`: time for which a stamp delivered here may be answered, ns.
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

    /// Adds a clock measurement. Returns `false` if its stamps are inconsistent.
    pub fn measured(&mut self, stamps: &Stamps) -> bool {
        self.round_trip_ns = stamps.round_trip_ns().unwrap_or(self.round_trip_ns);
        self.offset.add_measurement(stamps)
    }

    /// Returns the last measured round-trip time and the maximum error of a stamp, ns.
    pub fn round_trip_and_error_ns(&self) -> [u64; 2] {
        [self.round_trip_ns, self.uncertainty_ns_max]
    }

    fn stamp_bounds(&mut self, now_ns: u64) -> Result<Bounds, Dropped> {
        if self.is_plants {
            return Ok(Bounds::SAME);
        }
        let bounds = self.offset.bounds_at(now_ns).ok_or(Dropped::Clock)?;
        self.uncertainty_ns_max = self.uncertainty_ns_max.max(bounds.uncertainty_ns());
        Ok(bounds)
    }

    /// Returns the time by the plant's clock, ns; `None` if it is unknown.
    pub fn plant_ns(&mut self, now_ns: u64) -> Option<u64> {
        Some(self.stamp_bounds(now_ns).ok()?.middle_remote_ns(now_ns))
    }

    /// Sets the stamp of t = 0 by the plant's clock, ns.
    pub fn run_began(&mut self, plant_ns: u64) {
        self.began_ns = Some(plant_ns);
    }

    /// Returns the time since the start of the run, ns; `None` before it.
    pub fn run_ns(&mut self, now_ns: u64) -> Option<u64> {
        let began_ns = self.began_ns?;
        Some(self.plant_ns(now_ns)?.saturating_sub(began_ns))
    }

    /// Removes stamps that are too old to be answered.
    pub fn forget(&mut self, now_ns: u64) {
        let kept = self.plant_stamps_ns.split_off(&now_ns.saturating_sub(self.kept_ns));
        self.plant_stamps_ns = kept;
    }

    /// Returns the plant's original stamp of a sample delivered here with stamp `here_ns`.
    fn plant_stamp_of(&self, here_ns: u64) -> Result<u64, Dropped> {
        match self.is_plants {
            true => Ok(here_ns),
            false => self.plant_stamps_ns.get(&here_ns).copied().ok_or(Dropped::Unmatched),
        }
    }

    /// Converts a beacon of this host for other hosts.
    pub fn convert_outgoing_beacon(
        &mut self,
        beacon: Beacon,
        now_ns: u64,
    ) -> Result<Beacon, Dropped> {
        let bounds = self.stamp_bounds(now_ns)?;
        let frame_ns = beacon.frame_stamp_ns;
        // The leader may have been lost long ago.
        let frame_ns =
            self.plant_stamp_of(frame_ns).unwrap_or_else(|_| bounds.earliest_remote_ns(frame_ns));
        Ok(Beacon {
            stamp_ns: self.plant_stamp_of(beacon.stamp_ns)?,
            sent_ns: bounds.middle_remote_ns(beacon.sent_ns),
            frame_stamp_ns: if beacon.frame_known == 1 { frame_ns } else { 0 },
            ..beacon
        })
    }

    /// Converts a command of this host for the plant's host: it carries the plant's original stamp.
    pub fn convert_outgoing_command(
        &mut self,
        command: Command,
        now_ns: u64,
    ) -> Result<Command, Dropped> {
        let bounds = self.stamp_bounds(now_ns)?;
        let (stamp_ns, sent_ns) =
            (self.plant_stamp_of(command.stamp_ns)?, bounds.middle_remote_ns(command.sent_ns));
        Ok(Command { stamp_ns, sent_ns, ..command })
    }

    /// Converts a beacon of another host, unless it is too old.
    pub fn convert_incoming_beacon(
        &mut self,
        beacon: Beacon,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Beacon, Dropped> {
        let bounds = self.stamp_bounds(now_ns)?;
        let stamp_ns = self.read(&bounds, beacon.stamp_ns, now_ns, age_ns_max)?;
        let mut frame_stamp_ns = 0;
        if beacon.frame_known == 1 {
            frame_stamp_ns = bounds.earliest_here(beacon.frame_stamp_ns);
            self.deliver(frame_stamp_ns, beacon.frame_stamp_ns);
        }
        let sent_ns = bounds.middle_here(beacon.sent_ns);
        Ok(Beacon { stamp_ns, sent_ns, frame_stamp_ns, ..beacon })
    }

    /// Converts the plant's odometry for a robot of this host, unless it is too old.
    pub fn convert_incoming_odometry(
        &mut self,
        robot: usize,
        odometry: Odometry,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Odometry, Dropped> {
        self.run_began(odometry.stamp_ns.saturating_sub(odometry.t_ns));
        let bounds = self.stamp_bounds(now_ns)?;
        let stamp_ns = self.read(&bounds, odometry.stamp_ns, now_ns, age_ns_max)?;
        // The clock estimate may have become less accurate; the time of a robot never goes back.
        if stamp_ns <= self.delivered_ns[robot] {
            return Err(Dropped::Clock);
        }
        self.delivered_ns[robot] = stamp_ns;
        self.deliver(stamp_ns, odometry.stamp_ns);
        Ok(Odometry { stamp_ns, sent_ns: bounds.middle_here(odometry.sent_ns), ..odometry })
    }

    /// Checks a command for the plant of this host, which must not be too old.
    pub fn check_incoming_command(
        &mut self,
        command: Command,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Command, Dropped> {
        let bounds = self.stamp_bounds(now_ns)?;
        self.read(&bounds, command.stamp_ns, now_ns, age_ns_max)?;
        Ok(command)
    }

    /// Returns the earliest local time that a stamp may mean, ns, unless it is too old or in the future.
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

    /// Returns the times of a host whose clock is 1 s behind the plant's; messages take 10 us.
    fn times() -> Times {
        let mut times = Times::new(false, 1, 1_000_000_000);
        assert!(times.measured(&Stamps {
            sent_ns: 5_000_000_000,
            remote_received_ns: 6_000_010_000,
            remote_sent_ns: 6_000_010_000,
            received_ns: 5_000_020_000,
        }));
        times
    }

    const NOW_NS: u64 = 5_001_000_000;

    fn odometry(stamp_ns: u64) -> Odometry {
        Odometry { stamp_ns, sent_ns: stamp_ns, t_ns: 500, ..Odometry::default() }
    }

    #[test]
    fn command_carries_the_exact_stamp_of_the_plant() {
        let mut times = times();
        let own_ns = 6_000_987_654;
        let sample =
            times.convert_incoming_odometry(0, odometry(own_ns), NOW_NS, 10_000_000).unwrap();
        assert!(sample.stamp_ns < own_ns - 1_000_000_000, "read as older than it may be");
        let command = Command { stamp_ns: sample.stamp_ns, ..Command::default() };
        assert_eq!(times.convert_outgoing_command(command, NOW_NS).unwrap().stamp_ns, own_ns);
        let beacon = Beacon { stamp_ns: sample.stamp_ns, ..Beacon::default() };
        assert_eq!(times.convert_outgoing_beacon(beacon, NOW_NS).unwrap().stamp_ns, own_ns);
        let other = Command { stamp_ns: sample.stamp_ns + 1, ..Command::default() };
        assert_eq!(times.convert_outgoing_command(other, NOW_NS), Err(Dropped::Unmatched));
        times.forget(sample.stamp_ns + times.kept_ns);
        assert_eq!(
            times.convert_outgoing_command(command, NOW_NS).unwrap().stamp_ns,
            own_ns,
            "it is kept"
        );
        times.forget(sample.stamp_ns + times.kept_ns + 1);
        assert_eq!(
            times.convert_outgoing_command(command, NOW_NS),
            Err(Dropped::Unmatched),
            "no command may answer it"
        );
        assert_eq!(times.run_ns(NOW_NS).unwrap() / 1_000, 12);
    }

    #[test]
    fn old_or_backward_sample_is_dropped_with_its_reason() {
        let mut times = times();
        let mut take = |ns: u64| {
            times.convert_incoming_odometry(0, odometry(ns), NOW_NS, 10_000_000).map(drop)
        };
        assert_eq!(take(6_000_900_000), Ok(()));
        assert_eq!(take(6_000_900_000), Err(Dropped::Clock));
        assert_eq!(take(5_990_000_000), Err(Dropped::Old));
        assert_eq!(take(6_002_000_000), Err(Dropped::Implausible));
        let mut unmeasured = Times::new(false, 1, 1);
        let early = unmeasured.convert_incoming_odometry(0, odometry(1), NOW_NS, 10_000_000);
        assert_eq!(early, Err(Dropped::Clock));
    }

    #[test]
    fn command_age_uses_the_clock_of_the_plant() {
        let mut times = Times::new(true, 1, 1);
        let command = |stamp_ns| Command { stamp_ns, ..Command::default() };
        assert_eq!(times.check_incoming_command(command(900), 1_000, 100), Ok(command(900)));
        assert_eq!(times.check_incoming_command(command(899), 1_000, 100), Err(Dropped::Old));
        assert_eq!(
            times.check_incoming_command(command(1_001), 1_000, 100),
            Err(Dropped::Implausible)
        );
    }
}
