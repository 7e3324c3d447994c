//! `phalanx run`: the command line of a run, what of it does not fit together, and what is printed at the end.
//! The run itself is in `execute`.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::process::{exit, try_realtime_priority};
use supervisor::spawn::Launcher;
use supervisor::view::ViewError;

use super::cell::{self, CellArgs};
use super::execute::{Ended, How, LiveView, execute, read_programs};
use super::fleet::{FleetArgs, Member, must_be_of_one_host};
use super::must_be_outside_of_run_roots;
use super::ros2::Ros2Args;
use super::scenario::ScenarioArgs;
use super::screen::{Output, complain, misused, print, print_as, tell};
use super::share;
use experiment::scenario::Scenario;
use outcome::results::checksums;
use outcome::results::manifest::{Build, Manifest};
use outcome::results::page;
use outcome::results::run_dir::{RUNS, RunDirError, RunLocation};
use outcome::results::summary::to_json;

/// Arguments of `phalanx run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// How time passes.
    #[arg(long, value_enum, default_value_t = PaceArg::Realtime)]
    pace: PaceArg,
    /// Where to write the run; must not exist [default: runs/NAME-DATE-TIME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Let agents and plant run before every ordinary process, with their memory locked
    /// (SCHED_FIFO, mlockall); real time only.
    #[arg(long)]
    realtime_priority: bool,
    /// Show the run in a browser while it goes on, at a port or address of this machine [default: any
    /// free port]; the address to open is printed on stderr. The run never blocks on the browser.
    #[arg(
        long,
        value_name = "ADDR",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = supervisor::view::DEFAULT,
        default_value_if("view_control", "true", supervisor::view::DEFAULT),
        value_parser = supervisor::view::address
    )]
    view: Option<SocketAddr>,
    /// Show the run as --view does, and let that page kill, freeze and restart robots and cut edges.
    #[arg(long)]
    view_control: bool,
    /// Let --view=ADDR listen where other machines can reach it. There is no encryption: whoever sees
    /// the address printed, or the traffic, sees the run and, with --view-control, breaks it. The same for
    /// hosts of a --fleet without certificates: whoever reaches them moves the robots.
    #[arg(long)]
    insecure: bool,
    #[command(flatten)]
    fleet: FleetArgs,
    #[command(flatten)]
    ros2: Ros2Args,
    /// Write no figures and no report.html; `phalanx report` makes them later.
    #[arg(long)]
    no_report: bool,
    /// Measure and record nothing: what measuring costs is measured against this.
    #[arg(long, hide = true)]
    unmeasured: bool,
    /// What to print at the end.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
    #[command(flatten)]
    campaign: CellArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PaceArg {
    /// Simulated time, bit-identical from run to run.
    Lockstep,
    /// The machine's clock.
    Realtime,
}

impl RunArgs {
    /// Runs what the command line names; the exit code either way. An error came before any process.
    pub(super) fn run(
        &self,
        catalog: &Catalog,
        launcher: Launcher,
        build: &Build,
    ) -> Result<u8, u8> {
        self.must_fit_together()?;
        match &self.out {
            Some(out) => must_be_outside_of_run_roots(out, "--out"),
            None => must_be_outside_of_run_roots(RUNS.as_ref(), "the folder"),
        }?;
        let fleet = self.fleet.read(self.insecure)?;
        let set = fleet.as_ref().map_or(Vec::new(), Member::set);
        let (scenario, text) = self.scenario.read_with(&set, catalog)?;
        let part = match fleet {
            Some(fleet) => Some(fleet.part(&scenario, &text)?),
            None => must_be_of_one_host(&scenario).map(|()| None)?,
        };
        let lives_here = |robot: usize| {
            part.as_ref().is_none_or(|part| part.brief.robots[robot].host == part.brief.here)
        };
        let ros2 = self.ros2.read(&scenario, self.pace == PaceArg::Realtime, lives_here)?;
        // Before anything is written or spawned: the port may be taken.
        let live_view = self.live_view()?;
        let programs =
            read_programs(&scenario, &self.scenario.path).map_err(|_| exit::BAD_SCENARIO)?;
        let pace = self.pace();
        let mut manifest = Manifest::collect(&scenario, &self.scenario.path, pace, build);
        manifest.programs = programs.manifest_files();
        let launcher = self.with_priority(launcher, &mut manifest);
        if let Some(part) = &part
            && !part.has_plant()
        {
            if self.view.is_some() || ros2.is_some() {
                let why = "--view and --ros2 are for the plant's host, which sees all of the run";
                return Err(misused(&why));
            }
            let place = self.place(&scenario, self.fleet.host.as_deref());
            return share::run(&scenario, &text, part, &programs, &place, &launcher);
        }
        let how = How { part, ..How::new(pace, launcher, programs) };
        if let Some(cell) = &self.campaign.cell {
            // Other runs go on beside it.
            let how = How { launcher: how.launcher.without_awake(), ..how };
            return Ok(cell::run(&self.campaign, cell, &scenario, &text, &manifest, how));
        }
        let how = How { unmeasured: self.unmeasured, live_view, ros2, ..how };
        let ended = execute(&scenario, &text, &manifest, &self.place(&scenario, None), how);
        let ended = ended.map_err(|error| match error.downcast_ref() {
            Some(RunDirError::Exists(_)) => misused(&error),
            _ => complain(&error),
        })?;
        Ok(self.tell(&scenario, &ended))
    }

