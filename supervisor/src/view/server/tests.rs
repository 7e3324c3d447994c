//! Tests of the server over sockets of this machine.

use super::*;
use outcome::report::scene::{FrameRobot, SceneFrame};
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::TcpStream;

/// Number of robots for which the sockets hold only few frames.
const ROBOTS: usize = 300;
/// Deadline that only a hang exceeds.
const TIMEOUT: Duration = Duration::from_secs(60);

fn frame(t_s: f64) -> SceneFrame {
    SceneFrame { t_s, robots: vec![FrameRobot::default(); ROBOTS], ..SceneFrame::default() }
}

#[test]
fn slow_client_misses_frames_and_delays_no_other_client() {
    let server = bind("127.0.0.1:0".parse().unwrap(), false).unwrap();
    let url = server.url();
    let (host, query) = url.strip_prefix("http://").unwrap().split_once('/').unwrap();
    let mut view = server.serve(crate::view::act::tests::two_robots(), false).unwrap();
    let start = Instant::now();
    let connect_client = || {
        let mut stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        write!(stream, "GET /events{query} HTTP/1.0\r\nHost: {host}\r\n\r\n").unwrap();
        BufReader::new(stream)
    };
    let frames = |lines: BufReader<TcpStream>| {
        let data = lines.lines().map_while(Result::ok);
        let data = data.filter_map(|line| Some(line.strip_prefix("data: ")?.to_owned()));
        let frames = data.map(|data| serde_json::from_str::<serde_json::Value>(&data).unwrap());
        frames.filter(|frame| frame["t_s"].is_f64())
    };
    let idle_client = connect_client();
    let mut reader = frames(connect_client());
    while view.client_count() < 2 {
        assert!(start.elapsed() < TIMEOUT, "they do not get in");
        std::thread::sleep(Duration::from_millis(1));
    }
    // Far more than the sockets hold. The client that reads gets each of them.
    for number in 0..200 {
        let previous_count = view.frame_count;
        while view.frame_count == previous_count {
            view.send_frame(frame(f64::from(number)));
        }
        assert_eq!(reader.next().expect("a frame")["t_s"].as_f64(), Some(f64::from(number)));
    }
    // The other client finally reads: it soon gets the newest frame, and the number of missed ones.
    let mut received = 0;
    for frame in frames(idle_client) {
        received += 1;
        let (t_s, dropped) = (frame["t_s"].as_f64().unwrap(), frame["dropped"].as_u64().unwrap());
        if t_s == 199.0 {
            assert!(
                dropped > 0 && received + dropped <= 200,
                "{received} shown, {dropped} dropped"
            );
            break;
        }
    }
    assert!(received < 200, "it got every frame, however old");
    view.send_end_of_run(0, "done");
}

/// Starts a server of two robots with these limits. Returns it with its host and the query of its addresses.
fn start_server(limits: ConnectionLimits, control: bool) -> (View, String, String) {
    let server = BoundServer { limits, ..bind("127.0.0.1:0".parse().unwrap(), false).unwrap() };
    let url = server.url();
    let (host, query) = url.strip_prefix("http://").unwrap().split_once('/').unwrap();
    let (host, query) = (host.to_owned(), query.to_owned());
    (server.serve(crate::view::act::tests::two_robots(), control).unwrap(), host, query)
}

fn connect(host: &str) -> TcpStream {
    let stream = TcpStream::connect(host).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream
}

