//! `phalanx run`: its arguments, their validation, and the output at the end. `execute` performs the run.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::process::{check_realtime_priority, exit};
use supervisor::spawn::Launcher;
use supervisor::view::ViewError;

use super::cell::{self, CellArgs};
use super::execute::{ExecutionOptions, ExecutionResult, LiveView, execute, read_programs};
use super::fleet::{FleetArgs, FleetMember, HostPart, reject_host_faults};
use super::reject_inside_run_roots;
use super::ros2::Ros2Args;
use super::scenario::ScenarioArgs;
use super::screen::{OutputFormat, print, print_failure, print_info, print_misuse, print_result};
use super::share;
use experiment::scenario::Scenario;
use outcome::results::checksums;
use outcome::results::manifest::{BuildInfo, Manifest};
use outcome::results::page;
use outcome::results::run_dir::{RUNS_DIR, RunDirError, RunLocation};
use outcome::results::summary::to_json;

/// Arguments of `phalanx run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Time mode.
    #[arg(long, value_enum, default_value_t = PaceArg::Realtime)]
    pace: PaceArg,
    /// Directory to write the run to; must not exist [default: runs/NAME-DATE-TIME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Run agents and plant with SCHED_FIFO priority and locked memory (real time only).
    #[arg(long)]
    realtime_priority: bool,
    /// Show the run in a browser while it is in progress, at a port or address of this machine [default:
    /// any free port]. The address to open is printed on stderr. The run never waits for the browser.
    #[arg(
        long,
        value_name = "ADDR",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = supervisor::view::DEFAULT_ADDRESS,
        default_value_if("view_control", "true", supervisor::view::DEFAULT_ADDRESS),
        value_parser = supervisor::view::parse_address
    )]
    view: Option<SocketAddr>,
    /// Show the run as --view does, and let the page kill, freeze and restart robots and cut edges.
    #[arg(long)]
    view_control: bool,
    /// Allow --view=ADDR and the hosts of a --fleet without certificates to be reachable from other
    /// machines. Connections are not encrypted: any user of the network who learns the address can watch
    /// the run, control it with --view-control, and move the robots of a --fleet.
    #[arg(long)]
    insecure: bool,
    #[command(flatten)]
    fleet: FleetArgs,
    #[command(flatten)]
    ros2: Ros2Args,
    /// Write no figures and no report.html; `phalanx report` creates them later.
    #[arg(long)]
    no_report: bool,
    /// Measure and record nothing, as a baseline for the cost of measuring.
    #[arg(long, hide = true)]
    unmeasured: bool,
    /// Output format.
    #[arg(long, value_enum, default_value_t = OutputFormat::Text)]
    output: OutputFormat,
    #[command(flatten)]
    campaign: CellArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PaceArg {
    /// Simulated time; results are bit-identical from run to run.
    Lockstep,
    /// Real time, by the machine's clock.
    Realtime,
}

impl RunArgs {
    /// Runs the scenario and returns the exit code. `Err` holds the exit code of an error found before any
    /// process was started.
    pub(super) fn run(
        &self,
        catalog: &Catalog,
        launcher: Launcher,
        build: &BuildInfo,
    ) -> Result<u8, u8> {
        self.check_option_conflicts()?;
        match &self.out {
            Some(out) => reject_inside_run_roots(out, "--out"),
            None => reject_inside_run_roots(RUNS_DIR.as_ref(), "the folder"),
        }?;
        let fleet = self.fleet.read(self.insecure)?;
        let set = fleet.as_ref().map_or(Vec::new(), FleetMember::scenario_overrides);
        let (scenario, text) = self.scenario.read_with_keys(&set, catalog)?;
        let part = match fleet {
            Some(fleet) => Some(HostPart::new(fleet, &scenario, &text)?),
            None => reject_host_faults(&scenario).map(|()| None)?,
        };
        let is_local = |robot: usize| {
            part.as_ref().is_none_or(|part| part.brief.robots[robot].host == part.brief.here)
        };
        let ros2 =
            self.ros2.to_bridge_brief(&scenario, self.pace == PaceArg::Realtime, is_local)?;
        // Binds before anything is written or spawned, because the port may be in use.
        let live_view = self.bind_live_view()?;
        let programs =
            read_programs(&scenario, &self.scenario.path).map_err(|_| exit::BAD_SCENARIO)?;
        let pace = self.pace();
        let mut manifest = Manifest::collect(&scenario, &self.scenario.path, pace, build);
        manifest.programs = programs.manifest_files();
        let launcher = self.apply_priority(launcher, &mut manifest);
        if let Some(part) = &part
            && !part.has_plant()
        {
            if self.view.is_some() || ros2.is_some() {
                let message = "--view and --ros2 must be given on the plant's host, the only one that sees the whole run";
                return Err(print_misuse(&message));
            }
            let location = self.run_location(&scenario, self.fleet.host.as_deref());
            return share::run_host_part(&scenario, &text, part, &programs, &location, &launcher);
        }
        let options =
            ExecutionOptions { host_part: part, ..ExecutionOptions::new(pace, launcher, programs) };
        if let Some(cell) = &self.campaign.cell {
            // Other runs of the campaign use the remaining cores.
            let options =
                ExecutionOptions { launcher: options.launcher.without_awake_cores(), ..options };
            return Ok(cell::execute_campaign_run(
                &self.campaign,
                cell,
                &scenario,
                &text,
                &manifest,
                options,
            ));
        }
        let options =
            ExecutionOptions { is_unmeasured: self.unmeasured, live_view, ros2, ..options };
        let result =
            execute(&scenario, &text, &manifest, &self.run_location(&scenario, None), options);
        let result = result.map_err(|error| match error.downcast_ref() {
            Some(RunDirError::Exists(_)) => print_misuse(&error),
            _ => print_failure(&error),
        })?;
        Ok(self.finish(&scenario, &result))
    }

