//! How a run begins: from the run root to the first process of every robot.

use std::collections::VecDeque;
use std::time::Instant;

use protocol::brief::{AgentBrief, Pace};
use protocol::process::Stop;
use protocol::run_root::{self, RunRoot, RunRootError};
use protocol::service::{self, Factory};

use super::Run;
use super::conduct::Conduct;
use super::error::RunError;
use super::load::Load;
use super::services::Services;
use crate::dead_nodes::Cleaner;
use crate::descriptors;
use crate::latency::Latency;
use crate::outcome::Outcome;
use crate::robot::{Robot, start_order};
use crate::run_dir::RunDir;
use crate::spawn::{Launcher, Role, SpawnError};
use crate::timeline::Timeline;
use experiment::briefs;
use experiment::scenario::Scenario;
use metrics::Metrics;

impl<'a> Run<'a> {
    /// Makes the run root and all services, writes the briefs and starts every process. `by_hand`:
    /// somebody may break things by hand.
    pub fn launch(
        scenario: &'a Scenario,
        pace: Pace,
        launcher: &Launcher,
        by_hand: bool,
        run_dir: &'a mut RunDir,
        metrics: &'a mut Metrics,
        stop: Stop,
    ) -> Result<Run<'a>, RunError> {
        descriptors::make_room(scenario.robots.len())?;
        let base = run_root::base();
        for removed in run_root::sweep(&base) {
            tracing::info!(path = %removed.display(), "removed what a dead run left");
        }
        let run_root = RunRoot::create(&base)?;
        run_root::join(run_root.path())?;
        let node = service::node("supervisor")?;
        run_root.make_private().map_err(|source| RunRootError::Io {
            action: "close to other users",
            path: run_root.path().into(),
            source,
        })?;
        let conduct = Conduct::new(scenario, pace, &run_root, launcher)?;
        // Each takes descriptors and memory: only where they can be of use.
        let links_by_hand = by_hand && conduct.cuts_links_by_hand();
        let services = Services::create(&node, scenario, pace, links_by_hand)?;
        let truth = services.truth.subscriber()?;
        let latencies =
            services.latencies.iter().map(Factory::subscriber).collect::<Result<_, _>>()?;
        let count = scenario.robots.len();
        let heard = |i| scenario.graph.heard_by(i).count();
        let to_robots = services.faults.iter().enumerate();
        let faults_by_hand =
            to_robots.map(|(i, faults)| faults.publisher(heard(i))).collect::<Result<_, _>>()?;
        let cleaner = Cleaner::start(&run_root)
            .map_err(|source| SpawnError::of_thread("the clean-up thread", source))?;

        let plant_brief = briefs::plant(scenario, pace, run_root.path());
        let plant_brief = run_dir.write_brief("plant", &plant_brief)?;
        let launched = Instant::now();
        let plant = Role::Plant { brief: &plant_brief };
        let plant = launcher.spawn(plant, &run_dir.log_path("plant"))?;
        let mut robots = Vec::new();
        for (i, robot) in scenario.robots.iter().enumerate() {
            let brief = briefs::agent(scenario, i, pace, run_root.path());
            let brief = AgentBrief { links_by_hand, ..brief };
            let told = run_dir.write_brief(&robot.name, &brief)?;
            let log = run_dir.log_path(&robot.name);
            let status = services.status[i].subscriber()?;
            robots.push(Robot::new(&robot.name, told, log, status, count));
        }
        for i in start_order(scenario.seed, robots.len()) {
            robots[i].start(launcher)?;
        }
        Ok(Run {
            scenario,
            run_dir,
            metrics,
            stop,
            view: None,
            asked: VecDeque::new(),
            cuts: vec![None; scenario.graph.edges().len()],
            outcome: Outcome {
                restarts: vec![0; robots.len()],
                latency: Latency::new(scenario, pace),
                ..Outcome::default()
            },
            timeline: Timeline::new(scenario),
            alive: vec![true; robots.len()],
            last_news: Instant::now(),
            reports_taken: Instant::now(),
            all_seen_alive_ns: 0,
            launched,
            began: None,
            robots,
            plant,
            load: Load::default(),
            launcher: launcher.clone(),
            truth,
            latencies,
            faults_by_hand,
            cleaner,
            conduct,
            _services: services,
            _node: node,
            run_root,
        })
    }
}
