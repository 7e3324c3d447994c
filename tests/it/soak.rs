//! The soak: robots are killed at random moments, from outside, and nobody plans it. Whatever dies,
//! no two come nearer than d, each robot returns, nothing is left behind; and once the kills stop,
//! everybody comes home.

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt as _;
use std::panic::resume_unwind;
use std::time::{Duration, Instant};

use formation::random::SplitMix64;
use rustix::process::Signal;

use crate::harness::{Ended, Phalanx, Running, files_below, run, signal_pid, times};
use crate::oracle::scenario;

/// Runs at a time: as many as a small machine has cores.
const SIDE_BY_SIDE: usize = 2;

/// After the last kill nothing is left of the dead within this of wall time, far more than it takes.
const SETTLED_WITHIN: Duration = Duration::from_secs(5);

/// A scenario that is soaked.
#[derive(Debug, Clone, Copy)]
struct Soaked {
    name: &'static str,
    lockstep: bool,
    /// In real time it is short; lockstep makes little of a minute.
    duration_s: f64,
    /// Nobody is killed after this much run time.
    hostile_s: f64,
}

const fn in_real_time(name: &'static str) -> Soaked {
    Soaked { name, lockstep: false, duration_s: 14.0, hostile_s: 6.0 }
}

const fn in_lockstep(name: &'static str) -> Soaked {
    Soaked { name, lockstep: true, duration_s: 60.0, hostile_s: 40.0 }
}

/// What came of one run, or of all.
#[derive(Debug, Clone, Copy, Default)]
struct Toll {
    runs: usize,
    kills: usize,
    /// Of them of processes that had not said yet that they are ready.
    unready: usize,
}

impl Toll {
    fn add(&mut self, other: &Toll) {
        self.runs += other.runs;
        self.kills += other.kills;
        self.unready += other.unready;
    }
}

/// Kills agents of one run at random.
struct Reaper {
    dice: SplitMix64,
    /// Process ids of those it killed.
    killed: BTreeSet<u32>,
}

impl Reaper {
    /// Strikes until so many are dead, or the run has come so far.
    fn strike(&mut self, running: &Running, kills: usize, until_s: f64) {
        while self.killed.len() < kills && run_time_s(&running.events()) < until_s {
            let left = (kills - self.killed.len()) as u64;
            match self.dice.between(0, 3) {
                // Several at the same instant, perhaps all.
                0 => {
                    let count = self.dice.between(2, 8).min(left);
                    self.kill_some(running, count);
                }
                // One, and whoever is started next, while it comes up.
                1 => {
                    self.kill_some(running, 1);
                    self.kill_the_next(running);
                }
                _ => self.kill_some(running, 1),
            }
            // From within a restart to long after it.
            let doublings = self.dice.between(0, 8);
            pause(Duration::from_millis(1 << doublings).mul_f64(1.0 + self.dice.unit()));
        }
    }

    fn living(&self, running: &Running) -> Vec<u32> {
        running.agents().into_iter().filter(|pid| !self.killed.contains(pid)).collect()
    }

    fn kill_some(&mut self, running: &Running, count: u64) {
        let mut living = self.living(running);
        for _ in 0..count.min(living.len() as u64) {
            let place = self.dice.between(0, living.len() as u64 - 1) as usize;
            self.kill(living.swap_remove(place));
        }
    }

    fn kill_the_next(&mut self, running: &Running) {
        let others = self.living(running);
        let began = Instant::now();
        let next = loop {
            let next = self.living(running).into_iter().find(|pid| !others.contains(pid));
            if next.is_some() || began.elapsed() > Duration::from_secs(1) {
                break next;
            }
            pause(Duration::from_micros(100));
        };
        if let Some(next) = next {
            // Being ready takes 10 to 30 ms.
            pause(Duration::from_micros(self.dice.between(0, 30_000)));
            self.kill(next);
        }
    }

    fn kill(&mut self, pid: u32) {
        signal_pid(pid, Signal::KILL);
        self.killed.insert(pid);
    }
}

fn pause(time: Duration) {
    std::thread::sleep(time);
}

/// Columns of the lines of `events.csv`: time in s, kind, robot, detail.
fn rows(events: &str) -> impl Iterator<Item = (f64, &str, &str, &str)> {
    events.lines().skip(1).filter_map(|line| {
        let mut fields = line.splitn(4, ',');
        let t_s = fields.next()?.parse().ok()?;
        Some((t_s, fields.next()?, fields.next()?, fields.next()?))
    })
}

/// How far the run has come, by its newest event.
fn run_time_s(events: &str) -> f64 {
    rows(events).map(|(t_s, ..)| t_s).fold(0.0, f64::max)
}

/// d, m.
fn distance_min_m(what: Soaked) -> f64 {
    scenario(what.name, &[]).avoidance.distance_min_m
}

