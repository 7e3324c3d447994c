//! Executes a run as a `phalanx run` of this executable, which starts a process for each robot.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::process::{StopFlag, exit};
use supervisor::child::{Child, describe_exit};
use supervisor::spawn::{Launcher, ProcessRole};

use super::{AttemptResult, RunExecutor};
use experiment::campaign::cells::CampaignRun;
use experiment::campaign::file::Campaign;
use outcome::campaign::folder::{CampaignFolder, partial_run_dir, sibling_path};

/// Interval at which signals and deadlines are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Time after its deadline at which a run that has not ended itself is killed.
const KILL_DELAY: Duration = Duration::from_secs(15);
const SHOWN_LOG_LINES: usize = 8;

/// Execution of a campaign's runs by processes.
#[derive(Debug, Clone, Copy)]
pub struct ProcessExecutor<'a> {
    /// Campaign to execute.
    pub campaign: &'a Campaign,
    /// Folder of the campaign's runs.
    pub folder: &'a CampaignFolder,
    /// Launcher of the processes.
    pub launcher: &'a Launcher,
    /// Stop flag that ends the runs early.
    pub stop: &'a StopFlag,
}

impl RunExecutor for ProcessExecutor<'_> {
    fn attempt(&self, cell: &CampaignRun) -> AttemptResult {
        let run_path = self.folder.run_path(&cell.id);
        let log = sibling_path(&run_path, "log");
        let mut child = match self.start(cell, &run_path, &log) {
            Ok(child) => child,
            Err(error) => return AttemptResult::Refused(error),
        };
        let status = wait_for_run(&mut child, self.stop, self.campaign.deadline_s);
        let _ = std::fs::remove_dir_all(partial_run_dir(&run_path, child.pid()));
        let remove_log = || {
            let _ = std::fs::remove_file(&log);
        };
        match status {
            None if self.stop.is_requested() => {
                remove_log();
                AttemptResult::Stopped
            }
            None => AttemptResult::Failed(format!(
                "killed: it took more than {} s",
                self.campaign.deadline_s
            )),
            Some(status) => match status.code().map(|code| code as u8) {
                Some(exit::OK) => {
                    remove_log();
                    AttemptResult::Done
                }
                // The run was valid a moment ago, so a repetition would be rejected again.
                Some(exit::USAGE_ERROR | exit::BAD_SCENARIO) => {
                    AttemptResult::Refused(child.last_lines(SHOWN_LOG_LINES))
                }
                _ => AttemptResult::Failed(describe_exit(status)),
            },
        }
    }
}

impl ProcessExecutor<'_> {
    fn start(&self, cell: &CampaignRun, run_path: &Path, log: &Path) -> Result<Child, String> {
        let arguments: Vec<OsString> =
            cell.arguments(self.campaign, run_path).into_iter().map(OsString::from).collect();
        let child = self.launcher.spawn(ProcessRole::Run { arguments: &arguments }, log);
        child.map_err(|error| error.to_string())
    }
}

/// Waits for a `phalanx run` to exit and returns its status; `None` if it was terminated by the stop flag, or killed
/// because it had not ended itself at its deadline, which is given in s.
pub fn wait_for_run(child: &mut Child, stop: &StopFlag, deadline_s: f64) -> Option<ExitStatus> {
    let start = Instant::now();
    let limit = Duration::from_secs_f64(deadline_s) + KILL_DELAY;
    loop {
        if let Some(status) = child.wait_timeout(POLL_INTERVAL) {
            return Some(status);
        }
        if stop.is_requested() {
            child.terminate();
            child.wait_timeout(KILL_DELAY);
            child.kill_and_wait();
            return None;
        }
        if start.elapsed() > limit {
            child.kill_and_wait();
            return None;
        }
    }
}
