//! Terminal output: results on stdout; errors, diagnostics, the log and the progress bar on stderr.
//!
//! No other module of the command line writes to either stream. Text of files and of other processes cannot
//! control the terminal, because control characters are escaped.

use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use protocol::process::{Stderr, exit, log_level, never_block_on_stderr, unknown_log_level};
use protocol::terminal_escape;

use experiment::scenario::diagnostic::Diagnostic;

const NS_PER_MS: u64 = 1_000_000;

/// Output format of a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum OutputFormat {
    /// Text, at most one screen.
    Text,
    /// JSON; for `run`, the contents of summary.json.
    Json,
}

/// Logs to stderr, at level `warn` unless `PHALANX_LOG` sets another.
pub(super) fn log_to_stderr() {
    // Fails only in a program that has its own logger, which then stays in use.
    let _ = tracing_subscriber::fmt()
        .with_writer(|| ProgressBarWriter)
        .with_ansi(uses_color())
        .with_target(false)
        .without_time()
        .with_max_level(log_level(tracing::Level::WARN))
        .try_init();
    if let Some(unknown) = unknown_log_level() {
        let expected = "must be error, warn, info, debug or trace; using warn";
        print_info(&format!("warning: PHALANX_LOG is {unknown:?}; {expected}"));
    }
}

/// Prints a result and returns the exit code. A closed pipe is not an error, because the reader closed it.
pub(super) fn print_result(output: OutputFormat, text: &str) -> u8 {
    let text = match output {
        OutputFormat::Text => terminal_escape::escape_lines(text),
        OutputFormat::Json => terminal_escape::escape_json(text),
    };
    exit_code_of_print(io::stdout().write_all(text.as_bytes()))
}

/// Returns the exit code of a program that has written its result to stdout.
pub(crate) fn exit_code_of_print(result: io::Result<()>) -> u8 {
    match result.and_then(|()| io::stdout().flush()) {
        Ok(()) => exit::OK,
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => exit::OK,
        Err(error) => print_failure(&format_args!("cannot write to stdout: {error}")),
    }
}

/// Prints a result as text and returns the exit code.
pub(crate) fn print(text: &str) -> u8 {
    print_result(OutputFormat::Text, text)
}

/// Prints an error as one line and returns the exit code of an infrastructure failure.
pub(super) fn print_failure(error: &dyn Display) -> u8 {
    let _ = writeln!(Stderr, "error: {}", terminal_escape::escape_lines(&error.to_string()));
    exit::INFRASTRUCTURE_FAILURE
}

/// Prints a diagnostic: an error in a file, or a warning.
pub(super) fn print_diagnostic(diagnostic: &Diagnostic) {
    let _ = writeln!(Stderr, "{}", diagnostic.render(uses_color()));
}

/// Prints an error of the command line, or of a file that it names, and returns the exit code.
pub(super) fn print_misuse(error: &dyn Display) -> u8 {
    print_failure(error);
    exit::USAGE_ERROR
}

/// Prints why a file is not a valid scenario, campaign or fleet, and returns the exit code.
pub(super) fn print_invalid_file(diagnostic: &Diagnostic) -> u8 {
    print_diagnostic(diagnostic);
    exit::BAD_SCENARIO
}

/// Prints a line of information to stderr.
pub(super) fn print_info(line: &str) {
    let _ = writeln!(Stderr, "{}", terminal_escape::escape_lines(line));
}

/// Progress bar of the current run.
static PROGRESS_BAR: OnceLock<ProgressBar> = OnceLock::new();

/// Returns the progress bar of a run of `duration_ns`. A process has one run, and thus one bar.
pub(super) fn run_progress_bar(duration_ns: u64) -> &'static ProgressBar {
    PROGRESS_BAR.get_or_init(|| new_progress_bar(duration_ns))
}

