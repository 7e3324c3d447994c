use super::*;
use crate::metrics::CurrentMetrics;
use crate::metrics::examples::{header, rows};
use crate::report::run::RobotSample;
use crate::report::scene::EdgeState;
use crate::results::latency::LatencyCollector;
use crate::results::run_dir::RunDir;
use crate::results::tables::EventLine;
use experiment::examples::row_of_three;
use formation::Vec2;
use proptest::prelude::*;
use protocol::brief::Pace;
use protocol::message::{LatencyHeader, LatencyRow};
use protocol::stage::Stage;
use std::time::{Duration, SystemTime};

/// Writes all files of a run of three robots that a report reads.
fn write_example_run(folder: &Path) -> PathBuf {
    let path = folder.join("run");
    let mut scenario = row_of_three();
    scenario.record_hz = 1e3;
    let mut run_dir = RunDir::create(&path, &scenario).unwrap();
    for tick in 0..8 {
        let errors = [Some(0.1), None, Some(0.3)];
        let front_x_m = [0.0, 1.0, 2.0].map(|x| x + tick as f64 * 0.1);
        let alive = [true, tick != 4, true];
        let nearest_pair = Some((1.0, [0, 1]));
        let metrics = CurrentMetrics {
            errors_m: &errors,
            error_vectors: &[Some(Vec2::new(0.06, -0.08)), None, None],
            ideal_errors_m: &[None, Some(0.2), Some(0.4)],
            nearest_pair,
            ..CurrentMetrics::default()
        };
        run_dir.write_truth(&header(tick), &rows(front_x_m), &alive, metrics).unwrap();
    }
    for (t_ns, kind, robot, state, other) in [
        (2_000_000_000, "kill", "r2", "", ""),
        (3_000_000_000, "contact", "r3", "stale", "r2"),
        (4_000_000_000, "ready", "r2", "", ""),
        (4_500_000_000, "orphaned", "r1", "", ""),
        (4_600_000_000, "repair", "r1", "leads", ""),
        (5_000_000_000, "freeze", "r3", "", ""),
        (5_000_000_000, "cut", "r2", "", "r1"),
        (6_000_000_000, "freeze", "", "", ""),
    ] {
        let [kind, robot, state, other] = [kind, robot, state, other].map(str::to_owned);
        let event = EventLine { kind, robot, state, other, ..EventLine::default() };
        run_dir.write_event(t_ns, event).unwrap();
    }
    drop(run_dir);
    let mut latency = LatencyCollector::new(&scenario, Pace::Realtime);
    let row = |value_ns| LatencyRow { stage: Stage::BeaconAge as u32, from: 1, value_ns };
    latency.add_batch(2, &LatencyHeader::default(), &[row(5_000_000), row(7_000_000)]);
    let hlog = latency.encode_hlog(SystemTime::UNIX_EPOCH, Duration::from_secs(8));
    let write = |name: &str, content: &[u8]| fs::write(path.join(name), content).unwrap();
    write("latency.hlog", &hlog);
    let over_time = "t_s,stage,robot,from,count,p50_ns,p99_ns,max_ns\n\
                     0.5,beacon_age,r2,r1,2,5000000,7000000,7000000\n0.5,wake,plant,,1,9,9,9\n";
    write("latency_over_time.csv", over_time.as_bytes());
    write("manifest.json", br#"{ "pace": "realtime", "cores": 2, "command": ["phalanx", "run"] }"#);
    let summary = r#"{ "t_s": 7.0, "min_distance_m": 1.0, "min_distance_pair": ["r1", "r2"],
        "min_distance_t_s": 0.0, "faults": [{ "t_s": 2.0, "what": "death of r2 (signal 9)",
        "robot": "r2", "lasted_s": 2.0 }, { "t_s": 5.0, "what": "cut r1->r2, by hand", "robot": "r1",
        "lasted_s": 1.0 }, { "t_s": 6.0, "what": "freeze plant, by another process", "lasted_s": 0.5 }] }"#;
    write("summary.json", summary.as_bytes());
    path
}

const FILES: [&str; 6] = [
    "samples.csv",
    "events.csv",
    "summary.json",
    "manifest.json",
    "latency_over_time.csv",
    "latency.hlog",
];

