//! ROS 2 receives the messages of a run and sends goals to robots. The peer is a program that implements the protocol
//! of rmw_zenoh without ROS; `tests/ros2/install` installs it into target/ros2.

use crate::harness::run;

#[test]
fn ros2_option_in_lockstep_is_refused() {
    let ended = run("triangle").lockstep().args(["--ros2"]).finish();
    ended.exits_with(2).assert_holds(
        ended.stderr.contains("--ros2 requires --pace realtime"),
        "the error names real time",
    );
}

#[cfg(not(feature = "bridge"))]
#[test]
fn missing_feature_is_reported_with_the_build_command() {
    let ended = run("triangle").args(["--ros2"]).finish();
    ended.exits_with(2).assert_holds(
        ended.stderr.contains("--features bridge"),
        "the error has the build command",
    );
}

#[cfg(feature = "bridge")]
mod with_bridge {
    use std::io::{BufRead as _, BufReader, Lines, Write as _};
    use std::net::TcpListener;
    use std::path::Path;
    use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

    use rustix::process::Signal;

    use crate::harness::{Phalanx, RunInProgress, run, signal_pid};

    const ROOT: &str = env!("CARGO_MANIFEST_DIR");
    const ROBOTS: [&str; 3] = ["r1", "r2", "r3"];
    /// Number of messages of each robot that are received.
    const SAMPLES: &str = "250";

    /// Process of a program in tests/ros2. It is killed when it is dropped.
    struct Python {
        process: Child,
        output: Lines<BufReader<ChildStdout>>,
        input: ChildStdin,
    }

    impl Python {
        fn start<'a>(script: &str, args: impl IntoIterator<Item = &'a str>) -> Python {
            let python = Path::new(ROOT).join("target/ros2/bin/python");
            assert!(python.exists(), "run tests/ros2/install first");
            let mut process = Command::new(python)
                .arg(Path::new(ROOT).join("tests/ros2").join(script))
                .args(args)
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .unwrap();
            let output = BufReader::new(process.stdout.take().unwrap()).lines();
            let input = process.stdin.take().unwrap();
            Python { process, output, input }
        }