    /// Refuses options that contradict each other.
    fn must_fit_together(&self) -> Result<(), u8> {
        let lockstep = self.pace == PaceArg::Lockstep;
        let open = self.view.is_some() || self.fleet.is_given();
        let contradictions = [
            (
                lockstep && self.realtime_priority,
                "--realtime-priority is for --pace realtime: lockstep has no deadlines",
            ),
            (
                self.insecure && !open,
                "--insecure is for --view=ADDR and --fleet: nothing else is open to other machines",
            ),
            (
                lockstep && self.fleet.is_given(),
                "--fleet is for --pace realtime: in lockstep each tick would wait for the network",
            ),
        ];
        match contradictions.iter().find(|(contradicts, _)| *contradicts) {
            Some((_, why)) => Err(misused(why)),
            None => Ok(()),
        }
    }

    fn pace(&self) -> Pace {
        match self.pace {
            PaceArg::Lockstep => Pace::Lockstep,
            PaceArg::Realtime => Pace::Realtime,
        }
    }

    /// Takes the port at which people may look at the run.
    fn live_view(&self) -> Result<Option<LiveView>, u8> {
        let bound = self.view.map(|address| supervisor::view::bind(address, self.insecure));
        let bound = bound.transpose().map_err(|error| match error {
            ViewError::NotLoopback(_) => misused(&error),
            _ => complain(&error),
        })?;
        Ok(bound.map(|bound| LiveView { bound, control: self.view_control }))
    }

    /// With the priority that was asked for, if it is granted; the manifest says whether it was.
    fn with_priority(&self, launcher: Launcher, manifest: &mut Manifest) -> Launcher {
        if !self.realtime_priority {
            return launcher;
        }
        match try_realtime_priority() {
            Ok(()) => {
                manifest.realtime_priority = Some("granted".into());
                launcher.with_realtime_priority()
            }
            Err(error) => {
                tracing::warn!("running with ordinary priority: {error}");
                manifest.realtime_priority = Some(error.to_string());
                launcher
            }
        }
    }

    /// Where the run is written. `host`: of the share of one host.
    fn place(&self, scenario: &Scenario, host: Option<&str>) -> RunLocation {
        match (&self.out, host) {
            (Some(out), _) => RunLocation::Path(out.clone()),
            (None, Some(host)) => RunLocation::Dated(format!("{}-{host}", scenario.name)),
            (None, None) => RunLocation::Dated(scenario.name.clone()),
        }
    }

    /// Draws what was asked for and prints what came out; the exit code.
    fn tell(&self, scenario: &Scenario, ended: &Ended) -> u8 {
        let checksums = ended.written.then(|| checksums::write(&ended.out, &ended.out));
        let is_written = matches!(checksums, Some(Ok(())));
        if let Some(Err(error)) = checksums {
            complain(&format_args!("cannot write checksums into {}: {error}", ended.out.display()));
        }
        if ended.began && is_written && !self.no_report {
            // The run is written down: that its pictures are not changes nothing about it.
            if let Err(error) = page::write(&ended.out, scenario, None) {
                complain(&error);
            }
        }
        let printed = match self.output {
            // What was wrong was said already; of nothing there is nothing to show.
            Output::Text if !ended.began => exit::OK,
            Output::Text => {
                let written = if is_written { "written" } else { "not all of it is written" };
                let (screen, out) = (ended.screen.trim_end(), ended.out.display());
                print(&format!("{screen}\n{written} to {out}\n"))
            }
            Output::Json => print_as(Output::Json, &to_json(&ended.summary)),
        };
        // The last lines, after all figures.
        for (process, how) in &ended.failed {
            let log = ended.out.join(format!("logs/{process}.jsonl"));
            let log = if log.exists() { log.display().to_string() } else { "on its host".into() };
            tell(&format!("failed: {how}; its log: {log}"));
        }
        match ended.summary.exit {
            exit::OK | exit::EXPECTATION_MISSED if !is_written => exit::INFRASTRUCTURE,
            exit::OK => printed,
            code => code,
        }
    }
}
