//! ROS 2 hears a run, as a reader of others sees it that knows the wire of rmw_zenoh: `tests/ros2/install`
//! puts it into target/ros2. There is no ROS in it.

use crate::harness::run;

#[test]
fn in_lockstep_ros_hears_nothing_and_that_is_said() {
    let ended = run("triangle").lockstep().args(["--ros2"]).finish();
    ended.exits_with(2).claim(
        ended.stderr.contains("--ros2 is for --pace realtime"),
        "it is told that this is for real time",
    );
}

#[cfg(not(feature = "bridge"))]
#[test]
fn without_the_feature_it_is_said_how_to_build_with_it() {
    let ended = run("triangle").args(["--ros2"]).finish();
    ended
        .exits_with(2)
        .claim(ended.stderr.contains("--features bridge"), "it is told how to build it");
}

#[cfg(feature = "bridge")]
mod with_bridge {
    use std::io::{BufRead as _, BufReader, Lines, Write as _};
    use std::net::TcpListener;
    use std::path::Path;
    use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

    use rustix::process::Signal;

    use crate::harness::run;

    const ROOT: &str = env!("CARGO_MANIFEST_DIR");
    const ROBOTS: [&str; 3] = ["r1", "r2", "r3"];
    /// Of each robot.
    const SAMPLES: &str = "250";

    /// The reader, a process that ends with this.
    struct Reader {
        process: Child,
        says: Lines<BufReader<ChildStdout>>,
        asks: ChildStdin,
    }

    impl Reader {
        fn start(port: u16, domain: &str, router: &str) -> Reader {
            let python = Path::new(ROOT).join("target/ros2/bin/python");
            assert!(python.exists(), "run tests/ros2/install first");
            let mut process = Command::new(python)
                .arg(Path::new(ROOT).join("tests/ros2/hear.py"))
                .args([&port.to_string(), domain, SAMPLES, router])
                .args(ROBOTS)
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .unwrap();
            let says = BufReader::new(process.stdout.take().unwrap()).lines();
            let asks = process.stdin.take().unwrap();
            Reader { process, says, asks }
        }

        /// The rest of its next line, which begins so.
        fn says(&mut self, begins: &str) -> String {
            let line = self.says.next().and_then(Result::ok);
            let line = line.unwrap_or_else(|| panic!("it ended without saying {begins:?}"));
            assert!(line.starts_with(begins), "{line}");
            line[begins.len()..].to_owned()
        }
    }

    impl Drop for Reader {
        fn drop(&mut self) {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
    }

    /// Free a moment ago.
    fn port() -> u16 {
        TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
    }

    /// 250 messages of each robot, no gap, and every number as in the run's own tables.
    fn hears_every_message(router: &str, domain: &str, endpoint: impl Fn(u16) -> String) {
        let port = port();
        let mut reader = Reader::start(port, domain, router);
        let ros2 = format!("--ros2={}", endpoint(port));
        // Every truth is a row: what was heard must be among them.
        let running = run("triangle")
            .set("duration_s=100")
            .set("expect={}")
            .set("record_hz=1e6")
            .args([ros2.as_str(), "--ros2-domain", domain])
            .start();
        reader.says("ready");
        reader.says("heard");
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130);
        writeln!(reader.asks, "{}", ended.run_dir().display()).unwrap();
        println!("{}", reader.says("held: "));
        ended.leaves_nothing();
    }

    #[test]
    #[ignore = "needs tests/ros2/install"]
    fn a_run_that_listens_is_heard_whole_and_right() {
        hears_every_message("ours", "7", |port| format!("listen/127.0.0.1:{port}"));
    }

    #[test]
    #[ignore = "needs tests/ros2/install"]
    fn a_run_that_connects_to_a_router_is_heard_whole_and_right() {
        hears_every_message("theirs", "0", |port| format!("127.0.0.1:{port}"));
    }

    /// Whoever listens dies: another is started, and the run goes on as if nothing had happened.
    #[test]
    fn the_process_for_ros_is_started_anew_and_no_robot_needs_it() {
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
        crate::harness::signal_pid(pid, Signal::KILL);
        running.wait_for_event("ros2-died");
        running.wait_for("another", |run| {
            run.children().into_iter().find(|(other, name)| name == "ros2" && *other != pid)
        });
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130).leaves_nothing();
        let events = ended.file("events.csv");
        ended.claim(!events.contains(",died,"), "no robot died");
    }

    #[test]
    fn a_port_that_is_taken_is_told_before_anything_is_started() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = taken.local_addr().unwrap();
        let ended = run("triangle").args([format!("--ros2=listen/{address}").as_str()]).finish();
        ended
            .exits_with(4)
            .claim(ended.stderr.contains(&format!("cannot listen at {address}")), "it is told")
            .claim(!ended.run_dir().exists(), "nothing was written");
    }
}
