//! One run, and the questions that a page has about it. A question is a JSON object with `do`; the answer is one too.

use std::path::Path;

use agent::controller::Controller;
use experiment::check::{self, Theory};
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read, read_text};
use outcome::metrics::Metrics;
use outcome::report::page;
use outcome::report::screen::screen;
use outcome::results::run_dir::RunDir;
use outcome::results::scene::scene;
use outcome::results::summary;
use outcome::results::tables;
use protocol::brief::{AgentBrief, Pace};
use protocol::process::exit;
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::in_process::measured::{Measured, controller, needs_processes};

type Think = fn(&AgentBrief, u64) -> Controller;

/// A question.
#[derive(Debug, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub enum Question {
    /// Is this scenario sound? As `phalanx check` says it.
    Check(Asked),
    /// Begins a run; its picture.
    Open(Asked),
    /// Lets so many ticks pass, or fewer to the end; the newest frame, and what happened after the first `told`
    /// events.
    Advance {
        /// How many.
        ticks: u64,
        /// How many events the page knows.
        told: usize,
    },
    /// What the run left, when it is over.
    Left,
}

/// A scenario, as somebody wrote it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Asked {
    /// The name of its file, for messages.
    file: String,
    text: String,
    /// Faults to add, as on the command line.
    faults: Vec<String>,
}

/// A run, and what it leaves.
pub struct Engine {
    scenario: Scenario,
    /// The effective scenario.
    text: String,
    /// None once it has left everything.
    run: Option<Measured<'static, Think>>,
    over: bool,
}

/// What a run came to: text, the same on every target.
pub struct Left {
    /// The trajectory hash.
    pub hash: String,
    /// The exit code of `phalanx run`.
    pub exit: u8,
    /// What that prints at the end.
    pub screen: String,
    /// Its files, by name.
    pub files: [(&'static str, String); 4],
}

impl Left {
    /// The hash, and the SHA-256 of each file, in hexadecimal digits.
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
    /// A run of a scenario's text, before its first tick; or what is wrong, as `phalanx run` says it.
    pub fn of_text(file: &str, text: &str, faults: &[String]) -> Result<Engine, String> {
        let (scenario, text, _) =
            read_asked(file, text, faults).map_err(|wrong| wrong.render(false))?;
        Engine::new(scenario, text)
    }

    /// The same of a file, with the files that it names.
    pub fn of_file(path: &Path) -> Result<Engine, String> {
        let read = read(path, &Overrides::default(), &agent::catalog());
        let (scenario, text, _) = read.map_err(|wrong| wrong.render(false))?;
        Engine::new(scenario, text)
    }

    fn new(scenario: Scenario, text: String) -> Result<Engine, String> {
        if let Some(why) = needs_processes(&scenario) {
            return Err(format!(
                "error: {why}: only processes have that, and here are none; use `phalanx run`\n"
            ));
        }
        // One run each: whoever wants another one begins anew.
        let run_dir = Box::leak(Box::new(RunDir::new(&scenario)));
        let metrics = Box::leak(Box::new(Metrics::new(&scenario, Pace::Lockstep)));
        let run = Measured::new(&scenario, controller as Think, run_dir, metrics, || 0);
        let mut run = run.map_err(|why| format!("error: {why}\n"))?;
        let Ok(over) = run.truth();
        Ok(Engine { scenario, text, run: Some(run), over })
    }

    /// The effective scenario.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Lets so many ticks pass; whether the run is over.
    pub fn advance(&mut self, ticks: u64) -> bool {
        let Some(run) = &mut self.run else { return true };
        for _ in 0..ticks {
            if self.over {
                break;
            }
            run.tick();
            let Ok(over) = run.truth();
            self.over = over;
        }
        self.over
    }

    /// What the run left, once.
    pub fn left(&mut self) -> Option<Left> {
        let (outcome, journal, Ok(())) = self.run.take()?.finish();
        let (run_dir, metrics) = (journal.run_dir, &*journal.metrics);
        let summary = summary::judge(&self.scenario, Pace::Lockstep, metrics, &outcome, exit::OK);
        Some(Left {
            hash: summary.trajectory_hash.clone().unwrap_or_default(),
            exit: summary.exit,
            screen: screen(&summary),
            files: [
                ("samples.csv", run_dir.samples().to_owned()),
                ("pairs.csv", tables::pairs(&metrics.pairs())),
                ("events.csv", run_dir.events()),
                ("summary.json", summary::to_json(&summary)),
            ],
        })
    }

    fn frame(&mut self, told: usize) -> Value {
        let Some(run) = &mut self.run else { return Value::Null };
        let happened: Vec<Value> = run.run_dir().happened.get(told..).unwrap_or_default()
            .iter()
            .map(|event| {
                let t_s = formation::seconds(event.t_ns);
                json!({ "t_s": t_s, "kind": event.kind, "robot": event.robot, "detail": event.detail })
            })
            .collect();
        json!({ "frame": run.frame(), "happened": happened, "over": self.over, "tick": run.run().tick() })
    }

    fn opened(&mut self) -> Value {
        let mut scene = scene(&self.scenario, Pace::Lockstep);
        scene.pace = "in the browser".into();
        let period_s = formation::seconds(self.scenario.period_ns);
        json!({ "html": page::fragment(&scene), "scenario": self.text, "name": scene.name,
            "duration_s": scene.duration_s, "period_s": period_s })
    }
}

fn read_asked(file: &str, text: &str, faults: &[String]) -> experiment::scenario::read::Reading {
    let overrides = Overrides { faults: faults.to_vec(), ..Overrides::default() };
    read_text(Path::new(file), text, &overrides, &agent::catalog())
}

/// Answers a question; `engine` is the run that was opened last.
pub fn answer(engine: &mut Option<Engine>, question: &str) -> Value {
    match serde_json::from_str(question) {
        Err(error) => json!({ "error": format!("no question: {error}") }),
        Ok(Question::Check(Asked { file, text, faults })) => {
            let said =
                |list: &[Diagnostic]| list.iter().map(|one| one.render(false)).collect::<String>();
            match read_asked(&file, &text, &faults) {
                Err(wrong) => json!({ "error": said(&[wrong]) }),
                Ok((scenario, _, warnings)) => {
                    let report = check::report(&scenario, &Theory::of(&scenario));
                    json!({ "warnings": said(&warnings), "report": report })
                }
            }
        }
        Ok(Question::Open(Asked { file, text, faults })) => {
            match Engine::of_text(&file, &text, &faults) {
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
