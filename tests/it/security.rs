//! Only the user of a run has access to it, and garbage messages from inside of the run move no robot.

use std::cell::Cell;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use protocol::clock::now_ns;
use protocol::message::{self, Beacon};
use protocol::service::send_slice;
use protocol::{run_root, service};

use crate::harness::{FinishedRun, RunInProgress, files_below, run};

/// User id of `nobody`, a user without access.
const OTHER_USER_ID: u32 = 65534;

#[test]
fn no_other_user_can_open_any_file_of_a_run_under_way() {
    let mut running = run("triangle").set("duration_s=60").set("expect={}").start();
    // The run itself must be protected.
    let run_root_dir = running.run_root().to_path_buf();
    std::fs::set_permissions(&run_root_dir, std::fs::Permissions::from_mode(0o755)).unwrap();
    running.wait_for_event("contact");
    let mode = |path: &PathBuf| path.symlink_metadata().unwrap().permissions().mode() & 0o7777;
    let root = root_of(&running);
    let base = root.parent().unwrap().to_path_buf();
    assert_eq!((mode(&base), mode(&root)), (0o700, 0o700));
    assert_eq!(mode(&run_root::config_path(&root)), 0o600);
    if !rustix::process::geteuid().is_root() {
        return; // no other user to compare with
    }
    let paths = files_below(&run_root_dir);
    let memory = paths.iter().filter(|path| path.extension().is_some_and(|end| end == "data"));
    assert!(memory.count() > 10, "{paths:?}");
    let script = r#"for path; do
        { ls "$path/" || cat "$path" || (: >>"$path"); } >/dev/null 2>&1 && echo "opened $path"
    done; true"#;
    let mut stranger = Command::new("sh");
    stranger.args(["-c", script, "sh", "/dev/shm", "/proc/version"]).args(&paths);
    let output = stranger.current_dir("/").uid(OTHER_USER_ID).gid(OTHER_USER_ID).output().unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout);
    // The first two are readable by all users, and show that the program tried.
    assert_eq!(stdout, "opened /dev/shm\nopened /proc/version\n", "{output:?}");
    assert!(paths.len() > 100, "{paths:?}");
}

/// Returns whether the kernel randomizes the addresses of a process.
fn has_random_addresses(pid: u32) -> bool {
    let personality = std::fs::read_to_string(format!("/proc/{pid}/personality")).unwrap();
    let personality = u32::from_str_radix(personality.trim(), 16).unwrap();
    personality & libc::ADDR_NO_RANDOMIZE as u32 == 0
}

/// Checks address randomization by process. A process may disable it, except in some containers.
#[test]
fn addresses_are_random_except_for_lockstep_robots() {
    let can_fix_addresses = Command::new("setarch").args(["--addr-no-randomize", "true"]).status();
    let can_fix_addresses = can_fix_addresses.is_ok_and(|status| status.success());
    for pace in ["realtime", "lockstep"] {
        let triangle = run("triangle").args(["--pace", pace]).set("duration_s=3600");
        let mut running = triangle.set("record_hz=1").start();
        running.wait_for_event("contact");
        assert!(has_random_addresses(running.pid()), "the supervisor's, {pace}");
        for (pid, name) in running.children() {
            let is_random = has_random_addresses(pid);
            let is_fixed = can_fix_addresses && pace == "lockstep" && name != "plant";
            assert_eq!(is_random, !is_fixed, "those of {name}, {pace}");
        }
    }
}

const SECOND_NS: u64 = 1_000_000_000;

/// Returns beacons that must be refused: in each round, another number is not finite.
fn bad_beacons(number: f64, fresh_ns: u64) -> [Beacon; 7] {
    let valid = Beacon { stamp_ns: fresh_ns, x_m: 0.1, y_m: 0.1, ..Beacon::default() };
    [
        Beacon { x_m: number, ..valid },
        Beacon { vy_m_s: number, ..valid },
        Beacon { frame_known: 1, frame_turn_rate_rad_s: number, ..valid },
        Beacon { stamp_ns: fresh_ns + 3600 * SECOND_NS, ..valid },
        Beacon { stamp_ns: u64::MAX, ..valid },
        Beacon { stamp_ns: 0, ..valid },
        Beacon { incarnation: u64::MAX, ..valid },
    ]
}

/// Returns commands that must be refused.
fn bad_commands(number: f64, fresh_ns: u64) -> [message::Command; 6] {
    let (sequence, v_m_s, w_rad_s) = (u64::MAX, 0.3, 1.0);
    let stamp_ns = fresh_ns;
    let moving =
        message::Command { stamp_ns, sequence, v_m_s, w_rad_s, ..message::Command::default() };
    [
        message::Command { v_m_s: number, ..moving },
        message::Command { w_rad_s: number, ..moving },
        message::Command { stamp_ns: fresh_ns + 3600 * SECOND_NS, ..moving },
        message::Command { stamp_ns: u64::MAX, ..moving },
        message::Command { stamp_ns: fresh_ns - SECOND_NS, ..moving },
        message::Command { incarnation: u64::MAX, ..moving },
    ]
}

