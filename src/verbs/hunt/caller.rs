//! A margin that whoever started the hunt says: each run is written into a directory, whose path is a line of standard
//! output after "? ", and the next line of standard input is the margin.

use std::fs;
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::sync::Mutex;

use experiment::scenario::Scenario;
use outcome::results::manifest::Build;
use protocol::number::short;

use super::page;
use crate::verbs::cell_in_process::in_words;

/// Who says the margin.
pub(super) struct Caller {
    /// What it is called.
    pub(super) name: String,
    folder: PathBuf,
    /// How many runs were asked about: one at a time.
    asked: Mutex<usize>,
}

impl Caller {
    /// The margin of this name; runs are written into the folder.
    pub(super) fn new(name: String, folder: PathBuf) -> Caller {
        Caller { name, folder, asked: Mutex::new(0) }
    }

    /// The margin of a run of this scenario, whose effective text is `text`; or why there is none.
    pub(super) fn margin(
        &self,
        scenario: &Scenario,
        text: &str,
        build: &Build,
    ) -> Result<f64, String> {
        let mut asked = self.asked.lock().map_err(in_words)?;
        *asked += 1;
        let run_dir = self.folder.join(format!("asked-{asked}"));
        page::record(scenario, text, &self.folder, &run_dir, build)?;
        let answer = ask(&run_dir.to_string_lossy());
        let _ = fs::remove_dir_all(&run_dir);
        let answer = answer.map_err(in_words)?;
        match answer.trim().parse::<f64>() {
            Ok(margin) if !margin.is_nan() => Ok(margin),
            _ if answer.is_empty() => Err(format!("whoever is to say {} has ended", self.name)),
            _ => Err(format!("{} is {:?}; expected a number", self.name, answer.trim())),
        }
    }

    /// What a run with this margin does, in one sentence.
    pub(super) fn in_words(&self, margin: f64) -> String {
        format!("{} is {}; expected: at least 0", self.name, short(margin))
    }
}

fn ask(run_dir: &str) -> io::Result<String> {
    let mut screen = io::stdout().lock();
    writeln!(screen, "? {run_dir}")?;
    screen.flush()?;
    let mut answer = String::new();
    io::stdin().read_line(&mut answer)?;
    Ok(answer)
}
