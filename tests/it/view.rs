//! The live view as a browser sees it: access control, the frames that it receives, and the effect of its buttons.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::{FinishedRun, Phalanx, RunInProgress, run};

/// Deadline of every wait. Only a hang reaches it.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Page of a run: address and token.
struct Page {
    host: String,
    token: String,
}

/// HTTP response: status, headers, body.
struct Answer {
    status: u16,
    headers: String,
    body: String,
}

impl Page {
    fn from_run(running: &mut RunInProgress) -> Page {
        let url = running.wait_for_line("view: ");
        let rest = url.strip_prefix("http://").unwrap();
        let (host, token) = rest.split_once("/?token=").unwrap();
        Page { host: host.into(), token: token.into() }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        stream
    }

    /// Sends a request, adds its last lines, and waits for the complete response.
    fn send_request(&self, head: &str, body: &str) -> Answer {
        let mut stream = self.connect();
        let length = body.len();
        write!(stream, "{head}\r\nContent-Length: {length}\r\n\r\n{body}").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (headers, body) = text.split_once("\r\n\r\n").unwrap();
        let status = headers.split(' ').nth(1).unwrap().parse().unwrap();
        Answer { status, headers: headers.to_lowercase(), body: body.into() }
    }

    /// Returns the head of a request with the token. Uses HTTP/1.0, so that the response ends with the connection.
    fn head(&self, method: &str, path: &str) -> String {
        let Page { host, token } = self;
        format!("{method} {path}?token={token} HTTP/1.0\r\nHost: {host}")
    }

    fn get(&self, path: &str) -> Answer {
        self.send_request(&self.head("GET", path), "")
    }

    /// Sends the request of a button. Returns the status, and the reason if it was refused.
    fn press(&self, order: Value) -> (u16, String) {
        let Page { host, .. } = self;
        let head = self.head("POST", "/control");
        let head = format!("{head}\r\nOrigin: http://{host}\r\nContent-Type: application/json");
        let answer = self.send_request(&head, &order.to_string());
        (answer.status, answer.body)
    }

    fn press_on(&self, act: &str, robot: &str) -> (u16, String) {
        self.press(json!({ "act": act, "robot": robot }))
    }

    fn press_on_link(&self, act: &str, from: &str, to: &str) -> (u16, String) {
        self.press(json!({ "act": act, "from": from, "to": to }))
    }

    fn events(&self) -> Events {
        let mut stream = self.connect();
        write!(stream, "{}\r\n\r\n", self.head("GET", "/events")).unwrap();
        let mut lines = BufReader::new(stream);
        let mut line = String::new();
        lines.read_line(&mut line).unwrap();
        assert!(line.contains(" 200 "), "{line}");
        while line != "\r\n" {
            line.clear();
            lines.read_line(&mut line).unwrap();
        }
        Events(lines)
    }
}

/// Event stream of a client.
struct Events(BufReader<TcpStream>);

impl Iterator for Events {
    type Item = (String, Value);

    /// Reads the next event. Its name is empty for a frame. `None` if the stream has ended.
    fn next(&mut self) -> Option<(String, Value)> {
        let (mut name, mut data) = (String::new(), None);
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            match line.trim_end().split_once(": ") {
                Some(("event", word)) => name = word.into(),
                Some(("data", json)) => data = Some(serde_json::from_str(json).unwrap()),
                // The end of an event, or a heartbeat.
                _ => {
                    if let Some(data) = data.take() {
                        return Some((name, data));
                    }
                }
            }
        }
    }
}

impl Events {
    /// Reads events until a frame satisfies `holds`, and returns it. Panics after some thousand events.
    #[track_caller]
    fn frame(&mut self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let frames = self.take(5000).filter(|(name, _)| name.is_empty());
        let found = frames.map(|(_, frame)| frame).find(|frame| holds(frame));
        found.unwrap_or_else(|| panic!("no frame shows {what}"))
    }