    /// Rejects options that contradict each other.
    fn check_option_conflicts(&self) -> Result<(), u8> {
        let is_lockstep = self.pace == PaceArg::Lockstep;
        let accepts_connections = self.view.is_some() || self.fleet.has_fleet();
        let contradictions = [
            (
                is_lockstep && self.realtime_priority,
                "--realtime-priority requires --pace realtime: lockstep has no deadlines",
            ),
            (
                self.insecure && !accepts_connections,
                "--insecure requires --view=ADDR or --fleet: nothing else accepts connections from other machines",
            ),
            (
                is_lockstep && self.fleet.has_fleet(),
                "--fleet requires --pace realtime: in lockstep each tick would wait for the network",
            ),
        ];
        match contradictions.iter().find(|(is_contradiction, _)| *is_contradiction) {
            Some((_, message)) => Err(print_misuse(message)),
            None => Ok(()),
        }
    }

    fn pace(&self) -> Pace {
        match self.pace {
            PaceArg::Lockstep => Pace::Lockstep,
            PaceArg::Realtime => Pace::Realtime,
        }
    }

    /// Binds the port of the live view, if requested.
    fn bind_live_view(&self) -> Result<Option<LiveView>, u8> {
        let server = self.view.map(|address| supervisor::view::bind(address, self.insecure));
        let server = server.transpose().map_err(|error| match error {
            ViewError::NotLoopback(_) => print_misuse(&error),
            _ => print_failure(&error),
        })?;
        Ok(server.map(|server| LiveView { bound_port: server, allows_control: self.view_control }))
    }

    /// Returns the launcher with real-time priority if requested and permitted. Records in the manifest
    /// whether it was granted.
    fn apply_priority(&self, launcher: Launcher, manifest: &mut Manifest) -> Launcher {
        if !self.realtime_priority {
            return launcher;
        }
        match check_realtime_priority() {
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

    /// Returns the output directory. `host` is the name of the host that writes only its own part.
    fn run_location(&self, scenario: &Scenario, host: Option<&str>) -> RunLocation {
        match (&self.out, host) {
            (Some(out), _) => RunLocation::Path(out.clone()),
            (None, Some(host)) => RunLocation::DatedName(format!("{}-{host}", scenario.name)),
            (None, None) => RunLocation::DatedName(scenario.name.clone()),
        }
    }

    /// Writes checksums and the report page, prints the result, and returns the exit code.
    fn finish(&self, scenario: &Scenario, result: &ExecutionResult) -> u8 {
        let checksums = result
            .all_files_written
            .then(|| checksums::write_checksums(&result.run_dir, &result.run_dir));
        let is_written = matches!(checksums, Some(Ok(())));
        if let Some(Err(error)) = checksums {
            print_failure(&format_args!(
                "cannot write checksums into {}: {error}",
                result.run_dir.display()
            ));
        }
        if result.has_begun && is_written && !self.no_report {
            // A missing page does not invalidate the run, which is already on disk.
            if let Err(error) = page::write_page(&result.run_dir, scenario, None) {
                print_failure(&error);
            }
        }
        let exit_code = match self.output {
            // The error has been reported, and there are no results to show.
            OutputFormat::Text if !result.has_begun => exit::OK,
            OutputFormat::Text => {
                let written_text = if is_written { "written" } else { "not all of it is written" };
                let (summary_text, run_dir) =
                    (result.summary_text.trim_end(), result.run_dir.display());
                print(&format!("{summary_text}\n{written_text} to {run_dir}\n"))
            }
            OutputFormat::Json => print_result(OutputFormat::Json, &to_json(&result.summary)),
        };
        // Printed last, below the figures.
        for (process, cause) in &result.failed_processes {
            let log = result.run_dir.join(format!("logs/{process}.jsonl"));
            let log = if log.exists() { log.display().to_string() } else { "on its host".into() };
            print_info(&format!("failed: {cause}; its log: {log}"));
        }
        match result.summary.exit {
            exit::OK | exit::EXPECTATION_MISSED if !is_written => exit::INFRASTRUCTURE_FAILURE,
            exit::OK => exit_code,
            code => code,
        }
    }
}
