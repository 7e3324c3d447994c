//! Test harness: runs `phalanx` like a user, with a separate run root, and prints the output, the last events and
//! the summary if an assertion fails.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

/// Root directory of this repository.
pub const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Path of the `phalanx` executable.
pub const PHALANX: &str = env!("CARGO_BIN_EXE_phalanx");

/// Deadline of every wait in a test. Far longer than any run needs, so that only a hang reaches it.
pub const WAIT_TIMEOUT: Duration = Duration::from_secs(120);

/// Returns a `phalanx` command with these arguments, in the root of this repository, without colors.
pub fn phalanx<W: AsRef<OsStr>>(arguments: impl IntoIterator<Item = W>) -> Command {
    let mut command = Command::new(PHALANX);
    command.args(arguments);
    set_plain_environment(&mut command);
    command
}

fn set_plain_environment(command: &mut Command) {
    command.current_dir(ROOT).env("NO_COLOR", "1").env("COLUMNS", "100").stdin(Stdio::null());
}

/// Output of a command that has ended.
pub struct CommandOutput {
    pub stdout: String,
    pub stderr: String,
}

impl CommandOutput {
    /// Returns stdout followed by stderr.
    pub fn stdout_and_stderr(&self) -> String {
        format!("{}{}", self.stdout, self.stderr)
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout)
            .unwrap_or_else(|e| panic!("{e}: {}", self.stdout_and_stderr()))
    }
}

/// A command that a test runs to its end.
pub trait ExitsWith {
    /// Runs the command and returns its output. Panics with the command and its output if the exit code is not `code`.
    #[track_caller]
    fn exits_with(&mut self, code: i32) -> CommandOutput;
}

impl ExitsWith for Command {
    #[track_caller]
    fn exits_with(&mut self, code: i32) -> CommandOutput {
        let Output { status, stdout, stderr } = self.output().unwrap();
        let [stdout, stderr] = [stdout, stderr].map(|bytes| text(&bytes));
        assert_eq!(status.code(), Some(code), "{self:?}\nstdout:\n{stdout}\nstderr:\n{stderr}");
        CommandOutput { stdout, stderr }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Returns a `phalanx` command that runs under a limit set by the shell's `ulimit`.
pub fn command_with_ulimit(limit: &str) -> Command {
    limited_by(&format!("ulimit {limit}"))
}

/// Returns a `phalanx` command that a shell executes after it has run `prefix`.
pub fn limited_by(prefix: &str) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{prefix} && exec \"$0\" \"$@\""), PHALANX]);
    command
}

/// Temporary folder for shared memory. Stale files of runs in it are removed when it is dropped.
pub struct RunRoot(TempDir);