    #[track_caller]
    fn robot_is(&mut self, index: usize, state: &str) {
        self.frame(state, |frame| frame["robots"][index]["state"] == state);
    }

    #[track_caller]
    fn edge_is(&mut self, index: usize, state: &str) {
        self.frame(state, |frame| frame["edges"][index] == state);
    }

    #[track_caller]
    fn happens(&mut self, kind: &str, robot: &str) -> Value {
        let mut events = self.take(5000).filter(|(name, _)| name == "happened");
        let found = events.find(|(_, event)| event["kind"] == kind && event["robot"] == robot);
        found.unwrap_or_else(|| panic!("no event {kind} of {robot} was received")).1
    }
}

/// Starts a triangle in real time that runs until it is interrupted. r1 receives from r2, r2 from r3, and r3 from r1.
fn start_viewed_run(args: &[&str]) -> (RunInProgress, Page) {
    let triangle = run("triangle").set("duration_s=100").set("expect={}");
    let mut running = triangle.args(args.iter().copied()).start();
    let page = Page::from_run(&mut running);
    (running, page)
}

/// Interrupts a run in progress.
#[track_caller]
fn interrupted(running: RunInProgress) -> FinishedRun {
    running.signal(Signal::INT);
    let ended = running.finish();
    ended.exits_with(130).assert_leaves_nothing();
    ended.assert_holds(ended.number("/min_distance_m") >= 0.2, "no distance is below d");
    ended
}

#[test]
fn page_and_stream_require_the_token_and_host_name() {
    let (running, page) = start_viewed_run(&["--view"]);
    assert!(page.host.starts_with("127.0.0.1:"), "{}", page.host);
    let response = page.get("/");
    assert_eq!(response.status, 200, "{}", response.body);
    assert!(response.body.contains("<script"), "{}", response.body);
    for header in [
        "content-type: text/html",
        "content-security-policy: default-src 'none'",
        "referrer-policy: no-referrer",
        "cache-control: no-store",
    ] {
        assert!(response.headers.contains(header), "{header}: {}", response.headers);
    }
    assert_eq!(page.get("/nothing").status, 404);
    let Page { host, token } = &page;
    let other = token.replace(['0', '1', '2', '3', '4', '5', '6', '7'], "8");
    for (path, host) in [
        ("/".to_owned(), host.as_str()),
        (format!("/?token={other}"), host),
        ("/events".to_owned(), host),
        (format!("/events?token={token}0"), host),
        (format!("/?token={token}"), "evil.example"),
        (format!("/events?token={token}"), "127.0.0.1.evil.example:80"),
    ] {
        let answer = page.send_request(&format!("GET {path} HTTP/1.0\r\nHost: {host}"), "");
        assert_eq!(answer.status, 403, "{path} of {host}: {}", answer.body);
        assert!(!answer.body.contains(token.as_str()));
    }
    let (status, reason) = page.press_on("kill", "r1");
    assert_eq!(status, 403, "a read-only view refuses buttons");
    assert!(reason.contains("--view-control"), "{reason}");

    let mut events = page.events();
    let (mut t_s, mut dropped) = (-1.0, 0);
    for _ in 0..10 {
        let frame = events.frame("later", |frame| frame["t_s"].as_f64() > Some(t_s));
        t_s = frame["t_s"].as_f64().unwrap();
        assert!(frame["dropped"].as_u64() >= Some(dropped), "{frame}");
        dropped = frame["dropped"].as_u64().unwrap();
        let has_key =
            |key: &str| frame["robots"].as_array().unwrap().iter().all(|r| r.get(key).is_some());
        assert!(
            ["x_m", "y_m", "heading_rad", "error_m", "state"].iter().all(|key| has_key(key)),
            "{frame}"
        );
        assert_eq!(frame["robots"].as_array().unwrap().len(), 3);
        assert_eq!(frame["edges"].as_array().unwrap().len(), 3);
        assert!(frame["distance_m"].as_f64() >= Some(0.2), "{frame}");
        assert!(frame["behind_ms"].is_u64() && frame["at_unix_ms"].is_u64(), "{frame}");
    }
    let (_, latency) = events.find(|(name, _)| name == "latency").expect("latencies");
    let stages = latency.as_array().unwrap();
    let wake = stages.iter().find(|row| row["stage"] == "wake").expect("of waking up");
    assert!(wake["count"].as_u64() > Some(0) && wake["max_us"].as_f64() >= wake["p50_us"].as_f64());

    running.signal(Signal::INT);
    let (_, end) = events.find(|(name, _)| name == "ended").expect("the stream reports the end");
    assert_eq!(end["exit"], 130);
    assert!(end["text"].as_str().unwrap().contains("interrupted"), "{end}");
    assert!(events.next().is_none(), "the stream ends");
    interrupted(running);
}

