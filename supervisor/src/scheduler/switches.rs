//! What the kernel tells of each core's switches between threads, by perf events. Needs privilege.

use std::io;

use perf_event::events::Software;
use perf_event::{Builder, Clock, SampleFlag, Sampler};

use super::attribution::Switch;

/// Bytes of the ring between the kernel and us, for each core: some thousand switches.
const RING: usize = 1 << 18;
/// Kinds of records.
const LOST: u32 = 2;
const SWITCH_CPU_WIDE: u32 = 15;
/// In a record's flags: away from its thread. The one that comes on says so itself.
const OUT: u16 = 1 << 13;

/// All cores' switches.
pub(super) struct Switches {
    cores: Vec<(usize, Sampler)>,
    /// Read, but not handed out: later than the moment asked for.
    ahead: Vec<Switch>,
    /// Switches that the kernel had no room to tell of.
    pub(super) lost: u64,
}

impl Switches {
    /// Of these cores, from now on.
    pub(super) fn of(cores: impl IntoIterator<Item = usize>) -> io::Result<Switches> {
        let open = |core| {
            let counter = Builder::new(Software::DUMMY)
                .any_pid()
                .one_cpu(core)
                .include_kernel()
                .include_hv()
                .context_switch(true)
                .sample_id_all(true)
                .sample(SampleFlag::TID)
                .sample(SampleFlag::TIME)
                .clockid(Clock::MONOTONIC)
                .enabled(true)
                .build()?;
            Ok((core, counter.sampled(RING)?))
        };
        let cores = cores.into_iter().map(open).collect::<io::Result<_>>()?;
        Ok(Switches { cores, ahead: Vec::new(), lost: 0 })
    }

    /// All that happened before `until_ns`, which is now or earlier, in order of time.
    pub(super) fn take_until(&mut self, until_ns: u64) -> Vec<Switch> {
        let mut switches = std::mem::take(&mut self.ahead);
        for (core, sampler) in &mut self.cores {
            while let Some(record) = sampler.next_record() {
                match record.ty() {
                    SWITCH_CPU_WIDE if record.misc() & OUT == 0 => {
                        switches.extend(parse(*core, &record.to_contiguous()));
                    }
                    // Its number, and how many.
                    LOST => self.lost += number(&record.to_contiguous(), 8).unwrap_or(0),
                    _ => {}
                }
            }
        }
        switches.sort_by_key(|switch| switch.t_ns);
        self.ahead = switches.split_off(switches.partition_point(|switch| switch.t_ns < until_ns));
        switches
    }
}

/// The record of a thread that comes on: process and thread before it, then its own, and when.
fn parse(core: usize, record: &[u8]) -> Option<Switch> {
    let word = |at: usize| Some(u32::from_ne_bytes(record.get(at..at + 4)?.try_into().ok()?));
    Some(Switch { core, process: word(8)?, thread: word(12)?, t_ns: number(record, 16)? })
}

fn number(record: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_ne_bytes(record.get(at..at + 8)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_has_who_was_before_who_comes_on_and_when() {
        let mut record = Vec::new();
        for word in [7_u32, 8, 20, 21] {
            record.extend(word.to_ne_bytes());
        }
        record.extend(123_456_789_012_u64.to_ne_bytes());
        let expected = Switch { t_ns: 123_456_789_012, core: 3, thread: 21, process: 20 };
        assert_eq!(parse(3, &record), Some(expected));
        assert_eq!(parse(3, &record[..20]), None);
    }
}
