//! Executes a run as a `phalanx run` of this executable, which starts a process for each robot.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::process::{Stop, exit};
use supervisor::child::{Child, describe_exit};
use supervisor::spawn::{Launcher, Role};

use super::{AttemptResult, RunExecutor};
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Campaign;
use outcome::campaign::folder::{Folder, partial_run_dir, sibling_path};

/// Interval at which signals and deadlines are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Time after its deadline at which a run that has not ended itself is killed.
const KILL_DELAY: Duration = Duration::from_secs(15);
const LOG_LINES: usize = 8;

/// Execution of a campaign's runs by processes.
#[derive(Debug, Clone, Copy)]
pub struct ByProcesses<'a> {
    /// Campaign to execute.
    pub campaign: &'a Campaign,
    /// Folder of the campaign's runs.
    pub folder: &'a Folder,
    /// Launcher of the processes.
    pub launcher: &'a Launcher,
    /// Stop flag that ends the runs early.
    pub stop: &'a Stop,
}

impl RunExecutor for ByProcesses<'_> {
    fn attempt(&self, cell: &Cell) -> AttemptResult {
        let run = self.folder.run(&cell.id);
        let log = sibling_path(&run, "log");
        let mut child = match self.start(cell, &run, &log) {
            Ok(child) => child,
            Err(why) => return AttemptResult::Refused(why),
        };
        let ended = self.wait(&mut child);
        let _ = std::fs::remove_dir_all(partial_run_dir(&run, child.pid()));
        let forget_log = || {
            let _ = std::fs::remove_file(&log);
        };
        match ended {
            None if self.stop.is_requested() => {
                forget_log();
                AttemptResult::Stopped
            }
            None => AttemptResult::Failed(format!(
                "killed: it took more than {} s",
                self.campaign.deadline_s
            )),
            Some(status) => match status.code().map(|code| code as u8) {
                Some(exit::OK) => {
                    forget_log();
                    AttemptResult::Done
                }
                // The run was valid a moment ago, so a repetition would be rejected again.
                Some(exit::USAGE | exit::BAD_SCENARIO) => {
                    AttemptResult::Refused(child.last_lines(LOG_LINES))
                }
                _ => AttemptResult::Failed(describe_exit(status)),
            },
        }
    }
}

impl ByProcesses<'_> {
    fn start(&self, cell: &Cell, run: &Path, log: &Path) -> Result<Child, String> {
        let words: Vec<OsString> =
            cell.arguments(self.campaign, run).into_iter().map(OsString::from).collect();
        let child = self.launcher.spawn(Role::Run { words: &words }, log);
        child.map_err(|error| error.to_string())
    }

    /// Waits for the run to exit and returns its status; `None` if it was terminated by the stop flag or
    /// killed after its deadline.
    fn wait(&self, child: &mut Child) -> Option<ExitStatus> {
        let began = Instant::now();
        let limit = Duration::from_secs_f64(self.campaign.deadline_s) + KILL_DELAY;
        loop {
            if let Some(status) = child.wait_timeout(POLL_INTERVAL) {
                return Some(status);
            }
            if self.stop.is_requested() {
                child.terminate();
                child.wait_timeout(KILL_DELAY);
                child.end();
                return None;
            }
            if began.elapsed() > limit {
                child.end();
                return None;
            }
        }
    }
}
