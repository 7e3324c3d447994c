//! Whether late wake-ups are told their true cause: a process with a robot's timer is made late on
//! purpose, in every way that one machine allows, and what is told is held against what was done.
//!
//! | way | what is done | what is right |
//! |---|---|---|
//! | `priority` | a process of higher priority spins on its core | waited for a core |
//! | `quota` | its cgroup may run for a fifth of the time, and it wants more | waited for a core |
//! | `faults` | it touches fresh memory for longer than its period | page faults |
//! | `work` | it computes for longer than its period | own work |
//! | `stop` | a signal that nobody planned stops it | unknown |
//!
//! A host that takes the core can only be waited for. Late wake-ups that nothing was done to are
//! counted apart.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::ValueEnum;
use protocol::clock::{self, Timer};
use protocol::lateness::{Account, Late, Witness};
use protocol::process::{self, Stop, Turns};
use protocol::stage::Cause;
use serde::{Deserialize, Serialize};

use crate::cores::stay_on_the_last;
use crate::peers::{self, Peers};
use crate::table::Row;
use crate::{BenchError, Place, Setting};

/// T, ns: that of the peer that is made late.
const PERIOD_NS: u64 = 5_000_000;
/// How long a strike takes, ns: at least one deadline falls into it.
const STRIKE_NS: u64 = 8_000_000;
/// From one strike to the next.
const STRIKE_EVERY: Duration = Duration::from_millis(50);
/// In wake-ups.
const STRIKE_EVERY_TICKS: u64 = 10;
/// So much fresh memory is touched at a time, bytes.
const FRESH: usize = 4 << 20;
/// What the quota allows in each of its periods, us.
const QUOTA_US: [u64; 2] = [20_000, 100_000];
/// How long the peer works in each period under a quota, ns: more than that.
const WANTED_NS: u64 = 3_000_000;
/// No wake-up is late without an end: the peer tells what it has after so many periods too many.
const TICKS_SPARE: u64 = 2;

/// A way to be late.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Way {
    Priority,
    Quota,
    Faults,
    Work,
    Stop,
}

impl Way {
    const ALL: [Way; 5] = [Way::Priority, Way::Quota, Way::Faults, Way::Work, Way::Stop];

    /// Its first word on a command line, and what was done, in words.
    fn words(self) -> [&'static str; 2] {
        match self {
            Way::Priority => ["priority", "a process of higher priority"],
            Way::Quota => ["quota", "a quota of the cgroup"],
            Way::Faults => ["faults", "fresh memory"],
            Way::Work => ["work", "work that takes longer than the period"],
            Way::Stop => ["stop", "stopped by a signal"],
        }
    }

    fn cause(self) -> Cause {
        match self {
            Way::Priority | Way::Quota => Cause::Core,
            Way::Faults => Cause::Faults,
            Way::Work => Cause::Work,
            Way::Stop => Cause::Unknown,
        }
    }
}

/// What is done, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Strike {
    from_ns: u64,
    until_ns: u64,
}

/// A late wake-up, as the peer tells it.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Told {
    due_ns: u64,
    account: Account,
}

/// What the peer saw and did.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Seen {
    late: Vec<Told>,
    strikes: Vec<Strike>,
}

/// How one round went.
#[derive(Debug, Default, PartialEq)]
struct Score {
    /// Late wake-ups that a strike explains.
    struck: usize,
    /// Of these, those whose cause is right.
    right: usize,
    /// Late wake-ups that nothing was done to.
    others: usize,
}

/// A strike explains a late wake-up if it fills at least half of the lateness.
fn explains(strikes: &[Strike], told: &Told) -> bool {
    let (due_ns, behind_ns) = (told.due_ns, told.account.late.behind_ns);
    let common = |strike: &Strike| {
        strike.until_ns.min(due_ns + behind_ns).saturating_sub(strike.from_ns.max(due_ns))
    };
    2 * strikes.iter().map(common).sum::<u64>() >= behind_ns
}