#[test]
fn run_directory_has_all_poses_and_outcomes() {
    let folder = tempfile::tempdir().unwrap();
    let run = load_run(&write_example_run(folder.path()), &row_of_three()).unwrap();
    assert_eq!((run.scene.pace.as_str(), run.times_s.len(), run.decimation), ("realtime", 8, 1));
    assert!((run.tracks[2][3].x_m - 2.2).abs() < 1e-12);
    assert_eq!((run.tracks[0][0].error_m, run.tracks[1][0].error_m), (Some(0.1), None));
    assert!(!run.tracks[1][4].is_alive);
    let death = &run.scene.faults[0];
    assert_eq!((death.t_s, death.until_s, &death.robots[..]), (2.0, Some(4.0), &[1][..]));
    let cut = &run.scene.faults[1];
    assert_eq!((cut.t_s, cut.until_s, cut.cuts), (5.0, Some(6.0), Some(0)));
    let freeze = &run.scene.faults[2];
    assert_eq!((freeze.t_s, freeze.until_s), (6.0, Some(6.5)));
    assert_eq!(
        (freeze.what.as_str(), freeze.robots.len()),
        ("freeze plant, by another process", 0)
    );
    let frozen = NewState::Robot(2, RobotState::Frozen);
    assert!(run.state_changes.iter().any(|change| change.t_s == 5.0 && change.new_state == frozen));
    let orphaned = NewState::Robot(0, RobotState::Orphaned);
    assert!(
        run.state_changes.iter().any(|change| change.t_s == 4.5 && change.new_state == orphaned)
    );
    let leads = NewState::Leads(0, true);
    assert!(run.state_changes.iter().any(|change| change.t_s == 4.6 && change.new_state == leads));
    let stale = NewState::Edge(1, EdgeState::Stale);
    assert!(run.state_changes.iter().any(|change| change.t_s == 3.0 && change.new_state == stale));
    assert_eq!(run.latency_over_time[0].from.as_deref(), Some("r1"));
    assert_eq!(
        (
            run.latency_distributions[0].robot_or_edge.as_str(),
            run.latency_distributions[0].exceedance.len()
        ),
        ("r1->r2", 2)
    );
    assert_eq!(run.latency_distributions[0].exceedance[1].1, 0.0, "no sample is above the maximum");
}

#[test]
fn error_components_are_the_recorded_ones() {
    let folder = tempfile::tempdir().unwrap();
    let run = load_run(&write_example_run(folder.path()), &row_of_three()).unwrap();
    let components = [0, 1].map(|robot| run.tracks[robot][0].error_xy_m);
    assert_eq!(components, [Some([0.06, -0.08]), None]);
}

#[test]
fn events_without_columns_for_edges_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_example_run(folder.path());
    let events = "t_s,kind,robot,detail\n2,kill,r2,\"SIGKILL, as planned\"\n2.5,freeze,r2,no process to stop\n\
                  3,contact,r3,stale r2\n4.6,repair,r1,leads\n5,freeze,r3,\"SIGSTOP, as planned\"\n";
    fs::write(path.join("events.csv"), events).unwrap();
    let run = load_run(&path, &row_of_three()).unwrap();
    let change = |t_s, robot, state| StateChange { t_s, new_state: NewState::Robot(robot, state) };
    let expected = [change(2.0, 1, RobotState::Dead), change(5.0, 2, RobotState::Frozen)];
    assert_eq!(run.state_changes, expected, "only robots' states are known");
    assert_eq!(run.repair_events, [(4.6, "r1".to_owned(), "leads".to_owned())]);
    assert!(write_page(&path, &row_of_three(), None).is_ok());
}

#[test]
fn killed_run_gets_a_report_of_its_written_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_example_run(folder.path());
    let samples = fs::read(path.join("samples.csv")).unwrap();
    fs::write(path.join("samples.csv"), &samples[..samples.len() - 40]).unwrap();
    for name in ["summary.json", "latency.hlog", "latency_over_time.csv"] {
        fs::remove_file(path.join(name)).unwrap();
    }
    let run = load_run(&path, &row_of_three()).unwrap();
    assert_eq!(run.times_s.len(), 7, "the last instant was incomplete");
    let WrittenPage { path, cut_short_note, is_checked, .. } =
        write_page(&path, &row_of_three(), None).unwrap();
    assert_eq!((cut_short_note, is_checked), (Some(CUT_SHORT_NOTE), false));
    assert!(fs::read_to_string(path).unwrap().contains("cut short"));
}

