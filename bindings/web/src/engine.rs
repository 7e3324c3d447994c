//! One run, and the requests of a page about it. Requests and responses are JSON objects. The key `do` of a
//! request names it.

use std::path::Path;

use experiment::check::{self, Theory};
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read, read_text};
use outcome::metrics::Metrics;
use outcome::report::page;
use outcome::report::screen::format_screen;
use outcome::results::run_dir::RunDir;
use outcome::results::scene::build_scene;
use outcome::results::summary;
use outcome::results::tables;
use protocol::brief::Pace;
use protocol::exit;
use run::in_process::measured::{MeasuredRun, create_controller, reason_for_processes};
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

/// A request of a page.
#[derive(Debug, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub enum Question {
    /// Checks a scenario. Returns warnings and the report, as `phalanx check` prints them.
    Check(ScenarioInput),
    /// Starts a run. Returns its picture.
    Open(ScenarioInput),
    /// Advances the run by `ticks` ticks or to its end. Returns the newest frame, and the events after the first
    /// `told`.
    Advance {
        /// Number of ticks.
        ticks: u64,
        /// Number of events that the page has already.
        told: usize,
    },
    /// Returns the results of the run, when it is over.
    Left,
}

/// A scenario, as the user wrote it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioInput {
    /// Name of the scenario's file, for messages.
    file: String,
    text: String,
    /// Additional faults, as on the command line.
    faults: Vec<String>,
}

/// A run and its results.
pub struct Engine {
    scenario: Scenario,
    /// Text of the effective scenario.
    text: String,
    /// The run; `None` once its results were returned.
    run: Option<MeasuredRun<'static>>,
    over: bool,
}