fn score(way: Way, seen: &Seen) -> Score {
    let (struck, others): (Vec<&Told>, Vec<&Told>) =
        seen.late.iter().partition(|told| explains(&seen.strikes, told));
    let right = struck.iter().filter(|told| told.account.cause() == way.cause()).count();
    Score { struck: struck.len(), right, others: others.len() }
}

/// Measures each way for about `seconds` a round. Also returns notes: an example of each, one whose
/// cause is wrong, and which could not be done.
pub(crate) fn measure(
    setting: &Setting<'_>,
    seconds: f64,
) -> Result<(Vec<Row>, Vec<String>), BenchError> {
    let (mut rows, mut notes) = (Vec::new(), Vec::new());
    for way in Way::ALL {
        let [word, what] = way.words();
        let (mut right, mut struck, mut others) = (Vec::new(), Vec::new(), Vec::new());
        let (mut example, mut mistake) = (None, None);
        for round in 1..=setting.rounds {
            setting.progress(&format!("causes, {what}, round {round}"));
            let seen = match strike(setting, way, seconds)? {
                Ok(seen) => seen,
                Err(why) => {
                    notes.push(format!("causes: {what}: SKIPPED: {why}"));
                    break;
                }
            };
            let score = score(way, &seen);
            if score.struck == 0 {
                return Err(BenchError::Wrong(format!("causes: {what} made nobody late")));
            }
            right.push(100.0 * score.right as f64 / score.struck as f64);
            struck.push(score.struck as f64);
            others.push(score.others as f64);
            let of_it = |told: &&Told| explains(&seen.strikes, told);
            let accounts = || seen.late.iter().filter(of_it).map(|told| told.account);
            example = example.or(accounts().next());
            mistake = mistake.or(accounts().find(|account| account.cause() != way.cause()));
        }
        if right.is_empty() {
            continue;
        }
        let row = |of: &str, values| Row::alone("causes", &format!("{what}, {of}"), values);
        rows.push(row("late wake-ups", struck));
        rows.push(row("right cause, %", right));
        rows.push(row("late for another reason", others));
        notes.extend(example.map(|account| format!("causes: {word}: {}", shown(account))));
        notes.extend(mistake.map(|account| format!("causes: {word}, wrong: {}", shown(account))));
    }
    Ok((rows, notes))
}

/// One account as numbers, ns.
fn shown(account: Account) -> String {
    let Account { late, before, after, .. } = account;
    format!(
        "behind {} at work {} waited {} held up {} stolen {} major {} minor {}: {:?}",
        late.behind_ns,
        late.at_work_ns,
        after.waited_ns - before.waited_ns,
        after.held_up_ns - before.held_up_ns,
        after.stolen_ns - before.stolen_ns,
        after.major_faults - before.major_faults,
        after.minor_faults - before.minor_faults,
        account.cause(),
    )
}

/// One round of one way; `Err` inside: why this machine does not allow it.
fn strike(
    setting: &Setting<'_>,
    way: Way,
    seconds: f64,
) -> Result<Result<Seen, String>, BenchError> {
    let place = Place::new(setting.root, "causes")?;
    let result = place.path().join("result-1.json");
    let ticks = ((1e9 * seconds) as u64 / PERIOD_NS).max(4 * STRIKE_EVERY_TICKS);
    let words = ["peer", "late", way.words()[0]].map(OsString::from);
    let words = words.into_iter().chain([ticks.to_string().into(), result.clone().into()]);
    let peers = Peers::start(place.path(), setting.stop, [words.collect()])?;
    peers.wait_ready()?;
    let pid = peers.pid(0);
    let quota = match (way == Way::Quota).then(|| Quota::of(pid)).transpose() {
        Ok(quota) => quota,
        Err(why) => return Ok(Err(why)),
    };
    peers.go()?;
    let lasts = Duration::from_nanos(ticks * PERIOD_NS);
    let mut done = Vec::new();
    match way {
        Way::Priority => match strike_by_priority(lasts, setting.stop) {
            Ok(strikes) => done = strikes,
            Err(why) => return Ok(Err(why)),
        },
        Way::Stop => {
            done = strikes(lasts, setting.stop, || {
                peers.stop(0);
                std::thread::sleep(Duration::from_nanos(STRIKE_NS));
                peers.go_on(0);
            });
        }
        Way::Quota => done = vec![Strike { from_ns: clock::now_ns(), until_ns: u64::MAX }],
        Way::Faults | Way::Work => {}
    }
    let mut seen: Seen = peers.told(&result)?;
    drop(peers);
    drop(quota);
    seen.strikes.extend(done);
    Ok(Ok(seen))
}

