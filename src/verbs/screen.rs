//! The terminal: results on stdout; complaints, diagnostics, the log and the progress bar on stderr.
//!
//! Nothing else in the command line writes to either. Text of files and of other processes never
//! commands the terminal: its control characters are written out.

use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use protocol::process::{Stderr, exit, log_level, never_block_on_stderr, unknown_log_level};
use protocol::visible;

use experiment::scenario::diagnostic::Diagnostic;

const MS: u64 = 1_000_000;

/// In which form a result is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Output {
    /// Text, at most a screen.
    Text,
    /// The same and more, as JSON; for a run, summary.json.
    Json,
}

/// Prints what is logged on stderr, warnings and worse unless the environment asks for more.
pub(super) fn log_to_stderr() {
    // Fails only in a program that logs already, which then goes on as it was.
    let _ = tracing_subscriber::fmt()
        .with_writer(|| AboveTheBar)
        .with_ansi(in_color())
        .with_target(false)
        .without_time()
        .with_max_level(log_level(tracing::Level::WARN))
        .try_init();
    if let Some(unknown) = unknown_log_level() {
        let expected = "expected error, warn, info, debug or trace; warn is used";
        tell(&format!("warning: PHALANX_LOG is {unknown:?}; {expected}"));
    }
}

/// Prints a result in this form; a closed pipe is the reader's choice, not an error.
pub(super) fn print_as(output: Output, text: &str) -> u8 {
    let text = match output {
        Output::Text => visible::lines(text),
        Output::Json => visible::json(text),
    };
    printed(io::stdout().write_all(text.as_bytes()))
}

/// Returns the exit code of a program that has written its result to stdout.
pub(crate) fn printed(written: io::Result<()>) -> u8 {
    match written.and_then(|()| io::stdout().flush()) {
        Ok(()) => exit::OK,
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => exit::OK,
        Err(error) => complain(&format_args!("cannot write to stdout: {error}")),
    }
}

/// Prints a result for people.
pub(crate) fn print(text: &str) -> u8 {
    print_as(Output::Text, text)
}

/// Says what went wrong, as one line.
pub(super) fn complain(error: &dyn Display) -> u8 {
    let _ = writeln!(Stderr, "error: {}", visible::lines(&error.to_string()));
    exit::INFRASTRUCTURE
}

/// Shows what is wrong with a file, or worth a warning.
pub(super) fn show(diagnostic: &Diagnostic) {
    let _ = writeln!(Stderr, "{}", diagnostic.render(in_color()));
}

/// Says what is wrong with the command line, or with what it names; the exit code.
pub(super) fn misused(error: &dyn Display) -> u8 {
    complain(error);
    exit::USAGE
}

/// Shows why a file is no sound scenario, or none of its kind; the exit code.
pub(super) fn unsound(diagnostic: &Diagnostic) -> u8 {
    show(diagnostic);
    exit::BAD_SCENARIO
}

/// Says something that is neither result nor complaint.
pub(super) fn tell(line: &str) {
    let _ = writeln!(Stderr, "{}", visible::lines(line));
}

/// The progress bar of the run at hand.
static BAR: OnceLock<ProgressBar> = OnceLock::new();

/// The progress bar of a run of `duration_ns`; there is one run per process.
pub(super) fn progress(duration_ns: u64) -> &'static ProgressBar {
    BAR.get_or_init(|| progress_bar(duration_ns))
}

fn progress_bar(duration_ns: u64) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(duration_ns / MS);
    // Not as wide as the screen: the echo of a Ctrl-C would break the line.
    let style = ProgressStyle::with_template("{bar:50} {msg}").expect("a valid template");
    bar.set_style(style);
    bar
}

/// Moves the bar to `t_ns` since the run's start.
pub(super) fn show_progress(bar: &ProgressBar, t_ns: u64) {
    // The bar writes by itself, and would block.
    if bar.is_hidden() || !Stderr.is_ready() {
        return;
    }
    bar.set_position(t_ns / MS);
    let seconds = |ms: u64| ms as f64 / 1e3;
    let whole = bar.length().map_or(0.0, seconds);
    bar.set_message(format!("{:.1} of {whole} s", seconds(t_ns / MS)));
}

/// Removes the bar of a run that is over.
pub(super) fn end_progress(bar: &ProgressBar) {
    if Stderr.is_ready() {
        bar.finish_and_clear();
    }
}

/// The progress bar of so many runs; `usize::MAX`: nobody knows how many.
pub(super) fn runs_progress(runs: usize) -> &'static ProgressBar {
    never_block_on_stderr();
    BAR.get_or_init(|| {
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

/// Moves that bar, or says the same in a line where there is none; `more` is said of them.
pub(super) fn runs_done(bar: &ProgressBar, lines: &mut ProgressLines, done: usize, more: String) {
    bar.set_position(done as u64);
    if bar.is_hidden() && lines.are_due(done) {
        match lines.runs {
            usize::MAX => tell(&format!("{done} runs{more}")),
            runs => tell(&format!("{done} of {runs} runs{more}")),
        }
    }
    bar.set_message(more);
}

/// When a line is due where the output is no terminal: with each tenth of the runs that took a second, after half a
/// minute, and at last.
pub(super) struct ProgressLines {
    runs: usize,
    done: usize,
    at: Instant,
}

impl ProgressLines {
    pub(super) fn new(runs: usize) -> ProgressLines {
        ProgressLines { runs, done: 0, at: Instant::now() }
    }

    fn are_due(&mut self, done: usize) -> bool {
        let tenth = |done: usize| done / self.runs.div_ceil(10).max(1);
        let wait_s = if tenth(done) > tenth(self.done) { 1 } else { 30 };
        let is_late = self.at.elapsed() >= Duration::from_secs(wait_s);
        let is_due = done > self.done && (is_late || done == self.runs);
        if is_due {
            (self.done, self.at) = (done, Instant::now());
        }
        is_due
    }
}

/// Standard error, with the progress bar out of the way while something is written.
struct AboveTheBar;

impl Write for AboveTheBar {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match BAR.get() {
            Some(bar) if Stderr.is_ready() => bar.suspend(|| Stderr.write(bytes)),
            _ => Stderr.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Colors only for people who want them: NO_COLOR, and a terminal.
fn in_color() -> bool {
    io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}
