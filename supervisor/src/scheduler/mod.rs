//! Who held a core while a robot that was due waited for it: a trace of the kernel's scheduler beside a
//! run in real time. Needs privilege, and nothing of the robots: their deadlines are known beforehand.
//!
//! | file | question it answers |
//! |---|---|
//! | `switches` | which thread does each core run, and since when? |
//! | `attribution` | who held the core, of those late wake-ups? |
//! | `names` | what is a process called? |

mod attribution;
mod names;
mod switches;

use std::collections::BTreeMap;
use std::io;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::Duration;

use outcome::metrics::summary::{Holder, SchedulerTrace};
use protocol::clock::{self, golden_phase};
use rustix::thread::{CpuSet, sched_getaffinity};

use attribution::{Attribution, Held};
use names::Names;
use switches::{Event, Switches};

/// How often switches are taken from the kernel.
const TURN: Duration = Duration::from_millis(20);

/// Whose name was not read in time.
const ENDED: &str = "a process that has ended";

/// Why the scheduler cannot be traced.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The kernel keeps it from us, or has no such thing.
    #[error(
        "cannot trace the scheduler: {0}; it needs root, CAP_PERFMON, or kernel.perf_event_paranoid at most 0"
    )]
    Refused(io::Error),
    /// There is no thread for it.
    #[error("cannot trace the scheduler: {0}")]
    Thread(io::Error),
}

/// A trace under way.
#[derive(Debug)]
pub struct Trace {
    news: Sender<News>,
    thread: JoinHandle<SchedulerTrace>,
    /// The process of each robot that it knows of, by place.
    robots: BTreeMap<usize, u32>,
}

enum News {
    Process { process: u32, name: String },
    Robot { robot: usize, process: u32 },
    Gone { process: u32 },
}

/// Whether this machine lets us trace its scheduler.
pub fn available() -> Result<(), TraceError> {
    Switches::of(cores()).map(drop).map_err(TraceError::Refused)
}

impl Trace {
    /// Begins, for robots with this period, ns.
    pub fn start(period_ns: u64) -> Result<Trace, TraceError> {
        let cores = cores();
        let most = cores.iter().max().map_or(0, |core| core + 1);
        let switches = Switches::of(cores).map_err(TraceError::Refused)?;
        let (news, heard) = mpsc::channel();
        let tracer = Tracer {
            attribution: Attribution::new(period_ns, most),
            period_ns,
            switches,
            seen: 0,
            ours: BTreeMap::from([(0, "nobody: it was idle".to_owned())]),
            foreign: Names::default(),
        };
        let thread = std::thread::Builder::new().name("scheduler-trace".into());
        let thread = thread.spawn(move || tracer.run(&heard)).map_err(TraceError::Thread)?;
        let trace = Trace { news, thread, robots: BTreeMap::new() };
        trace.process(std::process::id(), "supervisor");
        Ok(trace)
    }

    /// This process of the run has this name.
    pub fn process(&self, process: u32, name: &str) {
        self.tell(News::Process { process, name: name.to_owned() });
    }

    /// These are the robots' processes now, by place.
    pub fn robots(&mut self, robots: impl Iterator<Item = (usize, u32)>) {
        let now: BTreeMap<usize, u32> = robots.collect();
        if now == self.robots {
            return;
        }
        for (robot, &process) in &self.robots {
            if now.get(robot) != Some(&process) {
                self.tell(News::Gone { process });
            }
        }
        for (&robot, &process) in &now {
            if self.robots.get(&robot) != Some(&process) {
                self.tell(News::Robot { robot, process });
            }
        }
        self.robots = now;
    }

    /// Ends it; what came out.
    pub fn end(self) -> SchedulerTrace {
        drop(self.news);
        self.thread.join().unwrap_or_default()
    }

    fn tell(&self, news: News) {
        // It hears until the end, unless it panicked: then nothing comes out.
        let _ = self.news.send(news);
    }
}

struct Tracer {
    period_ns: u64,
    switches: Switches,
    seen: u64,
    attribution: Attribution,
    /// Of the run's processes. All robots have one name: which of them it was says little.
    ours: BTreeMap<u32, String>,
    /// Of others.
    foreign: Names,
}

impl Tracer {
    fn run(mut self, heard: &Receiver<News>) -> SchedulerTrace {
        loop {
            let news = heard.recv_timeout(TURN);
            self.take();
            match news {
                Ok(News::Process { process, name }) => {
                    self.ours.insert(process, name);
                }
                Ok(News::Robot { robot, process }) => {
                    let phase_ns = (golden_phase(robot + 1) * self.period_ns as f64) as u64;
                    self.attribution.watch(process, phase_ns, clock::now_ns());
                    self.ours.insert(process, "another robot".to_owned());
                }
                Ok(News::Gone { process }) => self.attribution.forget(process),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.into_result(),
            }
        }
    }

    fn take(&mut self) {
        for event in self.switches.take_until(clock::now_ns()) {
            match event {
                Event::Switch(switch) => {
                    self.seen += 1;
                    let holders = self.attribution.take(switch);
                    let foreign = holders.iter().filter(|holder| !self.ours.contains_key(holder));
                    foreign.for_each(|&process| self.foreign.held(process));
                }
                Event::Began { process } => self.foreign.began(process),
                Event::Named { process, name } => self.foreign.named(process, &name),
            }
        }
    }

    fn into_result(self) -> SchedulerTrace {
        let mut by_name = BTreeMap::<&str, Held>::new();
        for (process, held) in self.attribution.held() {
            let name = self.ours.get(process).map(String::as_str);
            let name = name.or_else(|| self.foreign.get(*process));
            let sum = by_name.entry(name.unwrap_or(ENDED)).or_default();
            sum.late += held.late;
            sum.held_ns += held.held_ns;
        }
        let mut held_by: Vec<Holder> = by_name
            .into_iter()
            .map(|(who, Held { late, held_ns })| Holder {
                who: who.to_owned(),
                late,
                held_s: held_ns as f64 / 1e9,
            })
            .collect();
        held_by.sort_by(|a, b| (b.late, b.held_s).partial_cmp(&(a.late, a.held_s)).expect("times"));
        let (late, lost) = (self.attribution.late(), self.switches.lost);
        SchedulerTrace { late, switches: self.seen, lost, held_by }
    }
}

/// The cores that robots may run on.
fn cores() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_default();
    (0..CpuSet::MAX_CPU).filter(|&core| set.is_set(core)).collect()
}
