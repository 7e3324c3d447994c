//! The barrier between threads, each with a mapping of its own: sleeping and waking in the kernel and the ends of
//! waits, which the model (`plots`) leaves out.

mod model;
mod plots;
pub(super) mod stepped;

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::SeqCst;
use std::thread;
use std::time::{Duration, Instant};

use super::futex::RECHECK_INTERVAL;
use super::layout::VERSION;
use super::{Barrier, LEAD_TICKS_MAX};
use crate::machine::process::Alarm;

const TEST_TIMEOUT: Duration = Duration::from_secs(10);
const SHORT_TIMEOUT: Duration = Duration::from_millis(20);

/// Returns a closure that is `true` for this time.
fn until_deadline(limit: Duration) -> impl FnMut() -> bool {
    let end = Instant::now() + limit;
    move || Instant::now() < end
}

/// Creates a barrier and a second mapping of the same file.
fn create_two_mappings(slots: usize) -> (tempfile::TempDir, Barrier, Barrier) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("barrier");
    let created = Barrier::create(&path, slots, 2, TEST_TIMEOUT).unwrap();
    let opened = Barrier::open(&path).unwrap();
    assert_eq!(opened.slots(), slots);
    (directory, created, opened)
}

fn begin_and_release_tick(plant: &Barrier, tick: u64) {
    plant.begin_tick(tick);
    (0..plant.groups()).for_each(|group| plant.release_group(group));
}

#[test]
fn many_ticks_lose_no_wake_up() {
    const TICKS: u64 = 5_000;
    const AGENTS: usize = 5;
    let (_directory, plant, agents) = create_two_mappings(AGENTS + 1);
    let at = [const { AtomicU64::new(0) }; AGENTS];
    (0..AGENTS).for_each(|slot| plant.set_member(slot, 0));
    thread::scope(|scope| {
        let ready = agents.epoch(0);
        for (slot, at) in at.iter().enumerate() {
            let agents = &agents;
            scope.spawn(move || {
                let mut seen = ready;
                for expected in 0..TICKS {
                    let (epoch, tick) =
                        agents.wait_for_tick(slot, seen, until_deadline(TEST_TIMEOUT)).unwrap();
                    assert_eq!(tick, expected);
                    seen = epoch;
                    at.store(tick + 1, SeqCst);
                    agents.arrive(slot, tick);
                }
            });
        }
        let start = Instant::now();
        for tick in 0..TICKS {
            begin_and_release_tick(&plant, tick);
            plant.wait_for_arrivals(tick, until_deadline(TEST_TIMEOUT)).unwrap();
            assert!(at.iter().all(|at| at.load(SeqCst) == tick + 1));
        }
        // With lost wake-ups each tick would take RECHECK.
        assert!(start.elapsed() < RECHECK_INTERVAL * TICKS as u32 / 4);
    });
}

#[test]
fn wait_names_missing_members_at_its_limit() {
    let (_directory, plant, agents) = create_two_mappings(4);
    (0..3).for_each(|slot| plant.set_member(slot, 0));
    plant.set_member(3, 8);
    begin_and_release_tick(&plant, 7);
    agents.arrive(1, 7);
    agents.arrive(1, 7);
    assert_eq!(plant.wait_for_arrivals(7, until_deadline(SHORT_TIMEOUT)), Err(vec![0, 2]));
    assert_eq!(agents.wait_for_tick(2, agents.epoch(2), until_deadline(SHORT_TIMEOUT)), None);
}

#[test]
fn attention_is_reported_once() {
    let (_directory, plant, supervisor) = create_two_mappings(1);
    plant.request_attention();
    plant.request_attention();
    assert!(supervisor.wait_for_attention(SHORT_TIMEOUT));
    assert!(!supervisor.wait_for_attention(SHORT_TIMEOUT));
}

#[test]
fn alarm_makes_every_wait_recheck() {
    let (_directory, mut plant, mut agents) = create_two_mappings(2);
    /// Returns a closure that is `true` for a few calls, each after an alarm.
    fn until_rechecked_twice() -> impl FnMut() -> bool {
        let mut remaining = 3;
        move || {
            remaining -= 1;
            remaining > 0
        }
    }
    thread::scope(|scope| {
        plant.set_member(0, 0);
        plant.begin_tick(0);
        scope.spawn(move || {
            let start = Instant::now();
            agents.set_alarm(Alarm::start().unwrap());
            assert_eq!(agents.wait_for_tick(0, agents.epoch(0), until_rechecked_twice()), None);
            assert!(!agents.wait_for_lead_limit(
                LEAD_TICKS_MAX + 1,
                LEAD_TICKS_MAX,
                until_rechecked_twice()
            ));
            assert!(!agents.pause(0, until_rechecked_twice()));
            // Waits evaluate it no more often than the alarm fires.
            assert!(start.elapsed() >= 8 * Alarm::PERIOD);
        });
        scope.spawn(move || {
            plant.set_alarm(Alarm::start().unwrap());
            assert_eq!(plant.wait_for_arrivals(0, until_rechecked_twice()), Err(vec![0]));
        });
    });
}

#[test]
fn awaited_members_and_begun_ticks_are_reported() {
    let (_directory, plant, supervisor) = create_two_mappings(3);
    (0..2).for_each(|slot| plant.set_member(slot, 0));
    assert_eq!((supervisor.pending_members(), supervisor.ticks_begun()), (vec![], 0));
    assert_eq!(plant.group_members(0).collect::<Vec<_>>(), [0]);
    plant.begin_tick(7);
    assert_eq!(supervisor.pending_members(), []);
    plant.release_group(0);
    assert_eq!((supervisor.pending_members(), supervisor.ticks_begun()), (vec![(0, 7)], 0));
    plant.release_group(1);
    assert_eq!((supervisor.pending_members(), supervisor.ticks_begun()), (vec![(0, 7), (1, 7)], 1));
    plant.arrive(0, 7);
    assert_eq!(supervisor.pending_members(), [(1, 7)]);
    supervisor.remove_member(1);
    assert_eq!(supervisor.pending_members(), []);
    assert_eq!((plant.members().collect::<Vec<_>>(), plant.first_member_tick(1)), (vec![0], None));
    assert_eq!(plant.heartbeat_count(), 0);
    supervisor.wait_for_attention(SHORT_TIMEOUT);
    assert_eq!((plant.heartbeat_count(), plant.supervisor_pid()), (1, std::process::id()));
    assert_eq!(plant.hung_timeout(), TEST_TIMEOUT);
}

#[test]
fn foreign_file_is_refused() {
    let (directory, created, _opened) = create_two_mappings(2);
    drop(created);
    let path = directory.path().join("barrier");
    assert!(Barrier::create(&path, 0, 1, TEST_TIMEOUT).is_err());
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[8] = 9;
    std::fs::write(&path, &bytes).unwrap();
    let error = Barrier::open(&path).unwrap_err().to_string();
    assert!(error.contains(&format!("version 9, expected {VERSION}")), "{error}");
    bytes[0] = 0;
    std::fs::write(&path, &bytes).unwrap();
    assert!(Barrier::open(&path).is_err());
    std::fs::write(&path, "short").unwrap();
    assert!(Barrier::open(&path).is_err());
}
