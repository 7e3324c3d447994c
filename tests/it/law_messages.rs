//! Messages of control laws in Rust: equal in lockstep runs with processes and within one process, also with kills,
//! loss, delay, cuts and false data. Their tables are equal, too.

use std::borrow::Cow;
use std::path::Path;
use std::time::Duration;

use agent::control_loop;
use agent::controller::{Controller, Parts};
use agent::laws::{Gains, Law, LawRow, MessageArray, MessageFormat, SendDecision, Situation};
use agent::roles::{FORMATION_ROLE, FREE_ROLE};
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_text};
use formation::Vec2;
use formation::desired::Target;
use outcome::metrics::Metrics;
use outcome::metrics::summary::Summary;
use outcome::results::run_dir::RunDir;
use outcome::results::summary::evaluate_run;
use protocol::brief::{AgentBrief, Pace};
use protocol::exit;
use protocol::signals::SignalValues;
use run::in_process::measured::MeasuredRun;
use tempfile::TempDir;

use crate::oracle;
use crate::processes::{EmbeddedRun, in_place_of, run_embedded_scenario};

/// Key of the array in the messages of [`EstimateLaw`].
const ESTIMATE_KEY: &str = "estimate_m";

static ESTIMATE_ARRAYS: [MessageArray; 1] =
    [MessageArray { name: Cow::Borrowed(ESTIMATE_KEY), shape: Cow::Borrowed(&[2]) }];
static ESTIMATE_FORMAT: MessageFormat =
    MessageFormat { bytes_max: 16, arrays: Cow::Borrowed(&ESTIMATE_ARRAYS) };
static ECHO_FORMAT: MessageFormat = MessageFormat::with_bytes(9);

/// Laws of the robots of [`SCENARIO`].
pub(crate) const TEST_LAWS: [LawRow; 3] = [
    LawRow {
        name: "test-estimate",
        role: FORMATION_ROLE,
        source: "none",
        gain_keys: &["k_per_s"],
        feed_forward: false,
        correction_max: None,
        message_format: Some(&ESTIMATE_FORMAT),
        may_withhold_beacon: false,
        signals: &["estimate_x_m"],
        build: |gains: &Gains<'_>| {
            Box::new(EstimateLaw { k_per_s: gains.get("k_per_s"), estimate_m: None })
        },
    },
    LawRow {
        name: "test-echo",
        role: FORMATION_ROLE,
        source: "none",
        gain_keys: &["k_per_s"],
        feed_forward: false,
        correction_max: None,
        message_format: Some(&ECHO_FORMAT),
        may_withhold_beacon: true,
        signals: &[],
        build: |gains: &Gains<'_>| {
            Box::new(EchoLaw { k_per_s: gains.get("k_per_s"), calls: 0, last_byte: 0 })
        },
    },
    LawRow {
        name: "test-circle",
        role: FREE_ROLE,
        source: "none",
        gain_keys: &["k_per_s"],
        feed_forward: false,
        correction_max: None,
        message_format: None,
        may_withhold_beacon: false,
        signals: &["distance_m"],
        build: |gains: &Gains<'_>| {
            Box::new(CircleLaw {
                k_per_s: gains.get("k_per_s"),
                target: Target::at_rest(Vec2::zeros()),
                distance_m: 0.0,
            })
        },
    },
];

/// Consensus on an estimate of a position, which moves the robot. A restart loses the estimate.
struct EstimateLaw {
    k_per_s: f64,
    estimate_m: Option<Vec2>,
}

impl Law for EstimateLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let mut new_estimate = self.estimate_m.unwrap_or(situation.front_point);
        let before = new_estimate;
        for neighbor in situation.neighbor_estimates {
            let numbers = neighbor.message.as_ref().and_then(|m| m.numbers(ESTIMATE_KEY));
            if let Some(numbers) = numbers {
                new_estimate +=
                    0.05 * (Vec2::new(numbers[0], numbers[1]) - before).cap_magnitude(1.0);
            }
        }
        self.estimate_m = Some(new_estimate);
        let towards = (new_estimate - situation.front_point).cap_magnitude(0.2);
        -self.k_per_s * situation.error.cap_magnitude(0.2) + 0.1 * towards
    }

    fn send_decision(&mut self) -> SendDecision {
        let estimate = self.estimate_m.unwrap_or_default();
        let message = ESTIMATE_FORMAT.encode(&[(ESTIMATE_KEY, &[estimate.x, estimate.y])]);
        SendDecision::Message(message.expect("two finite numbers"))
    }

    fn signals(&mut self) -> SignalValues {
        let mut values = SignalValues::NONE;
        values.set(0, self.estimate_m.unwrap_or_default().x);
        values
    }
}