#[test]
fn manual_kill_freeze_and_restart_count_like_scenario_faults() {
    let (running, page) = start_viewed_run(&["--view-control"]);
    let mut events = page.events();
    events.robot_is(1, "moving");
    for (order, status, reason) in [
        (json!({ "act": "kill", "robot": "r9" }), 404, "no robot \"r9\""),
        (json!({ "act": "explode", "robot": "r1" }), 400, "kill"),
        (json!({ "act": "restart", "robot": "r1" }), 409, "r1 is moving, but must be dead"),
        (json!({ "act": "thaw", "robot": "r1" }), 409, "r1 is moving, but must be frozen"),
    ] {
        let (found, response) = page.press(order);
        assert_eq!(found, status, "{response}");
        assert!(response.contains(reason), "{response}");
    }
    let head_without_type = page.head("POST", "/control");
    let foreign_head = format!(
        "{head_without_type}\r\nContent-Type: application/json\r\nOrigin: http://evil.example"
    );
    let kill = r#"{"act":"kill","robot":"r1"}"#;
    assert_eq!(
        page.send_request(&head_without_type, kill).status,
        415,
        "a form of another site has no JSON"
    );
    assert_eq!(
        page.send_request(&foreign_head, kill).status,
        403,
        "a script of another site has its origin"
    );
    let long_head = format!("{head_without_type}\r\nContent-Type: application/json");
    assert_eq!(
        page.send_request(&long_head, &" ".repeat(5000)).status,
        413,
        "no order is that long"
    );

    assert_eq!(page.press_on("kill", "r2"), (204, String::new()));
    assert_eq!(events.happens("kill", "r2")["detail"], "SIGKILL, by hand");
    events.happens("died", "r2");
    let dead = events.frame("dead", |frame| frame["robots"][1]["state"] == "dead");
    // r1 receives from r2, r2 from r3, and r3 from r1.
    assert_eq!([&dead["edges"][0], &dead["edges"][1]], ["dead", "dead"], "{dead}");
    assert_ne!(dead["edges"][2], "dead", "{dead}");
    let (status, reason) = page.press_on("kill", "r2");
    assert_eq!(
        (status, reason.as_str()),
        (409, "r2 is dead, but must be starting or moving or frozen")
    );
    assert_eq!(page.press_on("restart", "r2").0, 204);
    events.robot_is(1, "moving");
    assert_eq!(page.press_on("freeze", "r3").0, 204);
    events.robot_is(2, "frozen");
    assert_eq!(page.press_on("freeze", "r3").0, 409, "it is frozen already");
    assert_eq!(page.press_on("thaw", "r3").0, 204);
    events.robot_is(2, "moving");
    // A robot that was frozen and then killed is not frozen after its restart.
    assert_eq!(page.press_on("freeze", "r1").0, 204);
    assert_eq!(page.press_on("kill", "r1").0, 204);
    assert_eq!(page.press_on("restart", "r1").0, 204);
    events.happens("ready", "r1");
    events.robot_is(0, "moving");

    let ended = interrupted(running);
    let faults = ended.summary["faults"].as_array().cloned().unwrap_or_default();
    let what: Vec<&str> = faults.iter().filter_map(|fault| fault["what"].as_str()).collect();
    let expected =
        ["kill r2", "freeze r3", "freeze r1", "kill r1"].map(|s| format!("{s}, by hand"));
    ended.assert_holds(what == expected, format!("the report lists the manual faults: {what:?}"));
    let are_over = faults.iter().all(|fault| fault["lasted_s"].as_f64() >= Some(0.0));
    ended.assert_holds(are_over, "and that it is over");
    ended.assert_holds(ended.number("/restarts/r2") == 1.0, "r2 was restarted once");
    ended.assert_holds(ended.number("/restarts/r1") == 1.0, "and r1");
    let written = ended.file("events.csv");
    for event in ["kill,r2,\"SIGKILL, by hand\"", "freeze,r3,", "thaw,r3,\"SIGCONT, by hand\""] {
        ended.assert_holds(written.contains(event), format!("it is written down: {event}"));
    }
}