fn new_progress_bar(duration_ns: u64) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(duration_ns / NS_PER_MS);
    // Narrower than the screen, because the echo of Ctrl-C would break the line.
    let style = ProgressStyle::with_template("{bar:50} {msg}").expect("a valid template");
    bar.set_style(style);
    bar
}

/// Moves the bar to `t_ns` since the start of the run.
pub(super) fn show_progress(bar: &ProgressBar, t_ns: u64) {
    // The bar writes to stderr itself, which could block.
    if bar.is_hidden() || !Stderr.is_ready() {
        return;
    }
    bar.set_position(t_ns / NS_PER_MS);
    let to_seconds = |ms: u64| ms as f64 / 1e3;
    let total_s = bar.length().map_or(0.0, to_seconds);
    bar.set_message(format!("{:.1} of {total_s} s", to_seconds(t_ns / NS_PER_MS)));
}

/// Removes the bar of a finished run.
pub(super) fn end_progress(bar: &ProgressBar) {
    if Stderr.is_ready() {
        bar.finish_and_clear();
    }
}

/// Returns the progress bar of `runs` runs; `usize::MAX` means an unknown number.
pub(super) fn runs_progress_bar(runs: usize) -> &'static ProgressBar {
    never_block_on_stderr();
    PROGRESS_BAR.get_or_init(|| {
        if !io::stderr().is_terminal() {
            return ProgressBar::hidden();
        }
        let (bar, style) = match runs {
            usize::MAX => (ProgressBar::no_length(), "{pos} runs in {elapsed}{msg}"),
            _ => (ProgressBar::new(runs as u64), "{bar:40} {pos} of {len} runs, {eta} left{msg}"),
        };
        bar.set_style(ProgressStyle::with_template(style).expect("a valid template"));
        bar.enable_steady_tick(Duration::from_secs(1));
        bar
    })
}

/// Moves the bar to `finished_runs`. If stderr is not a terminal, prints a line instead, when one is due. `suffix` is
/// appended.
pub(super) fn show_finished_runs(
    bar: &ProgressBar,
    lines: &mut ProgressLines,
    finished_runs: usize,
    suffix: String,
) {
    bar.set_position(finished_runs as u64);
    if bar.is_hidden() && lines.are_due(finished_runs) {
        match lines.runs {
            usize::MAX => print_info(&format!("{finished_runs} runs{suffix}")),
            runs => print_info(&format!("{finished_runs} of {runs} runs{suffix}")),
        }
    }
    bar.set_message(suffix);
}

/// Schedule of progress lines without a terminal: after each tenth of the runs that took at least 1 s,
/// after 30 s, and at the end.
pub(super) struct ProgressLines {
    runs: usize,
    finished_runs: usize,
    last_print_time: Instant,
}

impl ProgressLines {
    pub(super) fn new(runs: usize) -> ProgressLines {
        ProgressLines { runs, finished_runs: 0, last_print_time: Instant::now() }
    }

    fn are_due(&mut self, finished_runs: usize) -> bool {
        let tenth = |finished_runs: usize| finished_runs / self.runs.div_ceil(10).max(1);
        let interval_s = if tenth(finished_runs) > tenth(self.finished_runs) { 1 } else { 30 };
        let is_late = self.last_print_time.elapsed() >= Duration::from_secs(interval_s);
        let is_due = finished_runs > self.finished_runs && (is_late || finished_runs == self.runs);
        if is_due {
            (self.finished_runs, self.last_print_time) = (finished_runs, Instant::now());
        }
        is_due
    }
}

/// Writer to stderr that hides the progress bar while it writes.
struct ProgressBarWriter;

impl Write for ProgressBarWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match PROGRESS_BAR.get() {
            Some(bar) if Stderr.is_ready() => bar.suspend(|| Stderr.write(bytes)),
            _ => Stderr.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Returns whether to color output: stderr is a terminal, and NO_COLOR is unset or empty.
fn uses_color() -> bool {
    io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}