/// Sends bytes that depend on the bytes received, beacons without a message, and no beacon, in turns.
struct EchoLaw {
    k_per_s: f64,
    calls: u8,
    last_byte: u8,
}

impl Law for EchoLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        self.calls = self.calls.wrapping_add(1);
        let received = situation.neighbor_estimates.iter().filter_map(|n| n.message.as_ref());
        for byte in received.flat_map(|message| message.bytes.iter()) {
            self.last_byte = self.last_byte.wrapping_mul(31).wrapping_add(*byte);
        }
        let speed_m_s = 0.05 * (f64::from(self.last_byte) / 255.0 - 0.5);
        -self.k_per_s * situation.error.cap_magnitude(0.2) + Vec2::new(speed_m_s, 0.0)
    }

    fn send_decision(&mut self) -> SendDecision {
        match self.calls % 7 {
            0 => SendDecision::Withheld,
            1 | 2 => SendDecision::Beacon,
            _ => {
                let length = usize::from(1 + self.last_byte % 9);
                SendDecision::Message(vec![self.last_byte; length].into())
            }
        }
    }
}

/// Follows a target on a circle around the origin, and names it.
struct CircleLaw {
    k_per_s: f64,
    target: Target,
    distance_m: f64,
}

impl Law for CircleLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let (sin, cos) = (0.2 * situation.t_s).sin_cos();
        let velocity = 0.2 * Vec2::new(-sin, cos);
        self.target = Target { position: Vec2::new(cos, sin), velocity };
        let from_target = situation.front_point - self.target.position;
        self.distance_m = from_target.norm();
        velocity - self.k_per_s * from_target.cap_magnitude(0.2)
    }

    fn target(&mut self) -> Option<Target> {
        Some(self.target)
    }

    fn signals(&mut self) -> SignalValues {
        let mut values = SignalValues::NONE;
        values.set(0, self.distance_m);
        values
    }
}

/// Six robots with the first two laws.
const SCENARIO: &str = r#"
name = "law-messages"
duration_s = 6.0
period_s = 0.01
seed = 3
record_messages = true
[[robot]]
name = "r1"
hears = ["r2", "r4"]
place_m = [0.0, 0.0]
pose = { x_m = 0.0, y_m = 0.1, heading_rad = 0.0 }
[[robot]]
name = "r2"
hears = ["r1", "r3", "r5"]
place_m = [0.6, 0.0]
pose = { x_m = 0.7, y_m = 0.0, heading_rad = 0.0 }
[[robot]]
name = "r3"
hears = ["r1", "r4"]
place_m = [1.2, 0.0]
pose = { x_m = 1.3, y_m = -0.1, heading_rad = 0.0 }
[[robot]]
name = "r4"
hears = ["r3", "r6"]
place_m = [0.0, 0.6]
pose = { x_m = -0.1, y_m = 0.7, heading_rad = 0.0 }
[[robot]]
name = "r5"
hears = ["r6", "r2"]
place_m = [0.6, 0.6]
pose = { x_m = 0.6, y_m = 0.8, heading_rad = 0.0 }
law = "test-echo"
[[robot]]
name = "r6"
hears = ["r5", "r1"]
place_m = [1.2, 0.6]
pose = { x_m = 1.2, y_m = 0.5, heading_rad = 0.0 }
law = "test-echo"
[robot_defaults]
law = "test-estimate"
k_per_s = 0.5
front_point_m = 0.045
[avoidance]
kind = "guard"
distance_min_m = 0.2
speed_max_m_s = 0.3
"#;

/// Faults of processes and links.
const FAULTS: [&str; 8] = [
    "kill r2 @1.5 restart 0.5",
    "kill r5 @2 restart 0.7",
    "freeze r6 @4 for 0.5",
    "loss r1->r2 of 0.4 @0.5 for 5",
    "delay r3->r4 by 0.05 jitter 0.03 @1 for 4",
    "cut r4->r3 @2 for 2",
    "lie r1->r3 scale 1.5 offset 0.1 noise 0.2 @1 for 3",
    "lie r5 beacons flips 0.1 @1 for 4",
];

/// Tables of a run that are compared.
const TABLES: [&str; 4] = ["samples.csv", "events.csv", "signals.csv", "messages.csv"];