#[test]
fn manual_link_cut_outlives_receiver_death_until_mended() {
    let (mut running, page) = start_viewed_run(&["--view", "--view-control"]);
    let mut events = page.events();
    // The edges in the scenario's order: r2->r1, r3->r2, r1->r3.
    events.edge_is(0, "fresh");
    let (status, reason) = page.press_on_link("cut", "r1", "r2");
    assert_eq!((status, reason.contains("r2 does not hear r1")), (404, true), "{reason}");
    let (status, reason) = page.press_on_link("mend", "r2", "r1");
    assert_eq!((status, reason.as_str()), (409, "r2->r1 was not cut interactively"));
    assert_eq!(page.press_on_link("cut", "r2", "r1").0, 204);
    assert_eq!(page.press_on_link("cut", "r2", "r1").0, 409, "it is cut already");
    events.edge_is(0, "cut");
    let cut = events.frame("the others", |frame| frame["edges"][1] == "fresh");
    assert_eq!(cut["edges"][0], "cut", "only this edge is cut: {cut}");
    running.wait_for("the loss of r2", |run| {
        run.events().contains(",contact,r1,lost r2").then_some(())
    });

    assert_eq!(page.press_on("kill", "r1").0, 204);
    assert_eq!(page.press_on("restart", "r1").0, 204);
    events.happens("ready", "r1");
    events.frame("r1 moving and deaf", |frame| {
        frame["robots"][0]["state"] == "moving" && frame["edges"][0] == "cut"
    });
    assert_eq!(page.press_on_link("mend", "r2", "r1").0, 204);
    events.edge_is(0, "fresh");
    running.wait_for("the return of r2", |run| {
        let events = run.events();
        let (_, since) = events.split_once(",mend,r1,")?;
        since.contains(",contact,r1,fresh r2").then_some(())
    });
    let ended = interrupted(running);
    let written = ended.file("events.csv");
    let (_, since_cut) = written.split_once(",cut,r1,\"r2->r1, by hand\"").unwrap_or_default();
    let lost = since_cut.find(",contact,r1,lost r2");
    ended.assert_holds(lost.is_some(), "r1 has lost r2");
    ended.assert_holds(since_cut.find(",contact,r1,stale r2") < lost, "after it had been stale");
    ended
        .assert_holds(ended.summary["faults"][0]["what"] == "cut r2->r1, by hand", "it is a fault");
    ended.assert_holds(ended.number("/faults/0/lost_after_s") > 0.0, "that was noticed");
    ended.assert_holds(ended.number("/faults/0/lasted_s") > 0.0, "and has ended");
}

