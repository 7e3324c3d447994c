//! Requirements of a run: processes, open files, memory and shared memory. `phalanx check` prints them, and a run
//! compares the same numbers with the limits of the machine before it starts its first process.
//!
//! Must not change a limit.

use std::fmt;

use serde::Serialize;

use crate::shm_capacity::{AvailableSpace, Bytes, RequiredSpace, SpaceError};
use crate::{descriptors, limits};
use experiment::scenario::Scenario;
use experiment::scenario::read::RECORDED_SAMPLES_PER_S_MAX;
use protocol::run_root;

/// Bytes of a robot's sample in `samples.csv` and in the recording, measured with 64 and 256 robots that receive from
/// two others.
const SAMPLE_BYTES: [f64; 2] = [225.0, 310.0];

/// Needs of a run on one machine. Programs of the scenario are not included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Requirements {
    #[serde(skip)]
    robots: usize,
    #[serde(skip)]
    space: RequiredSpace,
    /// Number of processes and threads.
    pub processes: u64,
    /// Number of open files of the supervisor, which has more than any other process.
    pub open_files: u64,
    /// Memory in lockstep, shared memory included, bytes.
    pub memory_lockstep_bytes: u64,
    /// Memory in real time, shared memory included, bytes.
    pub memory_realtime_bytes: u64,
    /// Shared memory, bytes.
    pub shared_memory_bytes: u64,
    /// Number of files in the run root.
    pub shared_memory_files: u64,
    /// Recording rate, Hz.
    pub record_hz: f64,
    /// Approximate size of `samples.csv` of a run that ends at `duration_s`, bytes.
    pub samples_bytes: u64,
    /// Approximate size of the recording, bytes.
    pub recording_bytes: u64,
}

impl Requirements {
    /// Computes the needs of a run of this scenario.
    pub fn for_run(scenario: &Scenario) -> Requirements {
        let robots = scenario.robots.len();
        let space = RequiredSpace::for_run(scenario);
        // In lockstep there is at most one sample in a tick.
        let sampled_hz = scenario.record_hz.min(1e9 / scenario.period_ns as f64);
        let samples = sampled_hz * formation::ns_to_seconds(scenario.duration_ns) * robots as f64;
        let [samples_bytes, recording_bytes] = SAMPLE_BYTES.map(|bytes| (bytes * samples) as u64);
        // At most: a robot may send shorter messages, or none.
        let formats = (0..robots).filter_map(|i| scenario.recorded_message_format(i));
        let message_bytes: usize = formats.map(|format| format.bytes_max).sum();
        let recording_bytes =
            recording_bytes + (message_bytes as f64 * samples / robots.max(1) as f64) as u64;
        Requirements {
            robots,
            space,
            processes: limits::needed_processes(robots),
            open_files: descriptors::needed_descriptors(robots),
            memory_lockstep_bytes: limits::needed_memory_bytes(robots, true),
            memory_realtime_bytes: limits::needed_memory_bytes(robots, false),
            shared_memory_bytes: space.bytes(),
            shared_memory_files: space.files(),
            record_hz: scenario.record_hz,
            samples_bytes,
            recording_bytes,
        }
    }

    /// Returns why this machine would refuse the run in lockstep or in real time, with the remedy.
    pub fn refusals(&self) -> Vec<String> {
        let mut refusals = Vec::new();
        if let Err(error) = limits::check(self.robots, true) {
            refusals.push(error.to_string());
        }
        if let Err(error) = limits::check(self.robots, false) {
            refusals.push(error.to_string());
        }
        let limit = descriptors::read_limit();
        if let Some(limit) = limit.filter(|&limit| limit < self.open_files) {
            let need =
                descriptors::RequiredDescriptors::for_run(self.robots, descriptors::ViewUse::Off);
            refusals.push(descriptors::TooFewDescriptors { need, maximum: limit }.to_string());
        }
        let need = self.space;
        if let Ok(available) = AvailableSpace::of_file_system(&run_root::base_directory())
            && !available.covers(&need)
        {
            refusals.push(SpaceError::TooSmall { need, available }.to_string());
        }
        refusals.dedup();
        refusals
    }
}

impl fmt::Display for Requirements {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [lockstep, realtime] =
            [self.memory_lockstep_bytes, self.memory_realtime_bytes].map(Bytes);
        let shared = Bytes(self.shared_memory_bytes);
        let label = |label: &str| format!("{label:<24}");
        writeln!(
            f,
            "{}{} processes and threads, {} open files of the supervisor",
            label("a run needs"),
            self.processes,
            self.open_files
        )?;
        writeln!(
            f,
            "{}{lockstep} of memory in lockstep, {realtime} in real time, of which {shared} are shared memory in {} files",
            label(""),
            self.shared_memory_files
        )?;
        let [samples, recording] = [self.samples_bytes, self.recording_bytes].map(Bytes);
        let default = RECORDED_SAMPLES_PER_S_MAX / self.robots.max(1) as f64;
        let default_note = if self.record_hz == default {
            format!(" (the default for {} robots)", self.robots)
        } else {
            String::new()
        };
        writeln!(
            f,
            "{}{} samples per robot and second{default_note}; about {samples} of samples.csv and {recording} of run.mcap",
            label("records"),
            protocol::number::format_short(self.record_hz)
        )
    }
}

#[cfg(test)]
mod tests {
    use protocol::law_message::MessageFormat;

    use super::*;

    #[test]
    fn a_thousand_robots_need_what_the_limits_say() {
        let mut scenario = experiment::examples::row_of_three();
        let few = Requirements::for_run(&scenario);
        assert_eq!(few.refusals(), Vec::<String>::new());
        let robot = scenario.robots[0].clone();
        scenario.robots.resize(1024, robot);
        let needs = Requirements::for_run(&scenario);
        assert_eq!((needs.processes, needs.open_files), (1032, 18_472));
        assert!(needs.shared_memory_bytes < needs.memory_lockstep_bytes);
        let text = needs.to_string();
        assert!(text.starts_with("a run needs             1032 processes"), "{text}");
        assert!(text.contains("18472 open files") && !text.contains("default"), "{text}");
        let text = Requirements { record_hz: 12.5, ..needs }.to_string();
        assert!(text.contains("12.5 samples per robot and second (the default for"), "{text}");
        let format: &'static MessageFormat =
            Box::leak(Box::new(MessageFormat::with_bytes(1 << 10)));
        scenario.robots.iter_mut().for_each(|robot| robot.message_format = Some(format));
        let queued = Requirements::for_run(&scenario).shared_memory_bytes;
        assert_eq!(queued - needs.shared_memory_bytes, 1024 * 16 * 1024, "16 messages of a robot");
        scenario.record_messages = true;
        let recorded = Requirements::for_run(&scenario).shared_memory_bytes;
        assert_eq!(recorded - queued, 1024 * 63 * 1024, "up to 63 ticks of them");
        let impossible = Requirements { robots: 100_000_000, ..needs };
        let refusals = impossible.refusals();
        assert!(
            refusals.iter().any(|refusal| refusal.contains("100000000 robots need")),
            "{refusals:?}"
        );
    }
}