/// The run as it is soaked.
fn soaked(what: Soaked, seed: u64) -> Phalanx {
    let seed_word = seed.to_string();
    let delay_s = [0.0, 0.02, 0.2][seed as usize % 3];
    let run = run(what.name)
        .args(["--seed", seed_word.as_str()])
        .set(format!("duration_s={:?}", what.duration_s))
        .set(format!("expect={{min_distance_m={}}}", distance_min_m(what)))
        .set(format!("robot_defaults.restart_delay_s={delay_s:?}"))
        .set(format!("robot_defaults.max_restart_delay_s={delay_s:?}"))
        .set("robot_defaults.max_restarts=1000000");
    // Five times the chapter's period in real time: a busy machine is not what is soaked.
    if what.lockstep { run.lockstep() } else { run.set("period_s=0.01") }
}

/// How many files of each kind its processes share at present. The kind is what a name
/// ends in.
fn shared_files(running: &Running) -> BTreeMap<String, usize> {
    let mut kinds = BTreeMap::new();
    for name in running.roots().iter().flat_map(|root| files_below(root)) {
        let kind = name.extension().map_or("none".into(), |kind| kind.to_string_lossy());
        *kinds.entry(kind.into_owned()).or_default() += 1;
    }
    kinds
}

/// What the processes of such a run share when nobody dies.
fn files_of_an_undisturbed_run(what: Soaked) -> BTreeMap<String, usize> {
    let mut running = soaked(what, 0).start();
    let edges = scenario(what.name, &[]).graph.edges().len();
    running.wait_for("everybody heard", |run| {
        let events = run.events();
        (rows(&events).filter(|row| row.3.starts_with("fresh")).count() >= edges).then_some(())
    });
    shared_files(&running)
}

/// One run: kills, then peace. `files`: what its processes share if nobody dies.
fn simulate(what: Soaked, seed: u64, kills: usize, files: &BTreeMap<String, usize>) -> Toll {
    println!("soak: seed {seed}, up to {kills} kills, {what:?}");
    let mut reaper = Reaper { dice: SplitMix64::new(seed), killed: BTreeSet::new() };
    let running = soaked(what, seed).start();
    // The first die while the robots are coming up.
    while running.agents().is_empty() {
        pause(Duration::from_micros(100));
    }
    for _ in 0..reaper.dice.between(1, 3) {
        pause(Duration::from_micros(reaper.dice.between(0, 20_000)));
        reaper.kill_some(&running, 1);
    }
    reaper.strike(&running, kills, what.hostile_s);
    let kills = reaper.killed.len();

    // No remains of the dead among what the living share.
    let peace = Instant::now();
    let settled = loop {
        let found = (returned(&running.events(), kills), shared_files(&running));
        let settled = found.0 && found.1 == *files;
        if settled || peace.elapsed() > SETTLED_WITHIN || running.children().is_empty() {
            break found;
        }
        pause(Duration::from_millis(10));
    };
    let lingering = connections_of_the_dead(&running);
    let ended = running.finish();
    ended.exits_with(0).leaves_nothing().keeps_d();
    ended.claim(settled.0, "everybody returned");
    let found = settled.1;
    let left = format!("they share {files:?}, found {found:?}; of the dead: {lingering:?}");
    ended.claim(found == *files, left);
    ended.claim(ended.number("/t_s") == what.duration_s, "the run reached its end");
    survived(&ended, what, kills)
}

/// Connections with an end that is dead: the process ids of receiver and sender, and the mode.
fn connections_of_the_dead(running: &Running) -> Vec<([u32; 2], u32)> {
    let roots = running.roots();
    let ends = roots.iter().flat_map(|root| files_below(root)).filter_map(|path| {
        let name = path.file_stem()?.to_str()?.to_owned();
        let ids: Option<Vec<u128>> = name.rsplit('_').take(2).map(|id| id.parse().ok()).collect();
        // An id holds its process in its third 32 bits.
        let [receiver, sender] = ids?[..] else { return None };
        let ends = [receiver, sender].map(|id| (id >> 64) as u32);
        let mode = std::fs::metadata(&path).ok()?.mode();
        let dead = |pid: u32| !std::path::Path::new("/proc").join(pid.to_string()).exists();
        ends.into_iter().any(dead).then_some((ends, mode))
    });
    ends.collect()
}

/// The newest time at which all were alive with errors below the bound, s; in `samples.csv`.
fn home_since_s(samples: &str, error_m_max: f64) -> f64 {
    let mut instants: BTreeMap<u64, (&str, bool)> = BTreeMap::new();
    for line in samples.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [t_s, _, _, _, _, _, _, error_m, alive, ..] = fields[..] else { continue };
        let home = alive == "1" && error_m.parse().is_ok_and(|error_m: f64| error_m < error_m_max);
        let t_ns = (t_s.parse::<f64>().unwrap() * 1e9) as u64;
        instants.entry(t_ns).or_insert((t_s, true)).1 &= home;
    }
    let newest = instants.values().rev().find(|(_, home)| *home);
    newest.map_or(-1.0, |(t_s, _)| t_s.parse().unwrap())
}