#[test]
fn spare_is_shown_while_it_is_in_use() {
    let set = ["repair=spares", "repair_after_s=0.2", "duration_s=100", "expect={}"];
    let planned = crate::oracle::scenario("pentagon", &set);
    let spare_index = |from, to| {
        planned.repair_plan.spares.iter().position(|one| (one.from, one.to) == (from, to))
    };
    let spare = planned.graph.edges().len() + spare_index(4, 2).expect("r5 is a spare of r3");
    let mut running = run("pentagon").sets(set).args(["--view", "--view-control"]).start();
    let page = Page::from_run(&mut running);
    let mut events = page.events();
    events.edge_is(spare, "closed");
    assert_eq!(page.press_on("kill", "r4").0, 204);
    let mut details = [0, 1].map(|_| events.happens("repair", "r3")["detail"].to_string());
    details.sort();
    assert_eq!(details, ["\"no longer uses r4\"", "\"uses r5\""]);
    events.edge_is(spare, "fresh");
    assert_eq!(page.press_on("restart", "r4").0, 204);
    events.edge_is(spare, "closed");
    running.signal(Signal::INT);
    let ended = running.finish();
    ended.exits_with(130).assert_leaves_nothing().assert_keeps_d();
}

/// Starts a run that is slow enough for a client: half a minute of run time in some seconds of wall time.
fn lockstep() -> Phalanx {
    run("triangle").lockstep().set("period_s=0.0005").set("expect={}")
}

#[test]
fn viewer_does_not_change_a_lockstep_run() {
    let unviewed = lockstep().finish();
    let mut running = lockstep().args(["--view", "--view-control"]).start();
    let page = Page::from_run(&mut running);
    let idle = page.events();
    let (named_events, _) = page.events().partition::<Vec<_>, _>(|(name, _)| !name.is_empty());
    let (name, end) = named_events.last().expect("the stream has an event");
    assert_eq!((name.as_str(), &end["exit"]), ("ended", &json!(0)), "{named_events:?}");
    let text = end["text"].as_str().unwrap();
    assert!(text.contains("no expectations declared"), "{text}");
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(
        ended.hash() == unviewed.hash(),
        format!("the same hash, {}", unviewed.hash()),
    );
    drop(idle);
}

#[test]
fn manual_lockstep_faults_hit_robots_at_next_tick_not_links() {
    let mut running = lockstep().set("period_s=0.0001").args(["--view", "--view-control"]).start();
    let page = Page::from_run(&mut running);
    let mut events = page.events();
    events.robot_is(1, "moving");
    let (status, reason) = page.press_on_link("cut", "r2", "r1");
    assert_eq!((status, reason.contains("--pace realtime")), (409, true), "{reason}");
    assert_eq!(page.press_on("freeze", "r3").0, 204);
    events.robot_is(2, "frozen");
    assert_eq!(page.press_on("thaw", "r3").0, 204);
    assert_eq!(page.press_on("kill", "r2").0, 204);
    events.robot_is(1, "dead");
    assert_eq!(page.press_on("restart", "r2").0, 204);
    events.happens("ready", "r2");
    drop(events);
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(ended.number("/restarts/r2") == 1.0, "r2 was restarted");
    ended.assert_holds(
        ended.number("/acts_by_hand") == 4.0,
        "accepted faults are counted, refused ones are not",
    );
    ended.assert_holds(ended.number("/min_distance_m") >= 0.2, "no distance is below d");
    ended.assert_holds(ended.number("/final_error_m_max") < 1e-3, "the formation has converged");
}

#[test]
fn exposed_view_or_occupied_port_starts_nothing() {
    let occupied = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = occupied.local_addr().unwrap().port().to_string();
    for (args, code, reason) in [
        (vec!["--view=0.0.0.0:0"], 2, "--insecure"),
        (vec!["--view=[::]:0"], 2, "--insecure"),
        (vec!["--view=nowhere"], 2, "such as 8080"),
        (vec!["--insecure"], 2, "--view"),
        (vec![&*format!("--view={port}")], 4, "Address already in use"),
    ] {
        let ended = run("triangle").args(args).finish();
        ended.exits_with(code).assert_leaves_nothing();
        ended.assert_holds(ended.stderr.contains(reason), format!("the error contains {reason}"));
        ended.assert_holds(!ended.run_dir().exists(), "nothing is written");
    }
}