/// Strikes again and again for so long.
fn strikes(lasts: Duration, stop: &Stop, mut strike: impl FnMut()) -> Vec<Strike> {
    let (began, mut done) = (Instant::now(), Vec::new());
    while began.elapsed() + STRIKE_EVERY < lasts && !stop.requested() {
        std::thread::sleep(STRIKE_EVERY);
        let from_ns = clock::now_ns();
        strike();
        done.push(Strike { from_ns, until_ns: clock::now_ns() });
    }
    done
}

/// Spins on the peer's core before every ordinary process.
fn strike_by_priority(lasts: Duration, stop: &Stop) -> Result<Vec<Strike>, String> {
    let spins = || {
        process::take_realtime_priority().map_err(|error| error.to_string())?;
        stay_on_the_last().map_err(|error| format!("cannot keep to one core: {error}"))?;
        Ok(strikes(lasts, stop, || {
            let until_ns = clock::now_ns() + STRIKE_NS;
            while clock::now_ns() < until_ns {
                std::hint::spin_loop();
            }
        }))
    };
    std::thread::scope(|scope| scope.spawn(spins).join().expect("it does not panic"))
}

/// A cgroup that one process is in; removed with it.
struct Quota(PathBuf);

impl Quota {
    /// Of cgroup version 1 or 2, whichever is mounted where it always is.
    fn of(pid: u32) -> Result<Quota, String> {
        let [quota, period] = QUOTA_US;
        let first = Path::new("/sys/fs/cgroup/cpu");
        let (root, limits) = if first.join("tasks").exists() {
            let files = ["cpu.cfs_period_us", "cpu.cfs_quota_us"].into_iter();
            (first, files.zip([period.to_string(), quota.to_string()]).collect::<Vec<_>>())
        } else {
            (Path::new("/sys/fs/cgroup"), vec![("cpu.max", format!("{quota} {period}"))])
        };
        let dir = root.join(format!("phalanx-bench-{}", std::process::id()));
        std::fs::create_dir(&dir)
            .map_err(|error| format!("cannot make the cgroup {}: {error}", dir.display()))?;
        let made = Quota(dir);
        for (file, text) in limits.into_iter().chain([("cgroup.procs", pid.to_string())]) {
            let file = made.0.join(file);
            std::fs::write(&file, text)
                .map_err(|error| format!("cannot write {}: {error}", file.display()))?;
        }
        Ok(made)
    }
}