/// Checks all invalid messages in one run and one process, because iceoryx2's configuration is process-wide.
#[test]
fn well_typed_garbage_moves_no_robot_and_is_counted() {
    let mut running = run("triangle")
        .set("duration_s=8")
        .set("expect={}")
        .set("silence.policy=ignore")
        .fault("kill r1 @1.5 restart 0.5")
        .fault("kill r2 @4")
        .start();
    running.wait_for_event("contact");
    run_root::join(&root_of(&running)).unwrap();
    let node = service::create_node("hostile").unwrap();
    let beacon = service::beacon_topic("r2").open(&node).unwrap().publisher(0).unwrap();
    let open = |robot: &str| service::command_topic(robot).open(&node).unwrap();
    let publisher_r1 = open("r1").publisher().unwrap();
    let publisher_r2 = open("r2").publisher().unwrap();
    let full = open("r2").publisher().unwrap_err().to_string();
    assert!(full.contains("one sender and its replacement"), "{full}");

    let rounds = Cell::new(0);
    let pause = || std::thread::sleep(Duration::from_micros(100));
    let publish = |r1_is_new: bool| {
        let numbers = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300];
        let number = numbers[rounds.replace(rounds.get() + 1) % numbers.len()];
        let fresh_ns = now_ns() - SECOND_NS / 1000;
        for garbage in bad_beacons(number, fresh_ns) {
            send_slice(&beacon, garbage, 0, |_| 0).unwrap();
            pause();
        }
        for garbage in bad_commands(number, fresh_ns) {
            publisher_r1.send_copy(garbage).unwrap();
            publisher_r2.send_copy(garbage).unwrap();
            pause();
        }
        if r1_is_new {
            // From the incarnation that died.
            let (stamp_ns, sequence) = (fresh_ns, u64::MAX);
            let old = message::Command { stamp_ns, sequence, ..message::Command::default() };
            publisher_r1.send_copy(old).unwrap();
            pause();
        }
    };
    running.wait_for("the new r1", |run| {
        publish(false);
        run.events().contains("ready,r1,incarnation 1").then_some(())
    });
    running.wait_for("the death of r2", |run| {
        publish(true);
        run.events().contains("died,r2").then_some(())
    });
    let dead_since = Instant::now();
    while dead_since.elapsed() < Duration::from_secs(3) {
        publish(true);
    }
    drop((beacon, publisher_r1, publisher_r2, node));
    assert_no_garbage_obeyed(&running.finish());
}

#[track_caller]
fn assert_no_garbage_obeyed(ended: &FinishedRun) {
    ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    for counter in ["not_finite", "late", "old"] {
        let count = ended.number(&format!("/commands/{counter}"));
        ended.assert_holds(count > 50.0, format!("commands are counted as {counter}"));
    }
    ended.assert_holds(ended.number("/commands/scaled") == 0.0, "none was obeyed after scaling");
    ended.assert_holds(
        ended.number("/beacons_refused/r1") > 100.0,
        "r1 refused the garbage it heard",
    );
    ended.assert_holds(ended.number("/beacons_refused/r3") == 0.0, "r3 heard none");
    // r2 is dead, and r1 receives only from r2. It yields if r3 comes near, by at most 0.05 d.
    for (robot, moved_m_max) in [("r1", 0.01), ("r2", 0.0)] {
        let moved_m = moved_m(&ended.file("samples.csv"), robot, 5.0);
        ended.assert_holds(
            moved_m <= moved_m_max,
            format!("{robot} must not move, and moved by {moved_m} m"),
        );
    }
}

/// Returns the maximum distance of a robot's axle from its position at `from_s`, m. NaN without samples.
fn moved_m(samples: &str, robot: &str, from_s: f64) -> f64 {
    let rows = samples.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let rows = rows.filter(|cells| cells[1] == robot);
    let numbers = rows.map(|cells| [0, 2, 3].map(|cell| cells[cell].parse::<f64>().unwrap()));
    let positions: Vec<[f64; 3]> = numbers.filter(|[t_s, ..]| *t_s >= from_s).collect();
    let Some([_, x, y]) = positions.first().copied() else { return f64::NAN };
    positions.iter().map(|[_, x_m, y_m]| (x_m - x).hypot(y_m - y)).fold(0.0, f64::max)
}

fn root_of(running: &RunInProgress) -> PathBuf {
    let files = files_below(running.run_root());
    files.into_iter().find(|path| path.join("iceoryx2.toml").exists()).expect("it has a run root")
}
