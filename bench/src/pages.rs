//! Which pages of memory a tick of lockstep touches, by what they are for: of robots of the ring, and
//! of the plant. Every page is an entry of the TLB and some lines of a cache, which all others have used
//! since.
//!
//! The plant is stopped by a signal, so that everybody rests; the kernel is told to forget who touched
//! what; the plant goes on for a few ticks and is stopped again; then `smaps` says what was touched.
//! Needs no privilege. The processor counts misses where the kernel lets it.

use std::path::Path;
use std::time::{Duration, Instant};

use perf_event::events::{Cache, CacheId, CacheOp, CacheResult, Hardware};
use perf_event::{Builder, Counter};
use protocol::barrier::Barrier;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::run_root;
use rustix::process::{Pid, Signal, kill_process};

use crate::child::Running;
use crate::lockstep::PERIOD_S;
use crate::segments::{self, Kind, Segments};
use crate::table::Row;
use crate::{BenchError, Setting, failed, ring};

/// Longer than any measurement; the run is ended when it is done.
const TICKS: u64 = 10_000_000;
/// Everybody has connected to everybody, and every sample has been used once, after so many.
const WARM_UP_TICKS: u32 = 300;
/// The plant goes on for at least so many at a time.
const LOOK_TICKS: u32 = 2;
/// How often it does. The least of each kind counts: what other processes do to the same files, and the
/// alarm of a robot that has waited for long, is in some looks and not in all.
const LOOKS: usize = 8;
/// At most so many robots are looked at, of all parts of the ring.
const ROBOTS_MAX: usize = 8;
/// Whoever was released to a tick has answered after this.
const SETTLE: Duration = Duration::from_millis(20);
/// For how long misses are counted.
const COUNT: Duration = Duration::from_millis(300);
/// Anything that is waited for has come within this, or never will.
const WAIT_MAX: Duration = Duration::from_secs(20);
/// How often it is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(1);
/// What the processor counts.
const MISSES: [&str; 2] = ["data TLB misses", "cache misses"];

/// What was touched in a few ticks.
struct Look {
    /// The fewest.
    ticks: u32,
    /// The mean over robots.
    robot: Segments,
    plant: Segments,
}

/// Misses per tick: of a robot, and of the plant.
type Misses = [[f64; 2]; MISSES.len()];

/// Measures rings of these sizes.
pub(crate) fn measure(
    setting: &Setting<'_>,
    sizes: &[usize],
) -> Result<(Vec<Row>, Vec<String>), BenchError> {
    let (mut rows, mut notes) = (Vec::new(), Vec::new());
    for &robots in sizes {
        let mut looks = Vec::new();
        let mut misses = Vec::new();
        for round in 1..=setting.rounds {
            setting.progress(&format!("pages, {robots} robots, round {round}"));
            let (look, counted) = observe(setting, robots)?;
            looks.push(look);
            match counted {
                Ok(counted) => misses.push(counted),
                Err(error) if notes.is_empty() => notes.push(format!(
                    "pages: this machine counts no TLB and cache misses for us: {error}"
                )),
                Err(_) => {}
            }
        }
        rows.extend(rows_of(robots, &looks, &misses));
    }
    Ok((rows, notes))
}

fn rows_of(robots: usize, looks: &[Look], misses: &[Misses]) -> Vec<Row> {
    let page_kb = rustix::param::page_size() as f64 / 1024.0;
    let mut rows = Vec::new();
    let mut row = |what: &str, figures: Vec<f64>| {
        rows.push(Row::alone("pages", &format!("{robots} robots, {what}"), figures));
    };
    row("ticks", looks.iter().map(|look| f64::from(look.ticks)).collect());
    type Of = fn(&Look) -> &Segments;
    let of: [(&str, Of); 2] = [("a robot", |look| &look.robot), ("the plant", |look| &look.plant)];
    for (process, (name, segments)) in of.into_iter().enumerate() {
        let pages = |of: &dyn Fn(&Segments) -> f64| {
            looks.iter().map(|look| of(segments(look)) / page_kb).collect()
        };
        for (place, kind) in Kind::ALL.into_iter().enumerate() {
            let mappings = segments(&looks[0])[place].mappings;
            let what = format!("{name}: {}, pages of {mappings:.0} mappings", kind.words());
            row(&what, pages(&|segments| segments[place].touched_kb));
        }
        let mappings: f64 = segments(&looks[0]).iter().map(|touched| touched.mappings).sum();
        let what = format!("{name}: all, pages of {mappings:.0} mappings");
        row(&what, pages(&|all| all.iter().map(|touched| touched.touched_kb).sum()));
        for (place, of) in MISSES.iter().enumerate().filter(|_| !misses.is_empty()) {
            let figures = misses.iter().map(|misses| misses[place][process]).collect();
            row(&format!("{name}: {of} per tick"), figures);
        }
    }
    rows
}

