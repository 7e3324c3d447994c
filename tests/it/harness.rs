//! Runs `phalanx` as a user would, in a run root of its own, and shows what happened when a claim
//! about it fails.

use std::fmt::Write as _;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

/// No run of a test takes this long; far more than any needs, so that only a hang meets it.
const HANG: Duration = Duration::from_secs(120);

/// A run yet to be started.
pub struct Phalanx {
    command: Command,
    draws: bool,
    scratch: TempDir,
    run_root: TempDir,
}

/// A run under way.
pub struct Running {
    child: Option<Child>,
    /// What it has said and somebody has read already.
    said: String,
    shown: String,
    scratch: TempDir,
    run_root: TempDir,
}

/// A run that has ended.
pub struct Ended {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
    pub summary: Value,
    shown: String,
    scratch: TempDir,
    run_root: TempDir,
}

/// `phalanx run scenarios/<name>.toml`.
pub fn run(name: &str) -> Phalanx {
    let mut command = Command::new(env!("CARGO_BIN_EXE_phalanx"));
    command.arg("run").arg(format!("scenarios/{name}.toml"));
    Phalanx::new(command)
}

impl Phalanx {
    /// A command that runs phalanx in the end; `--out` is added to it, and that it draws
    /// nothing.
    pub fn new(mut command: Command) -> Phalanx {
        let scratch = tempfile::tempdir().unwrap();
        let run_root = tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap();
        command
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env("PHALANX_RUN_ROOT", run_root.path())
            .env("NO_COLOR", "1")
            .arg("--out")
            .arg(scratch.path().join("run"));
        Phalanx { command, draws: false, scratch, run_root }
    }

    pub fn lockstep(self) -> Phalanx {
        self.args(["--pace", "lockstep"])
    }

    /// Figures and page are made at the end after all.
    pub fn drawing(self) -> Phalanx {
        Phalanx { draws: true, ..self }
    }

    pub fn set(self, assignment: impl AsRef<str>) -> Phalanx {
        self.args(["--set", assignment.as_ref()])
    }

    pub fn fault(self, spec: &str) -> Phalanx {
        self.args(["--fault", spec])
    }

    pub fn args<'a>(mut self, args: impl IntoIterator<Item = &'a str>) -> Phalanx {
        self.command.args(args);
        self
    }

    /// The run root of another run, to find what that one left.
    pub fn in_run_root_of(mut self, other: &Path) -> Phalanx {
        self.command.env("PHALANX_RUN_ROOT", other);
        self
    }

    pub fn start(mut self) -> Running {
        if !self.draws {
            self.command.arg("--no-report");
        }
        self.command.stdout(Stdio::piped()).stderr(Stdio::piped()).stdin(Stdio::null());
        let shown = format!("{:?}", self.command);
        let child = Some(self.command.spawn().unwrap());
        Running {
            child,
            said: String::new(),
            shown,
            scratch: self.scratch,
            run_root: self.run_root,
        }
    }

    /// Runs to the end.
    pub fn finish(self) -> Ended {
        self.start().finish()
    }
}

impl Running {
    pub fn pid(&self) -> u32 {
        self.child.as_ref().expect("runs").id()
    }

    pub fn run_root(&self) -> &Path {
        self.run_root.path()
    }

    pub fn run_dir(&self) -> PathBuf {
        self.scratch.path().join("run")
    }

    /// The processes it started that are alive, by the name they show in `ps`, with their robot.
    pub fn children(&self) -> Vec<(u32, String)> {
        processes_of(&self.run_dir())
    }

    /// Process ids of its living agents, from the moment they are told to be one. Empty until the
    /// plant, which is started first, is known. Cheap: made to be asked often.
    pub fn agents(&self) -> Vec<u32> {
        let (pid, briefs) = (self.pid(), self.run_dir().join("briefs"));
        let listed = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
        let listed = listed.unwrap_or_default();
        let children = listed.split_whitespace().filter_map(|pid| pid.parse().ok());
        // The dead that are not yet reaped have no words.
        let told = children.filter_map(|pid| Some((pid, briefed(&words_of(pid), &briefs)?)));
        let (plant, agents): (Vec<_>, Vec<_>) = told.partition(|(_, name)| name == "plant");
        if plant.is_empty() { Vec::new() } else { agents.into_iter().map(|(pid, _)| pid).collect() }
    }