#[test]
fn summary_without_the_section_of_wall_times_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_example_run(folder.path());
    let wall = |summary: &str| {
        fs::write(path.join("summary.json"), summary).unwrap();
        load_run(&path, &row_of_three()).unwrap().summary.unwrap().wall
    };
    let section = r#""wall_s": 3.5, "processes": [{ "name": "r1", "starts": 2 }]"#;
    let current = wall(&format!(r#"{{ "t_s": 1.0, "wall": {{ {section} }} }}"#));
    assert_eq!((current.wall_s, current.processes[0].starts), (3.5, 2));
    assert_eq!(wall(&format!(r#"{{ "t_s": 1.0, {section} }}"#)), current);
}

#[test]
fn invalid_table_line_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_example_run(folder.path());
    let text = fs::read_to_string(path.join("samples.csv")).unwrap();
    for (from, to, expected) in [
        ("1,r2,", "1,r9,", "samples.csv:6: \"r9\" is no robot of scenario.toml"),
        ("1,r2,", "1,r1,", "samples.csv:6: \"r1\" occurs twice at one time"),
        ("2,r1,0.1,", "2,r1,0.1m,", "samples.csv:8: field 2: invalid float literal"),
        ("2,r1,0.1,", "2,r1,", "samples.csv:8: has 14 fields, expected 15"),
        ("2,r2,", "3,r2,", "samples.csv:9: the time changes, but 2 robots have no sample yet"),
        ("t_s,robot", "t,robot", "missing field `t_s`"),
    ] {
        let broken = text.replacen(&format!("\n{from}"), &format!("\n{to}"), 1);
        let broken = if from.starts_with('t') { text.replacen(from, to, 1) } else { broken };
        assert_ne!(broken, text);
        fs::write(path.join("samples.csv"), broken).unwrap();
        let error = write_page(&path, &row_of_three(), None).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn samples_without_the_columns_of_later_versions_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_example_run(folder.path());
    let last_sample =
        |path: &Path| load_run(path, &row_of_three()).unwrap().tracks[1].last().copied();
    let current = last_sample(&path).unwrap();
    assert_eq!(current.ideal_error_m, Some(0.2));
    let text = fs::read_to_string(path.join("samples.csv")).unwrap();
    // The newer columns are the last six.
    let old_text = text.lines().map(|line| format!("{}\n", line.rsplitn(7, ',').last().unwrap()));
    fs::write(path.join("samples.csv"), old_text.collect::<String>()).unwrap();
    assert_eq!(last_sample(&path), Some(RobotSample { ideal_error_m: None, ..current }));
}

#[test]
fn command_is_shell_quoted_and_times_are_dates() {
    let read = |name: &str, value: serde_json::Value| format_manifest_entry(name, &value);
    let command = serde_json::json!(["phalanx", "--set", "expect={}", "kill r4 @6", "it's"]);
    let expected = r"phalanx --set 'expect={}' 'kill r4 @6' 'it'\''s'";
    assert_eq!(read("command", command), ("command".to_owned(), expected.to_owned()));
    let (name, epoch) = read("epoch_unix_ns", LOCKSTEP_EPOCH_UNIX_NS.into());
    assert_eq!(name, "epoch");
    assert!(epoch.starts_with("2000-01-01 00:00:00 UTC, as of every run in lockstep"), "{epoch}");
    assert_eq!(read("cores", 2.into()), ("cores".to_owned(), "2".to_owned()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// For any damage there is a report, or an error that names the file.
    #[test]
    fn randomly_damaged_run_directory_is_drawn_or_refused(
        file in 0..FILES.len(),
        is_truncated in any::<bool>(),
        changed_bytes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = write_example_run(folder.path());
        let name = FILES[file];
        let mut bytes = fs::read(path.join(name)).unwrap();
        for (at, byte) in &changed_bytes {
            let at = at.index(bytes.len());
            bytes[at] = *byte;
        }
        if is_truncated {
            bytes.truncate(changed_bytes[0].0.index(bytes.len()));
        }
        fs::write(path.join(name), bytes).unwrap();
        if let Err(error) = write_page(&path, &row_of_three(), None) {
            prop_assert!(error.to_string().contains(name), "{error}");
        }
    }
}