impl RunRoot {
    pub fn new() -> RunRoot {
        RunRoot(tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Returns the paths of the run roots in the folder. There is one for each run in progress.
    pub fn roots(&self) -> Vec<PathBuf> {
        let entries = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten();
        let roots = entries(self.path()).flat_map(|base| entries(&base.path()));
        roots.map(|entry| entry.path()).collect()
    }

    /// Removes the files that exited processes have left.
    pub fn sweep(&self) {
        for base in std::fs::read_dir(self.path()).into_iter().flatten().flatten() {
            protocol::run_root::remove_dead_roots(&base.path());
        }
    }
}

impl Drop for RunRoot {
    fn drop(&mut self) {
        self.sweep();
    }
}

/// Directories that a run writes to.
struct RunDirs {
    scratch: TempDir,
    run_root: RunRoot,
}

impl RunDirs {
    fn run_dir(&self) -> PathBuf {
        self.scratch.path().join("run")
    }
}

/// Builder of a run that has not started yet.
pub struct Phalanx {
    command: Command,
    draws: bool,
    run_dirs: RunDirs,
}

/// Prepares `phalanx run scenarios/<name>.toml`.
pub fn run(name: &str) -> Phalanx {
    run_file(Path::new(&format!("scenarios/{name}.toml")))
}

/// Prepares `phalanx run` of the scenario file at this path.
pub fn run_file(scenario: &Path) -> Phalanx {
    Phalanx::new(phalanx([OsStr::new("run"), scenario.as_os_str()]))
}

impl Phalanx {
    /// Prepares a command that runs phalanx. `--out` is added to it, and `--no-report` at the start unless
    /// [`Phalanx::drawing`] is called.
    pub fn new(mut command: Command) -> Phalanx {
        let run_dirs = RunDirs { scratch: tempfile::tempdir().unwrap(), run_root: RunRoot::new() };
        set_plain_environment(&mut command);
        command
            .env("PHALANX_RUN_ROOT", run_dirs.run_root.path())
            .arg("--out")
            .arg(run_dirs.run_dir());
        Phalanx { command, draws: false, run_dirs }
    }

    pub fn lockstep(self) -> Phalanx {
        self.args(["--pace", "lockstep"])
    }

    /// Enables the report: figures and page are drawn at the end of the run.
    pub fn drawing(self) -> Phalanx {
        Phalanx { draws: true, ..self }
    }

    pub fn set(self, assignment: impl AsRef<str>) -> Phalanx {
        self.args(["--set", assignment.as_ref()])
    }

    pub fn sets<S: AsRef<str>>(self, assignments: impl IntoIterator<Item = S>) -> Phalanx {
        assignments.into_iter().fold(self, |run, assignment| run.set(assignment))
    }

    pub fn fault(self, spec: &str) -> Phalanx {
        self.args(["--fault", spec])
    }

    pub fn faults<S: AsRef<str>>(self, specs: impl IntoIterator<Item = S>) -> Phalanx {
        specs.into_iter().fold(self, |run, spec| run.fault(spec.as_ref()))
    }

    pub fn args<'a>(mut self, args: impl IntoIterator<Item = &'a str>) -> Phalanx {
        self.command.args(args);
        self
    }

    pub fn env(mut self, name: &str, value: impl AsRef<OsStr>) -> Phalanx {
        self.command.env(name, value);
        self
    }

    /// Uses the run root of another run, so that this run finds the files that the other one has left.
    pub fn in_run_root_of(self, other: &Path) -> Phalanx {
        self.env("PHALANX_RUN_ROOT", other)
    }

    pub fn start(mut self) -> RunInProgress {
        if !self.draws {
            self.command.arg("--no-report");
        }
        self.command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let command = format!("{:?}", self.command);
        let supervisor = self.command.spawn().unwrap();
        let run_dir = self.run_dirs.run_dir();
        let supervisor = Supervisor { child: Some(supervisor), run_dir };
        RunInProgress { supervisor, read_stderr: String::new(), command, run_dirs: self.run_dirs }
    }

    /// Starts the run and waits until it has ended.
    pub fn finish(self) -> FinishedRun {
        self.start().finish()
    }
}

/// Supervisor process of a run. Dropping it kills the process and waits until its children have exited.
struct Supervisor {
    child: Option<Child>,
    run_dir: PathBuf,
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        let _ = child.kill();
        let _ = child.wait();
        let start = Instant::now();
        while !processes_of(&self.run_dir).is_empty() && start.elapsed() < WAIT_TIMEOUT {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// A run in progress.
pub struct RunInProgress {
    supervisor: Supervisor,
    /// Part of the run's stderr that the test has already read.
    read_stderr: String,
    command: String,
    run_dirs: RunDirs,
}

impl RunInProgress {
    fn child(&mut self) -> &mut Child {
        self.supervisor.child.as_mut().expect("it runs")
    }

    pub fn pid(&self) -> u32 {
        self.supervisor.child.as_ref().expect("it runs").id()
    }

    pub fn run_root(&self) -> &Path {
        self.run_dirs.run_root.path()
    }

    pub fn roots(&self) -> Vec<PathBuf> {
        self.run_dirs.run_root.roots()
    }

    pub fn run_dir(&self) -> PathBuf {
        self.run_dirs.run_dir()
    }

    /// Returns the running agents and plant: process id, and robot name or `plant`.
    pub fn children(&self) -> Vec<(u32, String)> {
        processes_of(&self.run_dir())
    }

    /// Returns the process ids of the running agents. Empty until the plant, which is started first, is running.
    pub fn agents(&self) -> Vec<u32> {
        let (plant, agents): (Vec<_>, Vec<_>) =
            self.children().into_iter().partition(|(_, name)| name == "plant");
        if plant.is_empty() { Vec::new() } else { agents.into_iter().map(|(pid, _)| pid).collect() }
    }

    /// Returns the lines that `events.csv` has at present.
    pub fn events(&self) -> String {
        std::fs::read_to_string(self.run_dir().join("events.csv")).unwrap_or_default()
    }

    /// Waits until `condition` returns `Some`, and returns its value. Panics if the run ends first, or after
    /// [`WAIT_TIMEOUT`].
    pub fn wait_for<T>(
        &mut self,
        what: &str,
        condition: impl Fn(&RunInProgress) -> Option<T>,
    ) -> T {
        let start = Instant::now();
        loop {
            if let Some(found) = condition(self) {
                return found;
            }
            let ended = self.child().try_wait().unwrap();
            assert!(ended.is_none(), "{} ended before {what}: {ended:?}", self.command);
            assert!(
                start.elapsed() < WAIT_TIMEOUT,
                "{}: no {what} within {WAIT_TIMEOUT:?}",
                self.command
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until the named robot (or `plant`) runs, and returns its process id.
    pub fn pid_of(&mut self, name: &str) -> u32 {
        self.wait_for(name, |run| {
            run.children().into_iter().find(|(_, other)| other == name).map(|(pid, _)| pid)
        })
    }

    /// Waits until `events.csv` has an event of this kind.
    pub fn wait_for_event(&mut self, kind: &str) {
        self.wait_for(kind, |run| {
            run.events().lines().any(|line| line.split(',').nth(1) == Some(kind)).then_some(())
        });
    }

    /// Waits for a line on stderr with this prefix, and returns the rest of it. Panics if stderr ends first.
    pub fn wait_for_line(&mut self, begins: &str) -> String {
        let mut line = Vec::new();
        let mut byte = [0];
        // Byte by byte: the text after the line must stay in the pipe.
        while self.child().stderr.as_mut().expect("piped").read(&mut byte).unwrap() > 0 {
            line.push(byte[0]);
            if byte == *b"\n" {
                let full_line = text(&std::mem::take(&mut line));
                self.read_stderr += &full_line;
                if let Some(rest) = full_line.strip_prefix(begins) {
                    return rest.trim_end().to_owned();
                }
            }
        }
        panic!("{} ended without a line {begins:?}, but with: {}", self.command, self.read_stderr);
    }

    pub fn signal(&self, signal: Signal) {
        signal_pid(self.pid(), signal);
    }

    /// Waits until the supervisor has exited. Panics after [`WAIT_TIMEOUT`].
    pub fn wait_until_ended(&mut self) {
        let start = Instant::now();
        while self.child().try_wait().unwrap().is_none() {
            assert!(start.elapsed() < WAIT_TIMEOUT, "{} hangs", self.command);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub fn finish(mut self) -> FinishedRun {
        self.wait_until_ended();
        let child = self.supervisor.child.take().expect("it ran");
        let Output { status, stdout, stderr } = child.wait_with_output().unwrap();
        let run_dir = self.run_dir();
        let summary = std::fs::read(run_dir.join("summary.json"));
        let summary = summary
            .map_or(Value::Null, |bytes| serde_json::from_slice(&bytes).expect("it is JSON"));
        let (stdout, stderr) = (text(&stdout), self.read_stderr + &text(&stderr));
        let description = format!(
            "command: {}\ndirectory: {}\nstatus: {status}\nstdout:\n{stdout}\nstderr:\n{stderr}",
            self.command,
            run_dir.display(),
        );
        FinishedRun {
            code: status.code(),
            stdout,
            stderr,
            summary,
            description,
            run_dirs: self.run_dirs,
        }
    }
}

/// A run that has ended.
pub struct FinishedRun {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
    pub summary: Value,
    description: String,
    run_dirs: RunDirs,
}

impl FinishedRun {
    pub fn run_dir(&self) -> PathBuf {
        self.run_dirs.run_dir()
    }

    pub fn file(&self, name: &str) -> String {
        std::fs::read_to_string(self.run_dir().join(name)).unwrap_or_default()
    }

    /// Panics with the command, output, last events and summary unless `holds`.
    #[track_caller]
    pub fn assert_holds(&self, holds: bool, what: impl AsRef<str>) -> &FinishedRun {
        if !holds {
            let mut description = self.description.clone();
            let events = self.file("events.csv");
            let tail: Vec<&str> = events.lines().rev().take(12).collect();
            let _ = write!(description, "last events:");
            tail.iter().rev().for_each(|line| description += &format!("\n  {line}"));
            panic!("not so: {}\n{description}\nsummary: {:#}", what.as_ref(), self.summary);
        }
        self
    }

    #[track_caller]
    pub fn exits_with(&self, code: i32) -> &FinishedRun {
        self.assert_holds(self.code == Some(code), format!("exit code {code}"))
    }

    /// Checks that no two robots came closer than d, which is at least 0.2 m in every shipped scenario.
    #[track_caller]
    pub fn assert_keeps_d(&self) -> &FinishedRun {
        let counted = self.number("/violations");
        self.assert_holds(
            counted == 0.0 && self.number("/min_distance_m") >= 0.2,
            "no two robots came closer than d",
        )
    }

    /// Returns the number at a JSON pointer of the summary. NaN if the value is missing or not a number.
    pub fn number(&self, pointer: &str) -> f64 {
        self.summary.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
    }

    pub fn hash(&self) -> &str {
        self.summary["trajectory_hash"].as_str().unwrap_or("none")
    }

    /// Checks that no process of the run is left, and no file in its run root, which holds all shared memory.
    #[track_caller]
    pub fn assert_leaves_nothing(&self) -> &FinishedRun {
        let processes = processes_of(&self.run_dir());
        self.assert_holds(processes.is_empty(), format!("no process is left, found {processes:?}"));
        let files = files_below(self.run_dirs.run_root.path());
        self.assert_holds(files.is_empty(), format!("the run root is empty, found {files:?}"))
    }
}

pub fn signal_pid(pid: u32, signal: Signal) {
    // An error means that the process has already exited.
    let _ = kill_process(Pid::from_raw(pid as i32).expect("a process id"), signal);
}

/// Returns the running agents and plants whose brief is in `run_dir`: process id, and robot name or `plant`.
pub fn processes_of(run_dir: &Path) -> Vec<(u32, String)> {
    let briefs = run_dir.join("briefs");
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<u32>() else { continue };
        // Exited processes that are not yet reaped have no arguments.
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let arguments = line.split(|byte| *byte == 0).map(|argument| PathBuf::from(text(argument)));
        let mut arguments = arguments.filter(|argument| argument.parent() == Some(&briefs));
        let brief =
            arguments.find(|argument| argument.extension().is_some_and(|end| end == "toml"));
        let robot = brief.as_ref().and_then(|brief| brief.file_stem());
        found.extend(robot.map(|robot| (pid, robot.to_string_lossy().into_owned())));
    }
    found.sort();
    found
}

/// Waits until no process of the run in `run_dir` is left: children of a killed supervisor exit by themselves.
/// Panics after [`WAIT_TIMEOUT`].
#[track_caller]
pub fn wait_until_gone(run_dir: &Path) {
    let start = Instant::now();
    while !processes_of(run_dir).is_empty() {
        assert!(start.elapsed() < WAIT_TIMEOUT, "left: {:?}", processes_of(run_dir));
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Writes an executable shell script with these lines.
pub fn write_script(path: &Path, lines: &str) {
    std::fs::write(path, format!("#!/bin/sh\n{lines}")).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

/// Checks that `text_of` returns the text of `*.stderr` for each `*.toml` in a folder of this repository. Panics if the
/// folder has fewer than `minimum_count` such files, or a `*.stderr` without one. `PHALANX_BLESS=1` writes the texts
/// instead.
pub fn assert_texts_beside(folder: &str, minimum_count: usize, text_of: impl Fn(&Path) -> String) {
    let entries = std::fs::read_dir(Path::new(ROOT).join(folder)).unwrap();
    let names = entries.map(|entry| Path::new(folder).join(entry.unwrap().file_name()));
    let (mut files, stderr_files): (Vec<PathBuf>, Vec<PathBuf>) =
        names.partition(|path| path.extension() == Some(OsStr::new("toml")));
    files.sort();
    assert!(files.len() >= minimum_count, "only {} files in {folder}", files.len());
    for path in stderr_files {
        assert!(files.contains(&path.with_extension("toml")), "{} is left over", path.display());
    }
    let mut wrong = Vec::new();
    for path in files {
        let (found, expected_path) =
            (text_of(&path), Path::new(ROOT).join(path.with_extension("stderr")));
        if std::env::var_os("PHALANX_BLESS").is_some() {
            std::fs::write(&expected_path, &found).unwrap();
        }
        let expected = std::fs::read_to_string(&expected_path).unwrap_or_default();
        if found != expected {
            wrong.push(format!("{}\nexpected:\n{expected}\nfound:\n{found}", path.display()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Returns the paths of all files and folders below a directory.
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

/// Returns the factor for the number of runs of randomized tests: the value of `PHALANX_TIMES`, by default 1.
pub fn repetition_factor() -> usize {
    std::env::var("PHALANX_TIMES").map_or(1, |times| times.parse().expect("a whole number"))
}

/// Returns the results of `work` for all items, in their order. Computes them with one thread per core.
pub fn map_in_parallel<I: Sync, T: Send>(items: &[I], work: impl Fn(&I) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<T>>> = items.iter().map(|_| Mutex::new(None)).collect();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(index) else { break };
                    *results[index].lock().unwrap() = Some(work(item));
                }
            });
        }
    });
    results.into_iter().map(|one| one.into_inner().unwrap().expect("each was taken")).collect()
}

/// Returns time (s), kind, robot, and detail without quotes, of a line of `events.csv`.
pub fn event_cells(line: &str) -> Option<(f64, &str, &str, &str)> {
    let mut cells = line.splitn(4, ',');
    let (t_s, kind, robot, rest) = (cells.next()?, cells.next()?, cells.next()?, cells.next()?);
    let detail = match rest.strip_prefix('"') {
        Some(quoted) => quoted.split_once("\",")?.0,
        None => rest.split(',').next()?,
    };
    Some((t_s.parse().ok()?, kind, robot, detail))
}
