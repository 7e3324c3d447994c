//! Soak test: agents are killed at random moments, from outside of the run and without a plan. No two robots may
//! come closer than d, each robot must be restarted, no process or file may be left, and after the last kill all
//! robots must return to their slots.

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt as _;
use std::panic::resume_unwind;
use std::time::{Duration, Instant};

use formation::random::SplitMix64;
use rustix::process::Signal;

use crate::harness::{
    FinishedRun, Phalanx, RunInProgress, event_cells, files_below, repetition_factor, run,
    signal_pid,
};
use crate::oracle::scenario;

/// Number of runs in parallel: the number of cores of a small machine.
const SIDE_BY_SIDE: usize = 2;

/// Deadline for the removal of dead processes' files after the last kill, in wall time. Far longer than it takes.
const SETTLED_WITHIN: Duration = Duration::from_secs(5);

/// A scenario of the soak test, with its time mode and duration.
#[derive(Debug, Clone, Copy)]
struct Soaked {
    name: &'static str,
    lockstep: bool,
    /// Run time, s. Short in real time; lockstep computes a minute quickly.
    duration_s: f64,
    /// Run time after which no agent is killed, s.
    hostile_s: f64,
}

const fn in_real_time(name: &'static str) -> Soaked {
    Soaked { name, lockstep: false, duration_s: 14.0, hostile_s: 6.0 }
}

const fn in_lockstep(name: &'static str) -> Soaked {
    Soaked { name, lockstep: true, duration_s: 60.0, hostile_s: 40.0 }
}

/// Counts of one run, or of all runs.
#[derive(Debug, Clone, Copy, Default)]
struct SoakStats {
    runs: usize,
    kills: usize,
    /// Number of deaths of processes that had not yet reported that they are ready.
    unready: usize,
}

impl SoakStats {
    fn add(&mut self, other: &SoakStats) {
        self.runs += other.runs;
        self.kills += other.kills;
        self.unready += other.unready;
    }
}

/// Kills agents of one run at random.
struct Reaper {
    rng: SplitMix64,
    /// Process ids of the killed agents.
    killed: BTreeSet<u32>,
}

impl Reaper {
    /// Kills agents until `kills` are dead, or run time is `until_s`.
    fn strike(&mut self, running: &RunInProgress, kills: usize, until_s: f64) {
        while self.killed.len() < kills && run_time_s(&running.events()) < until_s {
            let left = (kills - self.killed.len()) as u64;
            match self.rng.draw_between(0, 3) {
                // Several agents at the same instant, perhaps all.
                0 => {
                    let count = self.rng.draw_between(2, 8).min(left);
                    self.kill_some(running, count);
                }
                // One agent, and then the next process that is started, during its start.
                1 => {
                    self.kill_some(running, 1);
                    self.kill_the_next(running);
                }
                _ => self.kill_some(running, 1),
            }
            // A pause from less than a restart to much longer.
            let doublings = self.rng.draw_between(0, 8);
            pause(Duration::from_millis(1 << doublings).mul_f64(1.0 + self.rng.draw_unit()));
        }
    }

    fn live_agents(&self, running: &RunInProgress) -> Vec<u32> {
        running.agents().into_iter().filter(|pid| !self.killed.contains(pid)).collect()
    }

    fn kill_some(&mut self, running: &RunInProgress, count: u64) {
        let mut agents = self.live_agents(running);
        for _ in 0..count.min(agents.len() as u64) {
            let index = self.rng.draw_between(0, agents.len() as u64 - 1) as usize;
            self.kill(agents.swap_remove(index));
        }
    }