/// Looks at one run.
fn observe(
    setting: &Setting<'_>,
    robots: usize,
) -> Result<(Look, std::io::Result<Misses>), BenchError> {
    let text = ring::text(robots, TICKS, PERIOD_S);
    let mut running = Running::start(setting.root, setting.stop, &text, Pace::Lockstep)?;
    wait_for("the run to be ready", || {
        running.check()?;
        Ok(running.has_events("ready", robots))
    })?;
    let watched: Vec<usize> = (0..robots).step_by(robots.div_ceil(ROBOTS_MAX)).collect();
    let process = |name: &str| {
        let brief = running.brief(name);
        let gone = || BenchError::Wrong(format!("no process of {}", brief.display()));
        process_of(&brief).ok_or_else(gone)
    };
    let plant = process("plant")?;
    let watched: Vec<u32> =
        watched.iter().map(|i| process(&format!("r{}", i + 1))).collect::<Result<_, _>>()?;
    let told: AgentBrief = brief::read(&running.brief("r1"))?;
    let barrier = Barrier::open(&run_root::barrier_path(&told.run_root))?;
    let begun = barrier.ticks_begun();
    let passed = |since: u32| barrier.ticks_begun().wrapping_sub(since);
    wait_for("the first ticks", || {
        running.check()?;
        Ok(passed(begun) >= WARM_UP_TICKS)
    })?;

    let misses = count(plant, watched[0], &|since| passed(since), barrier.ticks_begun());
    let mut least = look(plant, &watched, &told.run_root, &|| barrier.ticks_begun())?;
    for _ in 1..LOOKS {
        running.check()?;
        least.keep_least(&look(plant, &watched, &told.run_root, &|| barrier.ticks_begun())?);
    }
    Ok((least, misses))
}

impl Look {
    fn keep_least(&mut self, other: &Look) {
        self.ticks = self.ticks.min(other.ticks);
        let mine = self.robot.iter_mut().chain(&mut self.plant);
        for (least, touched) in mine.zip(other.robot.iter().chain(&other.plant)) {
            least.touched_kb = least.touched_kb.min(touched.touched_kb);
        }
    }
}

/// Lets a few ticks pass; what was touched in them.
fn look(
    plant: u32,
    robots: &[u32],
    run_root: &Path,
    begun: &dyn Fn() -> u32,
) -> Result<Look, BenchError> {
    let mut rest = Rest::of(plant)?;
    for &process in robots.iter().chain([&plant]) {
        forget(process)?;
    }
    let before = begun();
    rest.go_on();
    let began = Instant::now();
    // No sleep: a tick takes less time than to wake from one.
    while begun().wrapping_sub(before) < LOOK_TICKS {
        if began.elapsed() > WAIT_MAX {
            return Err(BenchError::Wrong("the plant does not go on".into()));
        }
        std::hint::spin_loop();
    }
    let _rest = Rest::of(plant)?;
    let ticks = begun().wrapping_sub(before);
    let mut robot = Segments::default();
    for &process in robots {
        for (mean, of) in robot.iter_mut().zip(touched(process, run_root)?) {
            mean.mappings += of.mappings / robots.len() as f64;
            mean.touched_kb += of.touched_kb / robots.len() as f64;
        }
    }
    Ok(Look { ticks, robot, plant: touched(plant, run_root)? })
}

