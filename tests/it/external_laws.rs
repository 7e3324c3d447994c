//! Checks of control laws in programs of the scenario, for any language. The pentagon is used, where r3 has the law
//! `mine`. The files of the languages build the program.

use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

use crate::harness::{ExitsWith as _, FinishedRun, Phalanx};

/// Copy of the pentagon in a temporary folder, together with the law `mine`.
pub struct Pentagon {
    pub folder: TempDir,
    /// `phalanx` command as installed for authors of laws in the language.
    pub phalanx: fn() -> Command,
    /// Starts the program of the law directly, with these arguments.
    pub by_hand: fn(&Path, &[&Path]) -> Command,
}

impl Pentagon {
    /// Creates the copy in a folder that has the program, with these laws.
    pub fn write(folder: &Path, laws: &str) {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/pentagon.toml");
        let text = std::fs::read_to_string(shipped).unwrap();
        std::fs::write(folder.join("pentagon.toml"), text + laws).unwrap();
    }

    /// Prepares a run with the built-in laws.
    pub fn run(&self) -> Phalanx {
        let mut command = (self.phalanx)();
        command.arg("run").arg(self.folder.path().join("pentagon.toml"));
        Phalanx::new(command).set("expect={}")
    }

    /// Prepares a run in which r3 has the law `mine`.
    pub fn with_r3(&self) -> Phalanx {
        self.run().set("robot.r3.law=mine")
    }

    /// Checks, in this number of runs, that the trajectories with `mine` equal those of the built-in law, bit for bit.
    #[track_caller]
    pub fn assert_moves_as_built_in(&self, times: usize, set: &str, fault: Option<&str>) {
        let finish = |run: Phalanx| {
            let run = run.lockstep().set(set);
            fault.into_iter().fold(run, |run, fault| run.fault(fault)).finish()
        };
        let built_in = finish(self.run());
        for _ in 0..times {
            let ended = finish(self.with_r3());
            ended.exits_with(0).assert_leaves_nothing();
            ended.assert_holds(ended.hash() == built_in.hash(), format!("as {}", built_in.hash()));
            assert_keeps_distance(&ended);
        }
    }

    /// Checks that r3 is killed and restarted in real time without a violation of d.
    #[track_caller]
    pub fn assert_comes_back(&self, set: &str, kill: &str) {
        let ended = self.with_r3().set(set).fault(kill).finish();
        ended.exits_with(0).assert_leaves_nothing();
        assert_keeps_distance(&ended);
        let events = ended.file("events.csv");
        ended.assert_holds(events.contains(",ready,r3,incarnation 1"), "r3 came back");
        let alive = ended.summary["alive_at_end"].to_string();
        ended.assert_holds(alive.contains("r3"), format!("r3 lives at the end: {alive}"));
    }

    /// Checks that the controller `mine` with the gain `k_per_s` holds r3 at its slot.
    #[track_caller]
    pub fn assert_keeps_its_place(&self) {
        let ended =
            self.with_r3().set("robot.r3.k_per_s=3").lockstep().set("duration_s=12").finish();
        ended.exits_with(0).assert_leaves_nothing();
        assert_keeps_distance(&ended);
        let error_m = ended.number("/final_error_m/r3");
        ended.assert_holds(error_m < 0.02, format!("r3 is where it belongs: {error_m} m"));
    }

    /// Checks that r3's program does not become ready, that the run ends, and that its output has all of `parts`.
    #[track_caller]
    pub fn assert_cannot_start(&self, set: &[&str], parts: &[&str]) {
        let run = self.with_r3().lockstep();
        let ended = set.iter().fold(run, |run, set| run.set(set)).finish();
        ended.exits_with(4).assert_leaves_nothing();
        parts.iter().for_each(|part| stderr_contains(&ended, part));
    }

    /// Checks that the program, started directly with these arguments, exits with `code` and prints all of `parts` in
    /// at most `lines_max` lines.
    #[track_caller]
    pub fn assert_output_by_hand(
        &self,
        arguments: &[&Path],
        code: i32,
        parts: &[&str],
        lines_max: usize,
    ) {
        let output = (self.by_hand)(self.folder.path(), arguments).exits_with(code).stderr;
        assert!(parts.iter().all(|part| output.contains(part)), "{output}");
        assert!(output.lines().count() <= lines_max, "{output}");
    }

    /// Checks the program with a brief of another version of the supervisor, which has additional keys.
    #[track_caller]
    pub fn assert_version_mismatch(&self, part: &str, lines_max: usize) {
        let ended = self.with_r3().lockstep().set("duration_s=0.1").finish();
        let brief = ended.file("briefs/r3.toml");
        let version = format!("phalanx = \"{}\"", env!("CARGO_PKG_VERSION"));
        assert!(brief.contains(&version), "{brief}");
        let path = self.folder.path().join("r3.toml");
        std::fs::write(&path, brief.replace(&version, "phalanx = \"99.1.0\"\nnew = true")).unwrap();
        self.assert_output_by_hand(
            &[&path],
            4,
            &["phalanx 99.1.0 starts this program", part],
            lines_max,
        );
    }
}

#[track_caller]
pub fn assert_keeps_distance(ended: &FinishedRun) {
    let distance_m = ended.number("/min_distance_m");
    ended.assert_holds(
        distance_m >= 0.3,
        format!("no two robots came closer than 0.3 m: {distance_m}"),
    );
}

#[track_caller]
pub fn stderr_contains(ended: &FinishedRun, part: &str) {
    ended.assert_holds(ended.stderr.contains(part), format!("it says {part:?}"));
}