/// Sends a request and returns all data until the connection is closed.
fn send_request(host: &str, request: &str) -> String {
    let mut stream = connect(host);
    write!(stream, "{request} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
    read_to_end(stream)
}

/// Returns all data until the other end closes. Panics after a timeout.
fn read_to_end(mut stream: TcpStream) -> String {
    let mut text = String::new();
    match stream.read_to_string(&mut text) {
        Ok(_) => text,
        Err(error) if error.kind() == ErrorKind::ConnectionReset => text,
        Err(error) => panic!("it was not closed: {error}"),
    }
}

#[test]
fn connection_without_a_request_is_closed_and_a_stream_stays() {
    // The stream that stays was opened before, and outlives the others.
    let limits =
        ConnectionLimits { silence_max: Duration::from_millis(300), ..ConnectionLimits::default() };
    let (mut view, host, query) = start_server(limits, false);
    let mut events = loop {
        // On a busy machine the request itself may arrive too late.
        let mut stream = connect(&host);
        let _ = write!(stream, "GET /events{query} HTTP/1.1\r\nHost: {host}\r\n\r\n");
        let mut lines = BufReader::new(stream);
        let mut first = String::new();
        if lines.read_line(&mut first).is_ok() && first.contains(" 200 ") {
            break lines.lines().map_while(Result::ok);
        }
    };
    let silent_client = connect(&host);
    let mut incomplete = connect(&host);
    write!(incomplete, "GET /{query} HTTP/1.1\r\nHost: {host}\r\n").unwrap();
    assert_eq!(read_to_end(silent_client), "");
    assert_eq!(read_to_end(incomplete), "");
    assert!(view.is_watched(), "the one that listens is still there");
    let previous_count = view.frame_count;
    while view.frame_count == previous_count {
        view.send_frame(frame(7.0));
    }
    assert!(events.any(|line| line.contains("\"t_s\":7.0")), "and is told");
}

#[test]
fn oldest_silent_connection_is_closed_for_a_new_one() {
    // Connections here are not closed by their timeout, only to make room.
    let limits = ConnectionLimits { silence_max: 10 * TIMEOUT, ..ConnectionLimits::default() };
    let (_view, host, query) = start_server(limits, false);
    let mut connections: Vec<TcpStream> = (0..64).map(|_| connect(&host)).collect();
    let page = send_request(&host, &format!("GET /{query}"));
    assert!(page.starts_with("HTTP/1.1 200 ") && page.contains("<script"), "{page}");
    let newest = connections.split_off(64 - limits.unauthenticated_max + 1);
    for connection in connections {
        assert_eq!(read_to_end(connection), "");
    }
    for (index, mut connection) in newest.into_iter().enumerate() {
        connection.set_nonblocking(true).unwrap();
        let read = connection.read(&mut [0]).map_err(|error| error.kind());
        assert_eq!(read, Err(ErrorKind::WouldBlock), "{index} of the newest is closed");
    }
}

#[test]
fn request_without_the_token_is_answered_and_closed() {
    let limits = ConnectionLimits { silence_max: 10 * TIMEOUT, ..ConnectionLimits::default() };
    let (_view, host, _) = start_server(limits, false);
    // More requests than concurrent connections, because each response ends its connection.
    for _ in 0..3 * limits.unauthenticated_max {
        let response = send_request(&host, "GET /?token=0");
        assert!(response.starts_with("HTTP/1.1 403 "), "{response}");
    }
}

#[test]
fn authenticated_connections_are_limited() {
    let limits = ConnectionLimits {
        silence_max: 10 * TIMEOUT,
        authenticated_max: 2,
        ..ConnectionLimits::default()
    };
    let (mut view, host, query) = start_server(limits, true);
    let open_stream = || {
        let mut stream = connect(&host);
        write!(stream, "GET /events{query} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
        let mut lines = BufReader::new(stream);
        let mut first = String::new();
        lines.read_line(&mut first).unwrap();
        assert!(first.contains(" 200 "), "{first}");
        lines
    };
    let streams = [open_stream(), open_stream()];
    let response = send_request(&host, &format!("GET /{query}"));
    assert!(response.starts_with("HTTP/1.1 503 "), "{response}");
    drop(streams);
    let start = Instant::now();
    while !send_request(&host, &format!("GET /{query}")).starts_with("HTTP/1.1 200 ") {
        assert!(start.elapsed() < TIMEOUT, "there is no room after they have gone");
        // The server detects a closed connection at its next write.
        view.send_latency(Vec::new());
    }
}