    /// What its run roots are called: as long as it runs, there is one.
    pub fn roots(&self) -> Vec<PathBuf> {
        let bases = std::fs::read_dir(self.run_root()).into_iter().flatten().flatten();
        let roots = bases.flat_map(|base| std::fs::read_dir(base.path()).into_iter().flatten());
        roots.flatten().map(|entry| entry.path()).collect()
    }

    /// The lines of `events.csv` so far.
    pub fn events(&self) -> String {
        std::fs::read_to_string(self.run_dir().join("events.csv")).unwrap_or_default()
    }

    /// Waits until `condition` gives something; fails if the run ends or hangs before.
    pub fn wait_for<T>(&mut self, what: &str, condition: impl Fn(&Running) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            if let Some(found) = condition(self) {
                return found;
            }
            let ended = self.child.as_mut().expect("runs").try_wait().unwrap();
            assert!(ended.is_none(), "{} ended before {what}: {ended:?}", self.shown);
            assert!(began.elapsed() < HANG, "{}: no {what} within {HANG:?}", self.shown);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Process id of a robot, or of the plant, once it lives.
    pub fn pid_of(&mut self, name: &str) -> u32 {
        self.wait_for(name, |run| {
            run.children().into_iter().find(|(_, other)| other == name).map(|(pid, _)| pid)
        })
    }

    /// Waits until an event of this kind was written.
    pub fn wait_for_event(&mut self, kind: &str) {
        self.wait_for(kind, |run| {
            let events = std::fs::read_to_string(run.run_dir().join("events.csv")).ok()?;
            events.lines().any(|line| line.split(',').nth(1) == Some(kind)).then_some(())
        });
    }

    /// Waits for the rest of a line on stderr that begins so.
    pub fn line(&mut self, begins: &str) -> String {
        let stderr = self.child.as_mut().expect("runs").stderr.as_mut().expect("piped");
        let mut line = Vec::new();
        let mut byte = [0];
        // Byte by byte: what follows the line is not ours to take.
        while stderr.read(&mut byte).unwrap() > 0 {
            line.push(byte[0]);
            if line.ends_with(b"\n") {
                let whole = String::from_utf8_lossy(&line).into_owned();
                line.clear();
                self.said += &whole;
                if let Some(rest) = whole.strip_prefix(begins) {
                    return rest.trim_end().to_owned();
                }
            }
        }
        panic!("{} ended without saying {begins:?}, but: {}", self.shown, self.said);
    }

    pub fn signal(&self, signal: Signal) {
        signal_pid(self.pid(), signal);
    }

    pub fn finish(mut self) -> Ended {
        let began = Instant::now();
        while self.child.as_mut().expect("runs").try_wait().unwrap().is_none() {
            if began.elapsed() > HANG {
                self.signal(Signal::KILL);
                panic!("{} hangs", self.shown);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let Output { status, stdout, stderr } =
            self.child.take().expect("runs").wait_with_output().unwrap();
        let summary = std::fs::read(self.run_dir().join("summary.json"))
            .map(|bytes| serde_json::from_slice(&bytes).expect("summary.json is JSON"))
            .unwrap_or(Value::Null);
        let stdout = String::from_utf8_lossy(&stdout).into_owned();
        let stderr = std::mem::take(&mut self.said) + &String::from_utf8_lossy(&stderr);
        let shown = format!(
            "command: {}\ndirectory: {}\nstatus: {status}\nstdout:\n{stdout}\nstderr:\n{stderr}",
            self.shown,
            self.run_dir().display(),
        );
        let code = status.code();
        let scratch = std::mem::replace(&mut self.scratch, tempfile::tempdir().unwrap());
        let run_root = std::mem::replace(&mut self.run_root, tempfile::tempdir().unwrap());
        Ended { code, stdout, stderr, summary, shown, scratch, run_root }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
            let run_dir = self.run_dir();
            let began = Instant::now();
            while !processes_of(&run_dir).is_empty() && began.elapsed() < HANG {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        sweep(self.run_root.path());
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        sweep(self.run_root.path());
    }
}

/// Removes what a run that ended badly left in its run root, so that a test leaves nothing even when
/// it fails.
fn sweep(run_root: &Path) {
    for base in std::fs::read_dir(run_root).into_iter().flatten().flatten() {
        protocol::run_root::sweep(&base.path());
    }
}

impl Ended {
    pub fn run_dir(&self) -> PathBuf {
        self.scratch.path().join("run")
    }

    pub fn file(&self, name: &str) -> String {
        std::fs::read_to_string(self.run_dir().join(name)).unwrap_or_default()
    }

    /// Fails with everything there is to know unless `holds`.
    #[track_caller]
    pub fn claim(&self, holds: bool, what: impl AsRef<str>) -> &Ended {
        if !holds {
            let mut shown = self.shown.clone();
            let events = self.file("events.csv");
            let tail: Vec<&str> = events.lines().rev().take(12).collect();
            let _ = write!(shown, "last events:");
            tail.iter().rev().for_each(|line| shown += &format!("\n  {line}"));
            panic!("not so: {}\n{shown}\nsummary: {:#}", what.as_ref(), self.summary);
        }
        self
    }

    #[track_caller]
    pub fn exits_with(&self, code: i32) -> &Ended {
        self.claim(self.code == Some(code), format!("exit code {code}"))
    }

    /// A number of the summary by JSON pointer; NaN if it is none.
    pub fn number(&self, pointer: &str) -> f64 {
        self.summary.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
    }

    pub fn hash(&self) -> &str {
        self.summary["trajectory_hash"].as_str().unwrap_or("none")
    }

    /// No process, no file in the run root, which has all shared memory.
    #[track_caller]
    pub fn leaves_nothing(&self) -> &Ended {
        let processes = processes_of(&self.run_dir());
        self.claim(processes.is_empty(), format!("no process is left, found {processes:?}"));
        let files = files_below(self.run_root.path());
        self.claim(files.is_empty(), format!("the run root is empty, found {files:?}"))
    }
}

pub fn signal_pid(pid: u32, signal: Signal) {
    // Gone already is as good as signalled.
    let _ = kill_process(Pid::from_raw(pid as i32).expect("a process id"), signal);
}

/// `phalanx` under a limit of the shell's `ulimit`.
pub fn limited(limit: &str) -> Command {
    limited_by(&format!("ulimit {limit}"))
}

/// `phalanx` after these words of a shell.
pub fn limited_by(words: &str) -> Command {
    let script = format!("{words} && exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_phalanx")]);
    command
}

/// Living agents and plants whose brief lies in `run_dir`: process id and robot (or `plant`).
pub fn processes_of(run_dir: &Path) -> Vec<(u32, String)> {
    let briefs = run_dir.join("briefs");
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<u32>() else { continue };
        if let Some(name) = briefed(&words_of(pid), &briefs) {
            found.push((pid, name));
        }
    }
    found.sort();
    found
}

/// The command line of a process; none once it is dead.
fn words_of(pid: u32) -> Vec<String> {
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    line.split(|b| *b == 0).map(|word| String::from_utf8_lossy(word).into_owned()).collect()
}

/// Whom a command line's brief in `briefs` is for.
fn briefed(words: &[String], briefs: &Path) -> Option<String> {
    let brief = words.iter().map(Path::new).find(|word| {
        word.parent() == Some(briefs) && word.extension().is_some_and(|end| end == "toml")
    })?;
    Some(brief.file_stem()?.to_string_lossy().into_owned())
}

/// Everything below a directory.
pub fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        found.push(entry.path());
        if entry.path().is_dir() {
            found.extend(files_below(&entry.path()));
        }
    }
    found
}