/// Whether as many died as were killed, and everybody who died is ready again.
fn returned(events: &str, kills: usize) -> bool {
    let last: BTreeMap<&str, &str> = rows(events)
        .filter(|row| ["died", "restart", "ready"].contains(&row.1))
        .map(|row| (row.2, row.1))
        .collect();
    rows(events).filter(|row| row.1 == "died").count() == kills
        && last.values().all(|kind| *kind == "ready")
}

/// What the events tell of each death, each restart and each contact.
fn survived(ended: &Ended, what: Soaked, kills: usize) -> Toll {
    let events = ended.file("events.csv");
    let deaths: Vec<_> = rows(&events).filter(|row| row.1 == "died").collect();
    ended.claim(deaths.len() == kills, format!("{kills} died, found {}", deaths.len()));
    ended.claim(deaths.iter().all(|row| row.3 == "signal 9"), "of our signal, none by itself");
    let restarts = ended.summary["restarts"].as_object().unwrap();
    let restarts: u64 = restarts.values().map(|count| count.as_u64().unwrap()).sum();
    ended.claim(restarts == kills as u64, format!("{kills} restarts, found {restarts}"));
    ended.claim(returned(&events, kills), "everybody is ready again");

    if what.lockstep {
        ended.claim(ended.number("/final_error_m_max") < 1e-3, "everybody came home");
    } else {
        let home_s = home_since_s(&ended.file("samples.csv"), 2e-2);
        let last_s = deaths.iter().map(|row| row.0).fold(0.0, f64::max);
        ended.claim(home_s > last_s, "all came home at once after the last death");
    }

    let mut contacts = BTreeMap::new();
    for (t_s, kind, robot, detail) in rows(&events) {
        if kind == "contact" && !detail.contains("frame of the leader") {
            let (state, heard) = detail.split_once(' ').unwrap();
            contacts.insert((robot, heard), (state, t_s));
        }
    }
    let edges = scenario(what.name, &[]).graph.edges().len();
    ended.claim(contacts.len() == edges, "every neighbor was heard");
    for ((robot, heard), (state, since_s)) in contacts {
        // In real time a busy machine makes anybody stale for some milliseconds, even at the end.
        let momentary = !what.lockstep && state == "stale" && since_s > what.duration_s - 0.1;
        let hears = state == "fresh" || momentary;
        ended.claim(hears, format!("{robot} hears {heard}: {state} since {since_s} s"));
    }

    let mut ready = BTreeSet::new();
    let mut unready = 0;
    for (_, kind, robot, _) in rows(&events) {
        match kind {
            "ready" => _ = ready.insert(robot),
            "died" => unready += usize::from(!ready.remove(robot)),
            _ => {}
        }
    }
    let toll = Toll { runs: 1, kills, unready };
    println!("soak: {toll:?}");
    toll
}

/// Runs side by side, as many as a small machine has cores, until so many were killed. The output has the seed of
/// one that fails.
fn soak(runs: &[Soaked], kills: usize, kills_of_a_run: usize) -> Toll {
    let files: Vec<_> = runs.iter().map(|what| files_of_an_undisturbed_run(*what)).collect();
    let (began, mut toll) = (Instant::now(), Toll::default());
    let simulated = |seed: usize| {
        let place = (seed - 1) % runs.len();
        simulate(runs[place], seed as u64, kills_of_a_run, &files[place])
    };
    while toll.kills < kills {
        let seeds = toll.runs + 1..=toll.runs + SIDE_BY_SIDE;
        std::thread::scope(|scope| {
            let all: Vec<_> = seeds.map(|seed| scope.spawn(move || simulated(seed))).collect();
            for ran in all {
                toll.add(&ran.join().unwrap_or_else(|why| resume_unwind(why)));
            }
        });
    }
    println!("soak: in {:.0?} of wall time, in all {toll:?}", began.elapsed());
    toll
}

#[test]
fn real_time_kills_at_any_moment_recover_and_keep_d() {
    let toll = soak(&[in_real_time("pentagon"), in_real_time("containment")], 40 * times(), 20);
    assert!(toll.unready > 0, "somebody died while coming up: {toll:?}");
}

#[test]
fn lockstep_kills_at_any_moment_recover_and_keep_d() {
    let toll = soak(&[in_lockstep("pentagon"), in_lockstep("containment")], 20 * times(), 10);
    assert!(toll.unready > 0, "somebody died while coming up: {toll:?}");
}
