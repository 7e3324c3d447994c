//! The pages in a real browser, tested by `tests/browser/*.py` after `tests/browser/install`.
//!
//! Writes the pages of a synthetic run, of which every frame is known, and passes them to the scripts together with the
//! binary that writes the pages of real runs.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use formation::obstacle::Obstacle;
use outcome::report::page;
use outcome::report::scene::{
    EdgeState, FrameRobot, RobotState, Scene, SceneEdge, SceneFault, SceneFrame, SceneRobot,
};

/// Deadline of all browser tests together, which take a minute or two. Only a hang reaches it.
const TIMEOUT: Duration = Duration::from_secs(900);

const DURATION_S: u32 = 20;
const FRAMES_PER_S: u32 = 20;
const FRONT_POINT_M: f64 = 0.045;
/// Edges of the graph: sender and receiver.
const EDGES: [(usize, usize); 3] = [(0, 1), (1, 2), (2, 0)];

/// Returns the scene of three robots. The name of the last one is markup unless it is escaped.
fn scene() -> Scene {
    let robot = |name: &str, role: &str| SceneRobot {
        name: name.into(),
        role: role.into(),
        front_point_m: FRONT_POINT_M,
        keep_m: None,
    };
    let fault = |what: &str, robot, t_s, until_s| SceneFault {
        t_s,
        until_s: Some(until_s),
        what: what.into(),
        robots: vec![robot],
        cuts: None,
    };
    Scene {
        name: "made up & <b>bold</b>".into(),
        pace: "realtime".into(),
        duration_s: f64::from(DURATION_S),
        distance_min_m: 0.2,
        robots: vec![
            robot("r1", "main-leader"),
            robot("r2", "formation"),
            robot("<img src=x onerror=alert(1)>", "contained"),
        ],
        edges: EDGES.map(|(from, to)| SceneEdge { from, to, ..SceneEdge::default() }).to_vec(),
        walls: vec![
            Obstacle::segment([-0.8, -0.9], [0.9, -0.9]),
            Obstacle::Disc { center_m: [0.0, 0.0], radius_m: 0.05 },
        ],
        faults: vec![fault("kill r2", 1, 5.0, 8.0), fault("freeze r1", 0, 10.0, 12.0)],
        faults_in_all: 0,
    }
}

/// Returns a frame of the synthetic run. The robots drive on a circle, which narrows around 14.5 s until they are
/// closer than d. r2 is dead from 5 s, its replacement starts at 7.5 s and moves from 8 s; r1 is frozen from 10 s to 12
/// s, and the edge to it is cut from 17 s to 18 s.
fn frame(step: u32) -> SceneFrame {
    let t_s = f64::from(step) / f64::from(FRAMES_PER_S);
    let narrowing =
        if (13.0..16.0).contains(&t_s) { (TAU / 6.0 * (t_s - 13.0)).sin() } else { 0.0 };
    let radius_m = 0.3 - 0.2 * narrowing.powi(2);
    let robot = |index: usize| {
        let (state, stood_s) = match index {
            0 if (10.0..12.0).contains(&t_s) => (RobotState::Frozen, t_s - 10.0),
            0 if t_s >= 12.0 => (RobotState::Moving, 2.0),
            1 if (5.0..7.5).contains(&t_s) => (RobotState::Dead, t_s - 5.0),
            1 if (7.5..8.0).contains(&t_s) => (RobotState::Starting, t_s - 5.0),
            1 if t_s >= 8.0 => (RobotState::Moving, 3.0),
            _ => (RobotState::Moving, 0.0),
        };
        let angle = 0.2 * (t_s - stood_s) + TAU * index as f64 / 3.0;
        let heading = angle + TAU / 4.0;
        FrameRobot {
            x_m: radius_m * angle.cos() - FRONT_POINT_M * heading.cos(),
            y_m: radius_m * angle.sin() - FRONT_POINT_M * heading.sin(),
            heading_rad: heading.sin().atan2(heading.cos()),
            error_m: Some((-t_s / 3.0).exp()),
            state,
        }
    };
    let robots: Vec<_> = (0..3).map(robot).collect();
    let front = |robot: &FrameRobot| {
        let (sine, cosine) = robot.heading_rad.sin_cos();
        (robot.x_m + FRONT_POINT_M * cosine, robot.y_m + FRONT_POINT_M * sine)
    };
    let distance = |(a, b): (usize, usize)| {
        let (a, b) = (front(&robots[a]), front(&robots[b]));
        (a.0 - b.0).hypot(a.1 - b.1)
    };
    let distance_m = EDGES.map(distance).into_iter().reduce(f64::min);
    let edge_states = match t_s {
        _ if (10.05..10.2).contains(&t_s) => [EdgeState::Stale, EdgeState::Fresh, EdgeState::Fresh],
        _ if (10.2..12.0).contains(&t_s) => [EdgeState::Lost, EdgeState::Fresh, EdgeState::Fresh],
        _ => [EdgeState::Fresh; 3],
    };
    let edge = |(index, (from, to)): (usize, (usize, usize))| {
        let is_cut = index == 2 && (17.0..18.0).contains(&t_s);
        edge_states[index].combine([robots[from].state, robots[to].state], is_cut)
    };
    let edges = EDGES.into_iter().enumerate().map(edge).collect();
    SceneFrame { t_s, robots, edges, distance_m }
}

fn write_pages(folder: &Path) {
    let scene = scene();
    let frames: Vec<_> = (0..=DURATION_S * FRAMES_PER_S).map(frame).collect();
    let replay = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{}\">\
         <title>Replay</title></head><body>{}</body></html>",
        page::content_security_policy(),
        page::replay_html(&scene, &frames)
    );
    fs::write(folder.join("replay.html"), replay).unwrap();
    fs::write(folder.join("live.html"), page::live_html(&scene, false)).unwrap();
    fs::write(folder.join("control.html"), page::live_html(&scene, true)).unwrap();
    fs::write(folder.join("scene.json"), serde_json::to_string(&scene).unwrap()).unwrap();
    fs::write(folder.join("frames.json"), serde_json::to_string(&frames).unwrap()).unwrap();
}

#[test]
#[ignore = "needs a browser: tests/browser/install"]
fn report_and_live_page_work_in_a_browser() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let pages = tempfile::tempdir().unwrap();
    let run_root = tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap();
    write_pages(pages.path());
    let python = root.join("target/browser/bin/python");
    assert!(python.exists(), "{} is missing: run tests/browser/install", python.display());
    let mut tests = Command::new(python)
        .args(["-B", "-m", "pytest", "-p", "no:cacheprovider", "tests/browser"])
        .current_dir(root)
        .env("PAGES", pages.path())
        .env("PHALANX", env!("CARGO_BIN_EXE_phalanx"))
        .env("PHALANX_RUN_ROOT", run_root.path())
        .env("SHOTS", root.join("target/browser-shots"))
        .spawn()
        .unwrap();
    let start = Instant::now();
    let ended = loop {
        if let Some(status) = tests.try_wait().unwrap() {
            break Some(status);
        }
        if start.elapsed() > TIMEOUT {
            tests.kill().unwrap();
            tests.wait().unwrap();
            break None;
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(ended.is_some_and(|status| status.success()), "the browser tests ended with {ended:?}");
}