/// Results of a run: text, the same on every target.
pub struct RunResults {
    /// Trajectory hash.
    pub hash: String,
    /// Exit code that `phalanx run` would have.
    pub exit: u8,
    /// Summary that `phalanx run` prints at the end.
    pub screen: String,
    /// Files by name.
    pub files: [(&'static str, String); 4],
}

impl RunResults {
    /// Returns the trajectory hash, and the beginning of the SHA-256 of each file, in hexadecimal digits.
    pub fn digest(&self) -> String {
        let mut line = self.hash.clone();
        for (name, text) in &self.files {
            let sum = Sha256::digest(text)
                .iter()
                .fold(String::new(), |hex, byte| hex + &format!("{byte:02x}"));
            line += &format!(" {name}={}", &sum[..16]);
        }
        line
    }
}

impl Engine {
    /// Starts a run of a scenario text, before its first tick. Returns the diagnostic of `phalanx run` if it is
    /// wrong.
    pub fn from_text(file: &str, text: &str, faults: &[String]) -> Result<Engine, String> {
        let (scenario, text, _) =
            read_asked(file, text, faults).map_err(|wrong| wrong.render(false))?;
        Engine::new(scenario, text)
    }

    /// Starts a run of a scenario file, with the files that it names.
    pub fn from_file(path: &Path) -> Result<Engine, String> {
        let read = read(path, &Overrides::default(), &agent::catalog());
        let (scenario, text, _) = read.map_err(|wrong| wrong.render(false))?;
        Engine::new(scenario, text)
    }

    fn new(scenario: Scenario, text: String) -> Result<Engine, String> {
        if let Some(why) = reason_for_processes(&scenario) {
            return Err(format!(
                "error: {why}: only processes have that, and here are none; use `phalanx run`\n"
            ));
        }
        // Each run borrows its own, which is leaked: few runs are opened.
        let run_dir = Box::leak(Box::new(RunDir::new(&scenario)));
        let metrics = Box::leak(Box::new(Metrics::new(&scenario, Pace::Lockstep)));
        let create_controller = Box::new(create_controller);
        let run = MeasuredRun::new(&scenario, create_controller, run_dir, metrics, || 0);
        let mut run = run.map_err(|why| format!("error: {why}\n"))?;
        let Ok(over) = run.record_truth_sample();
        Ok(Engine { scenario, text, run: Some(run), over })
    }

    /// Returns the text of the effective scenario.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Advances the run by at most `ticks` ticks. Returns whether it is over.
    pub fn advance(&mut self, ticks: u64) -> bool {
        let Some(run) = &mut self.run else { return true };
        for _ in 0..ticks {
            if self.over {
                break;
            }
            run.advance_tick();
            let Ok(over) = run.record_truth_sample();
            self.over = over;
        }
        self.over
    }

    /// Returns the results of the run; `None` at the second call.
    pub fn left(&mut self) -> Option<RunResults> {
        let (outcome, journal, Ok(())) = self.run.take()?.finish();
        let (run_dir, metrics) = (journal.run_dir, &*journal.metrics);
        let summary =
            summary::evaluate_run(&self.scenario, Pace::Lockstep, metrics, &outcome, exit::OK);
        Some(RunResults {
            hash: summary.trajectory_hash.clone().unwrap_or_default(),
            exit: summary.exit,
            screen: format_screen(&summary),
            files: [
                ("samples.csv", run_dir.samples().to_owned()),
                ("pairs.csv", tables::format_pairs(&metrics.pair_distances())),
                ("events.csv", run_dir.events()),
                ("summary.json", summary::to_json(&summary)),
            ],
        })
    }

    fn frame(&mut self, events_received: usize) -> Value {
        let Some(run) = &mut self.run else { return Value::Null };
        let new_events: Vec<Value> = run.run_dir().recorded_events.get(events_received..).unwrap_or_default()
            .iter()
            .map(|event| {
                json!({ "t_s": event.t_s, "kind": event.kind, "robot": event.robot, "detail": event.detail,
                    "other": event.other })
            })
            .collect();
        json!({ "frame": run.scene_frame(), "happened": new_events, "over": self.over, "tick": run.run().current_tick() })
    }

    fn opened(&mut self) -> Value {
        let mut scene = build_scene(&self.scenario, Pace::Lockstep);
        scene.pace = "in the browser".into();
        let period_s = formation::ns_to_seconds(self.scenario.period_ns);
        json!({ "html": page::live_picture_html(&scene), "scenario": self.text, "name": scene.name,
            "duration_s": scene.duration_s, "period_s": period_s })
    }
}

fn read_asked(file: &str, text: &str, faults: &[String]) -> experiment::scenario::read::ReadResult {
    let overrides = Overrides { faults: faults.to_vec(), ..Overrides::default() };
    read_text(Path::new(file), text, &overrides, &agent::catalog())
}

/// Processes a request. `engine` is the run that was opened last.
pub fn answer(engine: &mut Option<Engine>, question: &str) -> Value {
    match serde_json::from_str(question) {
        Err(error) => json!({ "error": format!("the request is not valid: {error}") }),
        Ok(Question::Check(ScenarioInput { file, text, faults })) => {
            let render =
                |list: &[Diagnostic]| list.iter().map(|one| one.render(false)).collect::<String>();
            match read_asked(&file, &text, &faults) {
                Err(wrong) => json!({ "error": render(&[wrong]) }),
                Ok((scenario, _, warnings)) => {
                    let report = check::format_report(&scenario, &Theory::compute(&scenario));
                    json!({ "warnings": render(&warnings), "report": report })
                }
            }
        }
        Ok(Question::Open(ScenarioInput { file, text, faults })) => {
            match Engine::from_text(&file, &text, &faults) {
                Err(error) => json!({ "error": error }),
                Ok(opened) => engine.insert(opened).opened(),
            }
        }
        Ok(Question::Advance { ticks, told }) => match engine {
            None => json!({ "error": "no run is open" }),
            Some(engine) => {
                engine.advance(ticks);
                engine.frame(told)
            }
        },
        Ok(Question::Left) => match engine.as_mut().and_then(Engine::left) {
            None => json!({ "error": "no run is open" }),
            Some(left) => {
                json!({ "hash": left.hash, "digest": left.digest(), "exit": left.exit, "screen": left.screen,
                "files": left.files.into_iter().collect::<std::collections::BTreeMap<_, _>>() })
            }
        },
    }
}