/// The process of a robot with one of these laws. It is ignored as a test; [`run_in_processes`] starts it.
#[test]
#[ignore = "a robot's process: another test starts it"]
fn robot_process_with_test_laws() {
    let (Ok(brief), Ok(incarnation)) = (std::env::var("BRIEF"), std::env::var("INCARNATION"))
    else {
        return;
    };
    supervisor::child::prepare_process().unwrap();
    let parts = |brief: &AgentBrief| Parts::from_brief_with_laws(brief, &TEST_LAWS);
    let incarnation = incarnation.parse().unwrap();
    let code = control_loop::main_with_parts(Path::new(&brief), incarnation, false, parts);
    std::process::exit(code.into());
}

/// Runs [`SCENARIO`] with one process for each robot, at this pace, with faults and further arguments.
fn run_in_processes(pace: Pace, faults: &[&str], more: &[&str]) -> EmbeddedRun {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scenario.toml");
    std::fs::write(&file, SCENARIO).unwrap();
    let variables = "BRIEF=\"$2\" INCARNATION=\"$4\"";
    let script = in_place_of("agent", variables, "law_messages::robot_process_with_test_laws");
    let mut arguments = vec!["--pace", pace.keyword()];
    faults.iter().for_each(|fault| arguments.extend(["--fault", fault]));
    arguments.extend(more);
    let run = run_embedded_scenario(file.to_str().unwrap(), &script, &arguments);
    assert_eq!(run.code, 0, "{}", run.file("logs/r1.jsonl"));
    run
}

/// Result of a run within this process.
struct InProcessRunResult {
    summary: Summary,
    folder: TempDir,
}

impl InProcessRunResult {
    fn file(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder.path().join("run").join(name)).unwrap()
    }
}

/// Reads a scenario text with these faults.
fn read_scenario(text: &str, faults: &[&str]) -> Scenario {
    let faults = faults.iter().map(|&fault| fault.to_owned()).collect();
    let overrides = Overrides { assignments: Vec::new(), faults, seed: None };
    let catalog = agent::catalog_with_laws(&TEST_LAWS);
    match read_text(Path::new("scenario.toml"), text, &overrides, &catalog) {
        Ok((scenario, ..)) => scenario,
        Err(diagnostic) => panic!("{}", diagnostic.render(false)),
    }
}

/// Runs [`SCENARIO`] with these faults within this process.
fn run_in_process(faults: &[&str]) -> InProcessRunResult {
    let scenario = read_scenario(SCENARIO, faults);
    record_in_process(&scenario)
}

/// Returns the controller of a robot with one of these laws.
fn make_controller(brief: &AgentBrief, incarnation: u64) -> Controller {
    let parts = Parts::from_brief_with_laws(brief, &TEST_LAWS).unwrap();
    Controller::with_parts(brief, incarnation, parts)
}

/// Runs a scenario within this process, and records it.
fn record_in_process(scenario: &Scenario) -> InProcessRunResult {
    let folder = tempfile::tempdir().unwrap();
    let mut run_dir = RunDir::create(&folder.path().join("run"), scenario).unwrap();
    let mut metrics = Metrics::new(scenario, Pace::Lockstep);
    let mut run =
        MeasuredRun::new(scenario, Box::new(make_controller), &mut run_dir, &mut metrics, || 0)
            .unwrap();
    while !run.record_truth_sample().unwrap() {
        run.advance_tick();
    }
    let (mut outcome, _, recorded) = run.finish();
    recorded.unwrap();
    let summary = evaluate_run(scenario, Pace::Lockstep, &metrics, &outcome, exit::OK);
    let unwritten = run_dir.write_final_files(&[], &mut outcome.latency, Duration::ZERO);
    assert!(unwritten.is_empty(), "{unwritten:?}");
    InProcessRunResult { summary, folder }
}

#[test]
fn rust_laws_send_equal_messages_in_processes_and_in_process() {
    let undisturbed = run_in_process(&[]);
    for faults in [&[][..], &FAULTS] {
        let one_process = run_in_process(faults);
        let hashes = |run: &InProcessRunResult| {
            [run.summary.trajectory_hash.clone(), run.summary.message_hash.clone()]
        };
        assert!(hashes(&one_process).iter().all(Option::is_some));
        let differs = hashes(&one_process).iter().zip(hashes(&undisturbed)).all(|(a, b)| *a != b);
        assert_eq!(differs, !faults.is_empty());
        for _ in 0..2 {
            let processes = run_in_processes(Pace::Lockstep, faults, &[]);
            let hash = |key: &str| processes.summary[key].as_str().map(str::to_owned);
            let found = [hash("trajectory_hash"), hash("message_hash")];
            assert_eq!(found, hashes(&one_process), "{faults:?}");
            for table in TABLES {
                assert!(
                    processes.file(table) == one_process.file(table),
                    "{table} with {faults:?}"
                );
            }
        }
    }
}

