//! A run as a `phalanx run` of this executable, which starts a process for each robot.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::process::{Stop, exit};
use supervisor::child::{Child, in_words};
use supervisor::spawn::{Launcher, Role};

use super::{Tried, Way};
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Campaign;
use outcome::campaign::folder::{Folder, partial_dir_of, sibling_path};

/// How often signals and deadlines are looked for.
const LOOK: Duration = Duration::from_millis(50);
/// A run ends itself at its deadline; one that does not is killed this long after.
const GRACE: Duration = Duration::from_secs(15);
const LOG_LINES: usize = 8;

/// Runs of a campaign by processes.
#[derive(Debug, Clone, Copy)]
pub struct ByProcesses<'a> {
    /// The campaign.
    pub campaign: &'a Campaign,
    /// Where its runs go.
    pub folder: &'a Folder,
    /// What starts them.
    pub launcher: &'a Launcher,
    /// What ends them early.
    pub stop: &'a Stop,
}

impl Way for ByProcesses<'_> {
    fn attempt(&self, cell: &Cell) -> Tried {
        let run = self.folder.run(&cell.id);
        let log = sibling_path(&run, "log");
        let mut child = match self.start(cell, &run, &log) {
            Ok(child) => child,
            Err(why) => return Tried::Refused(why),
        };
        let ended = self.wait(&mut child);
        let _ = std::fs::remove_dir_all(partial_dir_of(&run, child.pid()));
        let forget_log = || {
            let _ = std::fs::remove_file(&log);
        };
        match ended {
            None if self.stop.requested() => {
                forget_log();
                Tried::Stopped
            }
            None => {
                Tried::Failed(format!("killed: it took more than {} s", self.campaign.deadline_s))
            }
            Some(status) => match status.code().map(|code| code as u8) {
                Some(exit::OK) => {
                    forget_log();
                    Tried::Done
                }
                // It was found sound a moment ago: trying again helps nobody.
                Some(exit::USAGE | exit::BAD_SCENARIO) => {
                    Tried::Refused(child.last_lines(LOG_LINES))
                }
                _ => Tried::Failed(in_words(status)),
            },
        }
    }
}

impl ByProcesses<'_> {
    fn start(&self, cell: &Cell, run: &Path, log: &Path) -> Result<Child, String> {
        let words: Vec<OsString> =
            cell.words(self.campaign, run).into_iter().map(OsString::from).collect();
        let child = self.launcher.spawn(Role::Run { words: &words }, log);
        child.map_err(|error| error.to_string())
    }

    /// How it ended; `None` if it was ended, by a signal for all or past its deadline.
    fn wait(&self, child: &mut Child) -> Option<ExitStatus> {
        let began = Instant::now();
        let limit = Duration::from_secs_f64(self.campaign.deadline_s) + GRACE;
        loop {
            if let Some(status) = child.ended_within(LOOK) {
                return Some(status);
            }
            if self.stop.requested() {
                child.terminate();
                child.ended_within(GRACE);
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
