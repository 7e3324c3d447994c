//! Conversion of the stamps of samples between hosts: on the wire they are times of the plant's clock, and on
//! each host times of its own clock.
//!
//! A stamp on which decisions depend is converted to the earliest time that it may mean, so that a sample is
//! never taken for newer than it is; `sent_ns`, which is used only for measurements, to the most plausible time.

use std::collections::BTreeMap;

use protocol::dropped::DropReason;
use protocol::message::{Beacon, Command, Odometry};

use crate::clock::{ClockOffsetEstimator, OffsetBounds, RoundTripStamps};

/// Clock estimate and stamps of a host.
pub struct StampConverter {
    is_plant_host: bool,
    offset_estimator: ClockOffsetEstimator,
    /// Original stamps of the plant by the stamps that were delivered here, ns. An agent answers a sample with
    /// the stamp delivered here; the answer is sent to the plant with the original one, so that the command
    /// timeout counts on the plant's clock alone.
    plant_stamps_ns: BTreeMap<u64, u64>,
    stamp_lifetime_ns: u64,
    /// Stamp of the newest odometry delivered to each robot, by the local clock, ns.
    newest_odometry_ns: Vec<u64>,
    /// Stamp of t = 0 by the plant's clock, ns.
    run_start_ns: Option<u64>,
    /// Last measured round-trip time, ns.
    round_trip_ns: u64,
    uncertainty_ns_max: u64,
}

impl StampConverter {
    /// Creates the times of a host. `stamp_lifetime_ns`: time for which a stamp delivered here may be answered, ns.
    pub fn new(is_plant_host: bool, robots: usize, stamp_lifetime_ns: u64) -> StampConverter {
        StampConverter {
            is_plant_host,
            offset_estimator: ClockOffsetEstimator::default(),
            plant_stamps_ns: BTreeMap::new(),
            stamp_lifetime_ns,
            newest_odometry_ns: vec![0; robots],
            run_start_ns: None,
            round_trip_ns: 0,
            uncertainty_ns_max: 0,
        }
    }

    /// Adds a clock measurement. Returns `false` if its stamps are inconsistent.
    pub fn add_measurement(&mut self, stamps: &RoundTripStamps) -> bool {
        self.round_trip_ns = stamps.round_trip_ns().unwrap_or(self.round_trip_ns);
        self.offset_estimator.add_measurement(stamps)
    }

    /// Returns the last measured round-trip time and the maximum error of a stamp, ns.
    pub fn round_trip_and_error_ns(&self) -> [u64; 2] {
        [self.round_trip_ns, self.uncertainty_ns_max]
    }

    fn offset_bounds(&mut self, now_ns: u64) -> Result<OffsetBounds, DropReason> {
        if self.is_plant_host {
            return Ok(OffsetBounds::SAME_CLOCK);
        }
        let bounds =
            self.offset_estimator.bounds_at(now_ns).ok_or(DropReason::UnconvertibleTime)?;
        self.uncertainty_ns_max = self.uncertainty_ns_max.max(bounds.uncertainty_ns());
        Ok(bounds)
    }

    /// Returns the time by the plant's clock, ns; `None` if it is unknown.
    pub fn plant_time_ns(&mut self, now_ns: u64) -> Option<u64> {
        Some(self.offset_bounds(now_ns).ok()?.middle_remote_ns(now_ns))
    }

    /// Sets the stamp of t = 0 by the plant's clock, ns.
    pub fn set_run_start(&mut self, plant_ns: u64) {
        self.run_start_ns = Some(plant_ns);
    }

    /// Returns the time since the start of the run, ns; `None` before it.
    pub fn run_time_ns(&mut self, now_ns: u64) -> Option<u64> {
        let run_start_ns = self.run_start_ns?;
        Some(self.plant_time_ns(now_ns)?.saturating_sub(run_start_ns))
    }

