//! What the kernel tells of each core's switches between threads, and of how programs are called, by perf
//! events. Needs privilege.

use std::io;

use perf_event::events::Software;
use perf_event::{Builder, Clock, SampleFlag, Sampler};

use super::attribution::Switch;

/// Bytes of the ring between the kernel and us, for each core: some thousand switches.
const RING: usize = 1 << 18;
/// Kinds of records.
const LOST: u32 = 2;
const NAMED: u32 = 3;
const FORK: u32 = 7;
const SWITCH_CPU_WIDE: u32 = 15;
/// In a record's flags: away from its thread. The one that comes on says so itself.
const OUT: u16 = 1 << 13;

/// What happened on a core.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Event {
    Switch(Switch),
    /// A process began, perhaps under the number of one that is gone.
    Began {
        process: u32,
    },
    /// From now on a process is called this: it became another program, or chose the name.
    Named {
        process: u32,
        name: String,
    },
}

/// All cores' switches.
pub(super) struct Switches {
    cores: Vec<(usize, Sampler)>,
    /// Read, but not handed out: later than the moment asked for. CLOCK_MONOTONIC, ns.
    ahead: Vec<(u64, Event)>,
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
                .comm(true)
                .task(true)
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
    pub(super) fn take_until(&mut self, until_ns: u64) -> impl Iterator<Item = Event> + use<> {
        let mut events = std::mem::take(&mut self.ahead);
        for (core, sampler) in &mut self.cores {
            while let Some(record) = sampler.next_record() {
                let parse = match record.ty() {
                    SWITCH_CPU_WIDE if record.misc() & OUT == 0 => switch,
                    NAMED => named,
                    FORK => began,
                    // Its number, and how many.
                    LOST => {
                        self.lost += number(&record.to_contiguous(), 8).unwrap_or(0);
                        continue;
                    }
                    _ => continue,
                };
                events.extend(parse(*core, &record.to_contiguous()));
            }
        }
        events.sort_by_key(|&(t_ns, _)| t_ns);
        self.ahead = events.split_off(events.partition_point(|&(t_ns, _)| t_ns < until_ns));
        events.into_iter().map(|(_, event)| event)
    }
}

/// The record of a thread that comes on: process and thread before it, then its own, and when.
fn switch(core: usize, record: &[u8]) -> Option<(u64, Event)> {
    let t_ns = number(record, 16)?;
    let switch = Switch { core, process: word(record, 8)?, thread: word(record, 12)?, t_ns };
    Some((t_ns, Event::Switch(switch)))
}

/// The record of a name: process and thread, the name up to a zero, and at the end when. Those of further
/// threads are passed over.
fn named(_core: usize, record: &[u8]) -> Option<(u64, Event)> {
    let (process, thread) = (word(record, 0)?, word(record, 4)?);
    let name = record.get(8..)?.split(|&byte| byte == 0).next()?;
    let name = String::from_utf8_lossy(name).into_owned();
    let t_ns = number(record, record.len().checked_sub(8)?)?;
    (process == thread).then_some((t_ns, Event::Named { process, name }))
}

/// The record of a thread that begins: process and parent, thread and parent, and when. Further threads
/// of a process are passed over.
fn began(_core: usize, record: &[u8]) -> Option<(u64, Event)> {
    let (process, thread) = (word(record, 0)?, word(record, 8)?);
    let t_ns = number(record, 16)?;
    (process == thread).then_some((t_ns, Event::Began { process }))
}

fn word(record: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_ne_bytes(record.get(at..at + 4)?.try_into().ok()?))
}

fn number(record: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_ne_bytes(record.get(at..at + 8)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(words: &[u32]) -> Vec<u8> {
        words.iter().flat_map(|word| word.to_ne_bytes()).collect()
    }

    #[test]
    fn a_record_has_who_was_before_who_comes_on_and_when() {
        let mut record = words(&[7, 8, 20, 21]);
        record.extend(123_456_789_012_u64.to_ne_bytes());
        let expected = Switch { t_ns: 123_456_789_012, core: 3, thread: 21, process: 20 };
        assert_eq!(switch(3, &record), Some((123_456_789_012, Event::Switch(expected))));
        assert_eq!(switch(3, &record[..20]), None);
    }

    #[test]
    fn a_record_has_the_new_name_of_a_process_and_those_of_its_threads_are_passed_over() {
        let record = |thread: u32| {
            let mut record = words(&[20, thread]);
            record.extend(b"rustc\0\0\0");
            record.extend(words(&[20, thread]));
            record.extend(7_u64.to_ne_bytes());
            record
        };
        let name = "rustc".to_owned();
        assert_eq!(named(0, &record(20)), Some((7, Event::Named { process: 20, name })));
        assert_eq!(named(0, &record(21)), None);
        assert_eq!(named(0, &record(20)[..6]), None);
    }

    #[test]
    fn a_record_tells_that_a_process_began_and_those_of_its_threads_are_passed_over() {
        let record = |thread: u32| {
            let mut record = words(&[20, 1, thread, 1]);
            record.extend(7_u64.to_ne_bytes());
            record
        };
        assert_eq!(began(0, &record(20)), Some((7, Event::Began { process: 20 })));
        assert_eq!(began(0, &record(21)), None);
    }
}