impl Drop for Quota {
    fn drop(&mut self) {
        // Empty once its process is reaped; the kernel may need a moment.
        for _ in 0..100 {
            if std::fs::remove_dir(&self.0).is_ok() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// The process that is made late, with the loop of a robot.
pub(crate) fn peer(way: Way, ticks: u64, result: &Path) -> Result<(), BenchError> {
    clock::tighten_timer_slack();
    process::take_turns(Turns::Short);
    if way == Way::Priority {
        stay_on_the_last()
            .map_err(|error| BenchError::Wrong(format!("cannot keep to one core: {error}")))?;
    }
    peers::await_go(result.parent().unwrap_or(result), 0)?;
    let began_ns = clock::now_ns();
    let mut timer = Timer::new(PERIOD_NS, 0);
    let mut witness = Witness::new(PERIOD_NS);
    let (mut awake_ns, mut rested_ns) = (began_ns, began_ns);
    let (mut missed, mut tick) = (false, 0);
    let mut seen = Seen::default();
    while clock::now_ns() < began_ns + (ticks + TICKS_SPARE) * PERIOD_NS {
        let Some(wake) = timer.wait() else { continue };
        if !witness.on_time(wake.lateness_ns, std::mem::take(&mut missed)) {
            let account = witness.account_of(Late::of(&wake, awake_ns, rested_ns));
            seen.late.push(Told { due_ns: wake.due_ns, account });
        }
        tick += 1;
        let from_ns = clock::now_ns();
        awake_ns = from_ns;
        let struck = tick % STRIKE_EVERY_TICKS == 0;
        match way {
            Way::Quota => work_until(from_ns + WANTED_NS),
            Way::Work if struck => work_until(from_ns + STRIKE_NS),
            Way::Faults if struck => touch_until(from_ns + STRIKE_NS)?,
            _ => {}
        }
        rested_ns = clock::now_ns();
        if struck && matches!(way, Way::Work | Way::Faults) {
            seen.strikes.push(Strike { from_ns, until_ns: rested_ns });
        }
        missed = rested_ns.saturating_sub(wake.due_ns) >= PERIOD_NS;
    }
    peers::tell(result, &seen)
}

fn work_until(until_ns: u64) {
    while clock::now_ns() < until_ns {
        std::hint::spin_loop();
    }
}

/// Touches memory that was never touched before, page by page.
fn touch_until(until_ns: u64) -> Result<(), BenchError> {
    const PAGE: usize = 4096;
    let wrong = |error| BenchError::Wrong(format!("cannot map memory: {error}"));
    while clock::now_ns() < until_ns {
        // SAFETY: a new private mapping of the kernel's choice, used within its length until unmapped.
        unsafe {
            use rustix::mm::{Advice, MapFlags, ProtFlags, madvise, mmap_anonymous, munmap};
            let flags = ProtFlags::READ | ProtFlags::WRITE;
            let memory = mmap_anonymous(std::ptr::null_mut(), FRESH, flags, MapFlags::PRIVATE)
                .map_err(wrong)?;
            // Large pages would be few faults.
            let _ = madvise(memory, FRESH, Advice::LinuxNoHugepage);
            for page in 0..FRESH / PAGE {
                memory.cast::<u8>().add(page * PAGE).write_volatile(1);
                if clock::now_ns() >= until_ns {
                    break;
                }
            }
            munmap(memory, FRESH).map_err(wrong)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::lateness::Counters;

    const MS: u64 = 1_000_000;

    fn told(due_ms: u64, behind_ms: u64, waited_ms: u64) -> Told {
        let late = Late { behind_ns: behind_ms * MS, at_work_ns: 0, worked_ns: 0 };
        let after = Counters { waited_ns: waited_ms * MS, ..Counters::default() };
        let (before, period_ns, previous) = (Counters::default(), PERIOD_NS, None);
        let account = Account { late, before, after, period_ns, previous };
        Told { due_ns: due_ms * MS, account }
    }

    #[test]
    fn a_late_wake_up_counts_for_a_strike_that_fills_half_of_it_and_is_right_by_its_cause() {
        let seen = Seen {
            late: vec![
                told(11, 7, 7),  // by the strike, and told so
                told(12, 6, 0),  // by the strike, and told otherwise
                told(17, 4, 4),  // mostly after it
                told(100, 2, 2), // long after it
            ],
            strikes: vec![Strike { from_ns: 10 * MS, until_ns: 18 * MS }],
        };
        let expected = Score { struck: 2, right: 1, others: 2 };
        assert_eq!(score(Way::Priority, &seen), expected);
        let stopped = Score { struck: 2, right: 1, others: 2 };
        assert_eq!(score(Way::Stop, &seen), stopped);
        assert_eq!(score(Way::Work, &seen).right, 0);
    }

    #[test]
    fn every_way_is_a_word_of_the_command_line() {
        for way in Way::ALL {
            assert_eq!(Way::from_str(way.words()[0], false), Ok(way));
        }
    }
}
