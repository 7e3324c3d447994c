//! Robots whose law is in a program of the scenario's own, whatever language it is written in: what all of them must show
//! in the pentagon, where r3 has that law, `mine`. The languages' own files say how its program comes about.

use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

use crate::harness::{Ended, ExitsWith as _, Phalanx};

/// The pentagon in a folder of its own, with the law `mine` beside it.
pub struct Pentagon {
    pub folder: TempDir,
    /// `phalanx`, as those have it who write laws in that language.
    pub phalanx: fn() -> Command,
    /// Starts the program of the law by hand, with these words.
    pub by_hand: fn(&Path, &[&Path]) -> Command,
}

impl Pentagon {
    /// In that folder, with these laws.
    pub fn write(folder: &Path, laws: &str) {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/pentagon.toml");
        let text = std::fs::read_to_string(shipped).unwrap();
        std::fs::write(folder.join("pentagon.toml"), text + laws).unwrap();
    }

    /// A run of it with the laws that are built in.
    pub fn run(&self) -> Phalanx {
        let mut command = (self.phalanx)();
        command.arg("run").arg(self.folder.path().join("pentagon.toml"));
        Phalanx::new(command).set("expect={}")
    }

    /// The same with r3 by the law `mine`.
    pub fn with_r3(&self) -> Phalanx {
        self.run().set("robot.r3.law=mine")
    }

    /// `mine` is the law of the others: so often, the same trajectory, bit by bit.
    #[track_caller]
    pub fn moves_as_built_in(&self, times: usize, set: &str, fault: Option<&str>) {
        let finish = |run: Phalanx| {
            let run = run.lockstep().set(set);
            fault.into_iter().fold(run, |run, fault| run.fault(fault)).finish()
        };
        let built_in = finish(self.run());
        for _ in 0..times {
            let ended = finish(self.with_r3());
            ended.exits_with(0).leaves_nothing();
            ended.claim(ended.hash() == built_in.hash(), format!("as {}", built_in.hash()));
            keeps_its_distance(&ended);
        }
    }

    /// In real time r3 is killed, lives again, and harms nobody.
    #[track_caller]
    pub fn comes_back(&self, set: &str, kill: &str) {
        let ended = self.with_r3().set(set).fault(kill).finish();
        ended.exits_with(0).leaves_nothing();
        keeps_its_distance(&ended);
        let events = ended.file("events.csv");
        ended.claim(events.contains(",ready,r3,incarnation 1"), "r3 came back");
        let alive = ended.summary["alive_at_end"].to_string();
        ended.claim(alive.contains("r3"), format!("r3 lives at the end: {alive}"));
    }

    /// `mine` is a controller with the gain `k_per_s`, and keeps r3 in its place.
    #[track_caller]
    pub fn keeps_its_place(&self) {
        let ended =
            self.with_r3().set("robot.r3.k_per_s=3").lockstep().set("duration_s=12").finish();
        ended.exits_with(0).leaves_nothing();
        keeps_its_distance(&ended);
        let error_m = ended.number("/final_error_m/r3");
        ended.claim(error_m < 0.02, format!("r3 is where it belongs: {error_m} m"));
    }

    /// r3's program does not become ready: the run ends, and says all of `parts`.
    #[track_caller]
    pub fn cannot_start(&self, set: &[&str], parts: &[&str]) {
        let run = self.with_r3().lockstep();
        let ended = set.iter().fold(run, |run, set| run.set(set)).finish();
        ended.exits_with(4).leaves_nothing();
        parts.iter().for_each(|part| says(&ended, part));
    }

    /// Started by hand with these words the program ends with `code`, and says all of `parts` and no more than
    /// `lines_max` lines.
    #[track_caller]
    pub fn says_by_hand(&self, words: &[&Path], code: i32, parts: &[&str], lines_max: usize) {
        let said = (self.by_hand)(self.folder.path(), words).exits_with(code).stderr;
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        assert!(said.lines().count() <= lines_max, "{said}");
    }

    /// A supervisor of another version starts it, whose briefs have more in them.
    #[track_caller]
    pub fn says_that_versions_differ(&self, part: &str, lines_max: usize) {
        let ended = self.with_r3().lockstep().set("duration_s=0.1").finish();
        let brief = ended.file("briefs/r3.toml");
        let version = format!("phalanx = \"{}\"", env!("CARGO_PKG_VERSION"));
        assert!(brief.contains(&version), "{brief}");
        let path = self.folder.path().join("r3.toml");
        std::fs::write(&path, brief.replace(&version, "phalanx = \"99.1.0\"\nnew = true")).unwrap();
        self.says_by_hand(&[&path], 4, &["phalanx 99.1.0 starts this program", part], lines_max);
    }
}

#[track_caller]
pub fn keeps_its_distance(ended: &Ended) {
    let distance_m = ended.number("/min_distance_m");
    ended.claim(distance_m >= 0.3, format!("nobody came nearer than 0.3 m: {distance_m}"));
}

#[track_caller]
pub fn says(ended: &Ended, part: &str) {
    ended.claim(ended.stderr.contains(part), format!("it says {part:?}"));
}