    /// Removes stamps that are too old to be answered.
    pub fn remove_old_stamps(&mut self, now_ns: u64) {
        let fresh_stamps =
            self.plant_stamps_ns.split_off(&now_ns.saturating_sub(self.stamp_lifetime_ns));
        self.plant_stamps_ns = fresh_stamps;
    }

    /// Returns the plant's original stamp of a sample delivered here with stamp `local_ns`.
    fn find_plant_stamp(&self, local_ns: u64) -> Result<u64, DropReason> {
        match self.is_plant_host {
            true => Ok(local_ns),
            false => self.plant_stamps_ns.get(&local_ns).copied().ok_or(DropReason::Unmatched),
        }
    }

    /// Converts a beacon of this host for other hosts.
    pub fn convert_outgoing_beacon(
        &mut self,
        beacon: Beacon,
        now_ns: u64,
    ) -> Result<Beacon, DropReason> {
        let bounds = self.offset_bounds(now_ns)?;
        let frame_ns = beacon.frame_stamp_ns;
        // The leader may have been lost long ago.
        let frame_ns =
            self.find_plant_stamp(frame_ns).unwrap_or_else(|_| bounds.earliest_remote_ns(frame_ns));
        Ok(Beacon {
            stamp_ns: self.find_plant_stamp(beacon.stamp_ns)?,
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
    ) -> Result<Command, DropReason> {
        let bounds = self.offset_bounds(now_ns)?;
        let (stamp_ns, sent_ns) =
            (self.find_plant_stamp(command.stamp_ns)?, bounds.middle_remote_ns(command.sent_ns));
        Ok(Command { stamp_ns, sent_ns, ..command })
    }

    /// Converts a beacon of another host, unless it is too old.
    pub fn convert_incoming_beacon(
        &mut self,
        beacon: Beacon,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Beacon, DropReason> {
        let bounds = self.offset_bounds(now_ns)?;
        let stamp_ns = self.check_stamp_age(&bounds, beacon.stamp_ns, now_ns, age_ns_max)?;
        let mut frame_stamp_ns = 0;
        if beacon.frame_known == 1 {
            frame_stamp_ns = bounds.earliest_local_ns(beacon.frame_stamp_ns);
            self.store_plant_stamp(frame_stamp_ns, beacon.frame_stamp_ns);
        }
        let sent_ns = bounds.middle_local_ns(beacon.sent_ns);
        Ok(Beacon { stamp_ns, sent_ns, frame_stamp_ns, ..beacon })
    }

    /// Converts the plant's odometry for a robot of this host, unless it is too old.
    pub fn convert_incoming_odometry(
        &mut self,
        robot: usize,
        odometry: Odometry,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Odometry, DropReason> {
        self.set_run_start(odometry.stamp_ns.saturating_sub(odometry.t_ns));
        let bounds = self.offset_bounds(now_ns)?;
        let stamp_ns = self.check_stamp_age(&bounds, odometry.stamp_ns, now_ns, age_ns_max)?;
        // The clock estimate may have become less accurate; the time of a robot never goes back.
        if stamp_ns <= self.newest_odometry_ns[robot] {
            return Err(DropReason::UnconvertibleTime);
        }
        self.newest_odometry_ns[robot] = stamp_ns;
        self.store_plant_stamp(stamp_ns, odometry.stamp_ns);
        Ok(Odometry { stamp_ns, sent_ns: bounds.middle_local_ns(odometry.sent_ns), ..odometry })
    }

    /// Checks a command for the plant of this host, which must not be too old.
    pub fn check_incoming_command(
        &mut self,
        command: Command,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<Command, DropReason> {
        let bounds = self.offset_bounds(now_ns)?;
        self.check_stamp_age(&bounds, command.stamp_ns, now_ns, age_ns_max)?;
        Ok(command)
    }

    /// Returns the earliest local time that a stamp may mean, ns, unless it is too old or in the future.
    fn check_stamp_age(
        &self,
        bounds: &OffsetBounds,
        plant_ns: u64,
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<u64, DropReason> {
        let local_ns = bounds.earliest_local_ns(plant_ns);
        match now_ns.checked_sub(local_ns) {
            Some(age_ns) if age_ns > age_ns_max => Err(DropReason::Old),
            Some(_) => Ok(local_ns),
            None => Err(DropReason::Implausible),
        }
    }

    fn store_plant_stamp(&mut self, local_ns: u64, plant_ns: u64) {
        if !self.is_plant_host {
            self.plant_stamps_ns.insert(local_ns, plant_ns);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the times of a host whose clock is 1 s behind the plant's; messages take 10 us.
    fn example_converter() -> StampConverter {
        let mut times = StampConverter::new(false, 1, 1_000_000_000);
        assert!(times.add_measurement(&RoundTripStamps {
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
        let mut times = example_converter();
        let plant_stamp_ns = 6_000_987_654;
        let sample = times
            .convert_incoming_odometry(0, odometry(plant_stamp_ns), NOW_NS, 10_000_000)
            .unwrap();
        assert!(sample.stamp_ns < plant_stamp_ns - 1_000_000_000, "read as older than it may be");
        let command = Command { stamp_ns: sample.stamp_ns, ..Command::default() };
        assert_eq!(
            times.convert_outgoing_command(command, NOW_NS).unwrap().stamp_ns,
            plant_stamp_ns
        );
        let beacon = Beacon { stamp_ns: sample.stamp_ns, ..Beacon::default() };
        assert_eq!(times.convert_outgoing_beacon(beacon, NOW_NS).unwrap().stamp_ns, plant_stamp_ns);
        let other = Command { stamp_ns: sample.stamp_ns + 1, ..Command::default() };
        assert_eq!(times.convert_outgoing_command(other, NOW_NS), Err(DropReason::Unmatched));
        times.remove_old_stamps(sample.stamp_ns + times.stamp_lifetime_ns);
        assert_eq!(
            times.convert_outgoing_command(command, NOW_NS).unwrap().stamp_ns,
            plant_stamp_ns,
            "it is kept"
        );
        times.remove_old_stamps(sample.stamp_ns + times.stamp_lifetime_ns + 1);
        assert_eq!(
            times.convert_outgoing_command(command, NOW_NS),
            Err(DropReason::Unmatched),
            "no command may answer it"
        );
        assert_eq!(times.run_time_ns(NOW_NS).unwrap() / 1_000, 12);
    }

    #[test]
    fn old_or_backward_sample_is_dropped_with_its_reason() {
        let mut times = example_converter();
        let mut convert = |ns: u64| {
            times.convert_incoming_odometry(0, odometry(ns), NOW_NS, 10_000_000).map(drop)
        };
        assert_eq!(convert(6_000_900_000), Ok(()));
        assert_eq!(convert(6_000_900_000), Err(DropReason::UnconvertibleTime));
        assert_eq!(convert(5_990_000_000), Err(DropReason::Old));
        assert_eq!(convert(6_002_000_000), Err(DropReason::Implausible));
        let mut unmeasured = StampConverter::new(false, 1, 1);
        let early = unmeasured.convert_incoming_odometry(0, odometry(1), NOW_NS, 10_000_000);
        assert_eq!(early, Err(DropReason::UnconvertibleTime));
    }

    #[test]
    fn command_age_uses_the_clock_of_the_plant() {
        let mut times = StampConverter::new(true, 1, 1);
        let command = |stamp_ns| Command { stamp_ns, ..Command::default() };
        assert_eq!(times.check_incoming_command(command(900), 1_000, 100), Ok(command(900)));
        assert_eq!(times.check_incoming_command(command(899), 1_000, 100), Err(DropReason::Old));
        assert_eq!(
            times.check_incoming_command(command(1_001), 1_000, 100),
            Err(DropReason::Implausible)
        );
    }
}