/// While it lives, the plant is stopped, and nobody has anything to do.
struct Rest(Option<Pid>);

impl Rest {
    fn of(plant: u32) -> Result<Rest, BenchError> {
        let plant = Pid::from_raw(plant as i32).expect("a process's number is above 0");
        let rest = Rest(Some(plant));
        signal(plant, Signal::STOP)?;
        let stat = format!("/proc/{}/stat", plant.as_raw_nonzero());
        wait_for("the plant to stop", || {
            let stat = std::fs::read_to_string(&stat).map_err(failed("read", Path::new(&stat)))?;
            // The name, in brackets, may have anything in it.
            Ok(stat.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('T')))
        })?;
        std::thread::sleep(SETTLE);
        Ok(rest)
    }

    fn go_on(&mut self) {
        if let Some(plant) = self.0.take() {
            // Who is gone needs no more.
            let _ = kill_process(plant, Signal::CONT);
        }
    }
}

impl Drop for Rest {
    fn drop(&mut self) {
        self.go_on();
    }
}

fn signal(process: Pid, signal: Signal) -> Result<(), BenchError> {
    kill_process(process, signal)
        .map_err(|error| BenchError::Wrong(format!("cannot signal a process: {error}")))
}

/// The kernel forgets which pages a process touched. First all that the processors remember of them
/// goes, which is what `4` does beside other things: else they would not say it again.
fn forget(process: u32) -> Result<(), BenchError> {
    let file = format!("/proc/{process}/clear_refs");
    for what in ["4", "1"] {
        std::fs::write(&file, what).map_err(failed("write", Path::new(&file)))?;
    }
    Ok(())
}

fn touched(process: u32, run_root: &Path) -> Result<Segments, BenchError> {
    let file = format!("/proc/{process}/smaps");
    let smaps = std::fs::read_to_string(&file).map_err(failed("read", Path::new(&file)))?;
    Ok(segments::sort(&smaps, run_root))
}

/// The process that was started with this brief.
fn process_of(brief: &Path) -> Option<u32> {
    let brief = brief.as_os_str().as_encoded_bytes();
    std::fs::read_dir("/proc").ok()?.flatten().find_map(|entry| {
        let words = std::fs::read(entry.path().join("cmdline")).ok()?;
        words.split(|&byte| byte == 0).any(|word| word == brief).then_some(())?;
        entry.file_name().to_str()?.parse().ok()
    })
}

/// What the processor counts in these processes per tick.
fn count(
    plant: u32,
    robot: u32,
    passed: &dyn Fn(u32) -> u32,
    since: u32,
) -> std::io::Result<Misses> {
    let tlb = Cache { which: CacheId::DTLB, operation: CacheOp::READ, result: CacheResult::MISS };
    let both = |process: u32| -> std::io::Result<[Counter; MISSES.len()]> {
        let tlb = Builder::new(tlb.clone()).observe_pid(process as i32).enabled(true).build()?;
        let cache = Builder::new(Hardware::CACHE_MISSES);
        Ok([tlb, { cache }.observe_pid(process as i32).enabled(true).build()?])
    };
    let mut counters = [both(robot)?, both(plant)?];
    let before = passed(since);
    std::thread::sleep(COUNT);
    let ticks = f64::from(passed(since).wrapping_sub(before).max(1));
    let mut misses = Misses::default();
    for (process, counters) in counters.iter_mut().enumerate() {
        for (misses, counter) in misses.iter_mut().zip(counters) {
            misses[process] = counter.read()? as f64 / ticks;
        }
    }
    Ok(misses)
}

fn wait_for(
    what: &str,
    mut there: impl FnMut() -> Result<bool, BenchError>,
) -> Result<(), BenchError> {
    let began = Instant::now();
    while !there()? {
        if began.elapsed() > WAIT_MAX {
            return Err(BenchError::Wrong(format!("waited too long for {what}")));
        }
        std::thread::sleep(LOOK_EVERY);
    }
    Ok(())
}