    fn kill_the_next(&mut self, running: &RunInProgress) {
        let others = self.live_agents(running);
        let start = Instant::now();
        let next = loop {
            let next = self.live_agents(running).into_iter().find(|pid| !others.contains(pid));
            if next.is_some() || start.elapsed() > Duration::from_secs(1) {
                break next;
            }
            pause(Duration::from_micros(100));
        };
        if let Some(next) = next {
            // A process needs 10 to 30 ms to become ready.
            pause(Duration::from_micros(self.rng.draw_between(0, 30_000)));
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

/// Parses the lines of `events.csv`: time in s, kind, robot, detail.
fn rows(events: &str) -> impl Iterator<Item = (f64, &str, &str, &str)> {
    events.lines().filter_map(event_cells)
}

/// Returns the run time of the newest event, s.
fn run_time_s(events: &str) -> f64 {
    rows(events).map(|(t_s, ..)| t_s).fold(0.0, f64::max)
}

/// Returns the minimum distance of the scenario (d), m.
fn distance_min_m(case: Soaked) -> f64 {
    scenario(case.name, &[]).avoidance.distance_min_m
}

/// Prepares a run of the scenario with this seed.
fn soaked(case: Soaked, seed: u64) -> Phalanx {
    let seed_word = seed.to_string();
    let delay_s = [0.0, 0.02, 0.2][seed as usize % 3];
    let run = run(case.name)
        .args(["--seed", seed_word.as_str()])
        .set(format!("duration_s={:?}", case.duration_s))
        .set(format!("expect={{min_distance_m={}}}", distance_min_m(case)))
        .set(format!("robot_defaults.restart_delay_s={delay_s:?}"))
        .set(format!("robot_defaults.max_restart_delay_s={delay_s:?}"))
        .set("robot_defaults.max_restarts=1000000");
    // Five times the chapter's period in real time: the load of the machine is not under test.
    if case.lockstep { run.lockstep() } else { run.set("period_s=0.01") }
}

/// Counts the shared files of the run at present by kind. The kind is the extension of the name.
fn shared_files(running: &RunInProgress) -> BTreeMap<String, usize> {
    let mut kinds = BTreeMap::new();
    for name in running.roots().iter().flat_map(|root| files_below(root)) {
        let kind = name.extension().map_or("none".into(), |kind| kind.to_string_lossy());
        *kinds.entry(kind.into_owned()).or_default() += 1;
    }
    kinds
}

/// Counts the shared files of a run without kills, by kind.
fn files_of_an_undisturbed_run(case: Soaked) -> BTreeMap<String, usize> {
    let mut running = soaked(case, 0).start();
    let edges = scenario(case.name, &[]).graph.edges().len();
    running.wait_for("all robots received", |run| {
        let events = run.events();
        (rows(&events).filter(|row| row.3.starts_with("fresh")).count() >= edges).then_some(())
    });
    shared_files(&running)
}

/// Simulates one run: kills, then a time without kills. `files` has the shared files of a run without kills.
fn simulate(case: Soaked, seed: u64, kills: usize, files: &BTreeMap<String, usize>) -> SoakStats {
    println!("soak: seed {seed}, up to {kills} kills, {case:?}");
    let mut reaper = Reaper { rng: SplitMix64::new(seed), killed: BTreeSet::new() };
    let running = soaked(case, seed).start();
    // The first kills happen while the robots are starting.
    while running.agents().is_empty() {
        pause(Duration::from_micros(100));
    }
    for _ in 0..reaper.rng.draw_between(1, 3) {
        pause(Duration::from_micros(reaper.rng.draw_between(0, 20_000)));
        reaper.kill_some(&running, 1);
    }
    reaper.strike(&running, kills, case.hostile_s);
    let kills = reaper.killed.len();

    // No file of a dead process may remain among the shared files.
    let quiet_time = Instant::now();
    let outcome = loop {
        let found = (returned(&running.events(), kills), shared_files(&running));
        let is_restored = found.0 && found.1 == *files;
        if is_restored || quiet_time.elapsed() > SETTLED_WITHIN || running.children().is_empty() {
            break found;
        }
        pause(Duration::from_millis(10));
    };
    let dead_connections = connections_of_the_dead(&running);
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    ended.assert_holds(outcome.0, "all robots returned");
    let found = outcome.1;
    let left = format!("they share {files:?}, found {found:?}; of the dead: {dead_connections:?}");
    ended.assert_holds(found == *files, left);
    ended.assert_holds(ended.number("/t_s") == case.duration_s, "the run reached its end");
    survived(&ended, case, kills)
}

/// Returns the connections with a dead end: the process ids of receiver and sender, and the mode.
fn connections_of_the_dead(running: &RunInProgress) -> Vec<([u32; 2], u32)> {
    let roots = running.roots();
    let endpoints = roots.iter().flat_map(|root| files_below(root)).filter_map(|path| {
        let name = path.file_stem()?.to_str()?.to_owned();
        let ids: Option<Vec<u128>> = name.rsplit('_').take(2).map(|id| id.parse().ok()).collect();
        // An id has the process id in its third 32 bits.
        let [receiver, sender] = ids?[..] else { return None };
        let endpoints = [receiver, sender].map(|id| (id >> 64) as u32);
        let mode = std::fs::metadata(&path).ok()?.mode();
        let dead = |pid: u32| !std::path::Path::new("/proc").join(pid.to_string()).exists();
        endpoints.into_iter().any(dead).then_some((endpoints, mode))
    });
    endpoints.collect()
}

/// Returns the newest time in `samples.csv` at which all robots were alive with errors below the bound, s. -1 if there
/// is none.
fn last_return_s(samples: &str, error_m_max: f64) -> f64 {
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

/// Returns whether the number of deaths is `kills`, and every robot that died is ready again.
fn returned(events: &str, kills: usize) -> bool {
    let last: BTreeMap<&str, &str> = rows(events)
        .filter(|row| ["died", "restart", "ready"].contains(&row.1))
        .map(|row| (row.2, row.1))
        .collect();
    rows(events).filter(|row| row.1 == "died").count() == kills
        && last.values().all(|kind| *kind == "ready")
}

/// Counts the deaths of a run. Checks the events of each death, restart and contact.
fn survived(ended: &FinishedRun, case: Soaked, kills: usize) -> SoakStats {
    let events = ended.file("events.csv");
    let deaths: Vec<_> = rows(&events).filter(|row| row.1 == "died").collect();
    ended.assert_holds(deaths.len() == kills, format!("{kills} died, found {}", deaths.len()));
    ended.assert_holds(
        deaths.iter().all(|row| row.3 == "signal 9"),
        "of our signal, none by itself",
    );
    let restarts = ended.summary["restarts"].as_object().unwrap();
    let restarts: u64 = restarts.values().map(|count| count.as_u64().unwrap()).sum();
    ended.assert_holds(restarts == kills as u64, format!("{kills} restarts, found {restarts}"));
    ended.assert_holds(returned(&events, kills), "all robots are ready again");

    if case.lockstep {
        ended.assert_holds(
            ended.number("/final_error_m_max") < 1e-3,
            "all robots are back in their slots",
        );
    } else {
        let home_s = last_return_s(&ended.file("samples.csv"), 2e-2);
        let last_s = deaths.iter().map(|row| row.0).fold(0.0, f64::max);
        ended.assert_holds(home_s > last_s, "all came home at once after the last death");
    }

    let mut contacts = BTreeMap::new();
    for (t_s, kind, robot, detail) in rows(&events) {
        if kind == "contact" && !detail.contains("frame of the leader") {
            let (state, in_neighbor) = detail.split_once(' ').unwrap();
            contacts.insert((robot, in_neighbor), (state, t_s));
        }
    }
    let edges = scenario(case.name, &[]).graph.edges().len();
    ended.assert_holds(contacts.len() == edges, "every neighbor was heard");
    for ((robot, in_neighbor), (state, since_s)) in contacts {
        // In real time, a busy machine makes any robot stale for some milliseconds, even at the end.
        let momentary = !case.lockstep && state == "stale" && since_s > case.duration_s - 0.1;
        let is_received = state == "fresh" || momentary;
        ended.assert_holds(
            is_received,
            format!("{robot} hears {in_neighbor}: {state} since {since_s} s"),
        );
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
    let stats = SoakStats { runs: 1, kills, unready };
    println!("soak: {stats:?}");
    stats
}

/// Simulates runs in parallel until `kills` agents were killed. Prints the seed of every run, so that a failed one can
/// be repeated.
fn soak(runs: &[Soaked], kills: usize, kills_of_a_run: usize) -> SoakStats {
    let files: Vec<_> = runs.iter().map(|case| files_of_an_undisturbed_run(*case)).collect();
    let (start, mut stats) = (Instant::now(), SoakStats::default());
    let simulated = |seed: usize| {
        let index = (seed - 1) % runs.len();
        simulate(runs[index], seed as u64, kills_of_a_run, &files[index])
    };
    while stats.kills < kills {
        let seeds = stats.runs + 1..=stats.runs + SIDE_BY_SIDE;
        std::thread::scope(|scope| {
            let all: Vec<_> = seeds.map(|seed| scope.spawn(move || simulated(seed))).collect();
            for ran in all {
                stats.add(&ran.join().unwrap_or_else(|why| resume_unwind(why)));
            }
        });
    }
    println!("soak: in {:.0?} of wall time, in all {stats:?}", start.elapsed());
    stats
}

#[test]
fn real_time_kills_at_any_moment_recover_and_keep_d() {
    let stats = soak(
        &[in_real_time("pentagon"), in_real_time("containment")],
        40 * repetition_factor(),
        20,
    );
    assert!(stats.unready > 0, "some robots died while starting: {stats:?}");
}

#[test]
fn lockstep_kills_at_any_moment_recover_and_keep_d() {
    let stats =
        soak(&[in_lockstep("pentagon"), in_lockstep("containment")], 20 * repetition_factor(), 10);
    assert!(stats.unready > 0, "some robots died while starting: {stats:?}");
}