/// Returns the cells of the lines of a robot in `messages.csv`.
fn lines_of_robot(table: &str, robot: &str) -> Vec<Vec<String>> {
    let cells = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
    table.lines().skip(1).map(cells).filter(|cells| cells[1] == robot).collect()
}

#[test]
fn recorded_messages_are_those_that_the_sender_published() {
    let plain = run_in_process(&[]).file("messages.csv");
    assert!(plain.starts_with("t_s,robot,array,index,value,bytes\n"), "{}", &plain[..200]);
    let first = lines_of_robot(&plain, "r1");
    let numbers = |lines: &[Vec<String>]| -> Vec<f64> {
        lines.iter().map(|cells| cells[4].parse().unwrap()).collect()
    };
    // The law is called from the second tick on, after the first beacons. Its first estimate is the front point.
    assert_eq!(first[0][0], "0.01");
    assert_eq!((first[0][2].as_str(), first[0][3].as_str()), (ESTIMATE_KEY, "0"));
    assert!((numbers(&first)[0] - 0.045).abs() < 1e-12 && (numbers(&first)[1] - 0.1).abs() < 1e-12);
    assert_eq!(first.len(), 2 * 599);
    // False data is added on the way to a receiver, so that the record of the sender does not contain it.
    let false_data = ["lie r1 beacons offset 1000 @0"];
    let falsified = lines_of_robot(&run_in_process(&false_data).file("messages.csv"), "r1");
    assert_eq!(falsified[..2], first[..2]);
    // A message without a structure has its bytes in one line.
    let bytes = lines_of_robot(&plain, "r5");
    assert!(!bytes.is_empty());
    for cells in &bytes {
        assert_eq!((cells[2].as_str(), cells[3].as_str(), cells[4].as_str()), ("", "0", ""));
        let length = cells[5].len();
        assert!(length % 2 == 0 && (2..=18).contains(&length), "{cells:?}");
    }
}

#[test]
fn messages_are_recorded_in_real_time_and_only_on_request() {
    let run = run_in_processes(Pace::Realtime, &[], &["--set", "duration_s=2"]);
    let table = run.file("messages.csv");
    for robot in ["r1", "r2", "r3", "r4", "r5", "r6"] {
        let lines = lines_of_robot(&table, robot);
        assert!(!lines.is_empty(), "{robot}: {table}");
        let times: Vec<f64> = lines.iter().map(|cells| cells[0].parse().unwrap()).collect();
        assert!(times.is_sorted(), "{robot}: {times:?}");
    }
    let set = ["--set", "duration_s=0.5", "--set", "record_messages=false"];
    let run = run_in_processes(Pace::Lockstep, &[], &set);
    assert_eq!(run.file("messages.csv"), "");
    assert!(run.summary["message_hash"].is_string());
}

/// Two robots that follow targets, one of which is killed.
const CIRCLES: &str = r#"
name = "circles"
duration_s = 10.0
period_s = 0.01
[robot_defaults]
law = "test-circle"
k_per_s = 1.0
front_point_m = 0.045
[avoidance]
kind = "none"
distance_min_m = 0.2
speed_max_m_s = 0.5
[metrics.distance_m]
signal = "distance_m"
[[robot]]
name = "r1"
pose = { x_m = 0.7, y_m = 0.0, heading_rad = 0.0 }
[[robot]]
name = "r2"
pose = { x_m = 0.0, y_m = 0.5, heading_rad = 0.0 }
"#;

#[test]
fn measures_without_a_record_contain_targets_and_signals() {
    let scenario = read_scenario(CIRCLES, &["kill r2 @4 restart 1"]);
    let recorded = record_in_process(&scenario).summary;
    let measured = oracle::simulate_with(&scenario, Box::new(make_controller));
    assert!(measured.final_error_m_max.is_some() && measured.converged_at_s.is_some());
    assert_eq!(measured.final_error_m, recorded.final_error_m);
    assert_eq!(measured.converged_at_s, recorded.converged_at_s);
    assert_eq!(measured.metrics, recorded.metrics);
    assert!(measured.metrics.iter().all(|(_, value)| value.is_some()), "{:?}", measured.metrics);
}