        /// Reads the next line, which must have this prefix, and returns the rest of it.
        fn read_line(&mut self, begins: &str) -> String {
            let line = self.output.next().and_then(Result::ok);
            let line = line.unwrap_or_else(|| panic!("it ended without saying {begins:?}"));
            assert!(line.starts_with(begins), "{line}");
            line[begins.len()..].to_owned()
        }
    }

    impl Drop for Python {
        fn drop(&mut self) {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
    }

    /// Returns a port that was free just now.
    fn port() -> u16 {
        TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
    }

    /// Checks 250 messages of each robot: no gap, and every number as in the tables of the run.
    fn assert_every_message_received(router: &str, domain: &str, endpoint: impl Fn(u16) -> String) {
        let port = port();
        let number = port.to_string();
        let args = [number.as_str(), domain, SAMPLES, router].into_iter().chain(ROBOTS);
        let mut reader = Python::start("hear.py", args);
        let ros2 = format!("--ros2={}", endpoint(port));
        // The table has a row for every ground-truth sample: received messages must be among them.
        let running = run("triangle")
            .set("duration_s=100")
            .set("expect={}")
            .set("record_hz=1e6")
            .args([ros2.as_str(), "--ros2-domain", domain])
            .start();
        reader.read_line("ready");
        reader.read_line("heard");
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130);
        writeln!(reader.input, "{}", ended.run_dir().display()).unwrap();
        println!("{}", reader.read_line("held: "));
        ended.assert_leaves_nothing();
    }

    #[test]
    #[ignore = "needs tests/ros2/install"]
    fn listening_run_publishes_every_message_correctly() {
        assert_every_message_received("ours", "7", |port| format!("listen/127.0.0.1:{port}"));
    }

    #[test]
    #[ignore = "needs tests/ros2/install"]
    fn router_connected_run_publishes_all_messages_correctly() {
        assert_every_message_received("theirs", "0", |port| format!("127.0.0.1:{port}"));
    }

    /// Checks that the ROS 2 process is restarted after its death, and that the run continues unchanged.
    #[test]
    fn ros_process_is_restarted_and_no_robot_needs_it() {
        let endpoint = format!("--ros2=listen/127.0.0.1:{}", port());
        let mut running = run("triangle")
            .set("duration_s=100")
            .set("expect={}")
            .args([endpoint.as_str()])
            .start();
        running.wait_for("a robot that takes part", |run| {
            run.events().contains(",ready,").then_some(())
        });
        let pid = running.pid_of("ros2");
        signal_pid(pid, Signal::KILL);
        running.wait_for_event("ros2-died");
        running.wait_for("another", |run| {
            run.children().into_iter().find(|(other, name)| name == "ros2" && *other != pid)
        });
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        let events = ended.file("events.csv");
        ended.assert_holds(!events.contains(",died,"), "no robot died");
    }

    #[test]
    fn occupied_port_is_reported_before_the_start() {
        let occupied = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = occupied.local_addr().unwrap();
        let ended = run("triangle").args([format!("--ros2=listen/{address}").as_str()]).finish();
        ended
            .exits_with(4)
            .assert_holds(
                ended.stderr.contains(&format!("cannot listen at {address}")),
                "the error names the address",
            )
            .assert_holds(!ended.run_dir().exists(), "nothing was written");
    }

    /// Minimum distance (d) of the scene with goals, and distance of the front point ahead of the axle, m.
    const D_M: f64 = 0.42;
    /// Distance of the front point ahead of the axle there (ell), m.
    const ELL_M: f64 = 0.1;

    /// Returns front point and error, m, from the newest complete row of a robot in `samples.csv`.
    fn newest_sample_row(run: &RunInProgress, robot: &str) -> Option<([f64; 2], f64)> {
        let text = std::fs::read_to_string(run.run_dir().join("samples.csv")).ok()?;
        let (complete_rows, _) = text.rsplit_once('\n')?;
        let mut rows = complete_rows.lines().rev().map(|line| line.split(',').collect::<Vec<_>>());
        let row = rows.find(|row| row[1] == robot)?;
        let number = |column: usize| row[column].parse::<f64>().ok();
        let (x_m, y_m, heading_rad) = (number(2)?, number(3)?, number(4)?);
        let front = [x_m + ELL_M * heading_rad.cos(), y_m + ELL_M * heading_rad.sin()];
        Some((front, number(7)?))
    }

    /// Waits until a robot is at a position and its error is small.
    fn arrives(running: &mut RunInProgress, robot: &str, [x_m, y_m]: [f64; 2]) {
        running.wait_for(&format!("{robot} at its goal"), |run| {
            let ([front_x_m, front_y_m], error_m) = newest_sample_row(run, robot)?;
            let distance_m = (front_x_m - x_m).hypot(front_y_m - y_m);
            (distance_m < 0.02 && error_m < 0.02).then_some(())
        });
    }

    /// Returns the details of a robot's events of this kind.
    fn details(events: &str, kind: &str, robot: &str) -> Vec<String> {
        let of_kind = |line: &str| {
            let (_, found, event_robot, detail) = crate::harness::event_cells(line)?;
            (found == kind && event_robot == robot).then(|| detail.to_owned())
        };
        events.lines().filter_map(of_kind).collect()
    }

    /// Checks that robots go to goals from ROS 2, also after a death of their process. Invalid goals are counted and
    /// have no effect. Two robots with the same goal keep their distance.
    #[test]
    #[ignore = "needs tests/ros2/install"]
    fn robots_follow_ros_goals_and_keep_their_distance() {
        let port = port();
        let ros2 = format!("--ros2=listen/127.0.0.1:{port}");
        let mut command = Command::new(env!("CARGO_BIN_EXE_phalanx"));
        command.args(["run", "tests/ros2/court.toml", &ros2, "--ros2-domain", "3"]);
        let mut running = Phalanx::new(command).start();
        let mut sender = Python::start("go.py", [port.to_string().as_str(), "3"]);
        let mut send = |line: &str| {
            writeln!(sender.input, "{line}").unwrap();
            sender.read_line("sent");
        };
        send("r1 -0.5 1.2");
        running.wait_for_event("goal");
        // One invalid goal of each kind; no robot may move.
        send("r1 0 0 odom");
        send("r1 nan 0");
        send("r1 1e10 0");
        send("r1 5 0");
        send("r1 0 1.9");
        send("r1 bytes 00010000ffffffff");
        arrives(&mut running, "r1", [-0.5, 1.2]);

        // A robot whose process dies on its way: the new process receives the goal.
        send("r1 -0.9 1.2");
        running.wait_for("the second goal", |run| {
            (details(&run.events(), "goal", "r1").len() == 2).then_some(())
        });
        let pid = running.pid_of("r1");
        signal_pid(pid, Signal::KILL);
        running.wait_for_event("restart");
        running.wait_for("another r1", |run| {
            run.children().into_iter().find(|(other, name)| name == "r1" && *other != pid)
        });
        arrives(&mut running, "r1", [-0.9, 1.2]);

        // Both robots have the same goal.
        send("r3 -1.5 -0.1");
        send("r4 -1.5 0.1");
        running.wait_for("two beside each other", |run| {
            let error_m = |robot| newest_sample_row(run, robot).map(|(_, error_m)| error_m);
            let sent = |robot| !details(&run.events(), "goal", robot).is_empty();
            let are_near = error_m("r3")?.max(error_m("r4")?) < D_M;
            (sent("r3") && sent("r4") && are_near).then_some(())
        });
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        let events = ended.file("events.csv");
        let sent = details(&events, "goal", "r1");
        ended
            .assert_holds(
                sent.first().is_some_and(|detail| detail == "to -0.5 1.2 m, from ros2")
                    && sent.last().is_some_and(|detail| detail == "to -0.9 1.2 m, from ros2"),
                format!("r1 was sent there, found {sent:?}"),
            )
            .assert_holds(
                details(&events, "goal", "r3") == ["to -1.5 -0.1 m, from ros2"],
                "so was r3, once",
            )
            .assert_holds(details(&events, "goal", "r2").is_empty(), "r2 goes to its own goal")
            .assert_keeps_d()
            .assert_holds(ended.number("/wall/goals/taken") == 4.0, "four goals were taken");
        let refused = &ended.summary["wall"]["goals"]["refused"];
        let expected = ["layout", "not-finite", "frame", "far", "outside", "blocked"];
        let is_counted_once = |why: &&str| refused[why] == 1;
        ended.assert_holds(
            expected.iter().all(is_counted_once)
                && refused.as_object().is_some_and(|all| all.len() == 6),
            format!("one of each was refused, found {refused}"),
        );
    }

    /// Checks that a robot without a goal subscribes to none, and that no goal is counted.
    #[test]
    fn robots_without_goals_receive_no_goals() {
        let port = port();
        let ros2 = format!("--ros2=listen/127.0.0.1:{port}");
        let mut running = run("triangle")
            .set("duration_s=100")
            .set("expect={}")
            .args([ros2.as_str(), "--ros2-domain", "3"])
            .start();
        running.wait_for_event("ready");
        running.signal(Signal::INT);
        let ended = running.finish();
        ended
            .exits_with(130)
            .assert_holds(ended.summary["wall"].get("goals").is_none(), "no goals");
        let brief = ended.file("briefs/r1.toml");
        ended.assert_holds(brief.contains("goals_from_outside = false"), "it opens no such topic");
    }
}
