//! Attacks of a stranger in the network on a host whose fleet has certificates: none has an effect. In each test
//! the legitimate host is received too; otherwise the test would pass for a host that receives nothing.

use std::fs;
use std::io::Write as _;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use bridge::certificates::{Authority, Validity};
use bridge::examples::{self, robot};
use bridge::frame::{FrameHeader, WIRE_FORMAT_VERSION};
use bridge::gate::FrameFilter;
use bridge::process::config::{self, SessionRole};
use bridge::process::inbox::Inbox;
use bridge::process::refusals;
use bridge::process::wire::PeerSessions;
use bridge::topics::{self, Route, Topic};
use protocol::brief::{BridgeBrief, CertificatesBrief, HostBrief};
use protocol::clock;
use protocol::dropped::DropReason;
use serde_json::json;
use tempfile::TempDir;
use tracing_subscriber::prelude::*;
use zenoh::Wait as _;
use zenoh::qos::CongestionControl;

const LAYOUT_HASH: u64 = 7;
const EXPERIMENT_HASH: u64 = 8;
/// Beacon of the robot on b, which a receives.
const BEACON_TOPIC: Topic = Topic::Beacon(1);
/// Message of a to b.
const ORDERS_CONTENT: &[u8] = b"orders";
/// Time limit that only a hang exceeds.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Duration of a stranger's attempts.
const ATTEMPT_DURATION: Duration = Duration::from_millis(1_500);

/// Lock that runs the tests one at a time, because refusals by zenoh are counted per process.
static SERIAL_LOCK: Mutex<()> = Mutex::new(());
/// Reasons that are counted there.
const REFUSAL_REASONS: [DropReason; 5] = [
    DropReason::Certificate,
    DropReason::Expired,
    DropReason::UnknownHost,
    DropReason::Denied,
    DropReason::Handshake,
];

/// Host a of a fleet of three, which listens.
struct ListeningHost {
    folder: TempDir,
    authority: Authority,
    hosts: Vec<HostBrief>,
    inbox: Arc<Inbox>,
    sessions: PeerSessions,
    /// Counts of refusals before the test.
    refusals_before: [u64; 5],
    _serial_guard: MutexGuard<'static, ()>,
}

impl ListeningHost {
    fn new() -> ListeningHost {
        let serial_guard = SERIAL_LOCK.lock().unwrap_or_else(PoisonError::into_inner);
        // Fails for all tests but the first, because the subscriber is installed once.
        let _ = tracing_subscriber::registry().with(refusals::RefusalCounter::layer()).try_init();
        let folder = tempfile::tempdir().unwrap();
        let authority = Authority::new(Validity::for_days(1)).unwrap();
        // Ports that were free a moment ago.
        let ports = [(); 3].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
        let hosts = ["a", "b", "c"].into_iter().zip(&ports).map(|(name, port)| HostBrief {
            name: name.into(),
            address: port.local_addr().unwrap().to_string(),
        });
        let hosts: Vec<HostBrief> = hosts.collect();
        drop(ports);
        fs::write(folder.path().join("ca.pem"), authority.certificate()).unwrap();
        for host in &hosts {
            let (certificate, key) = authority
                .issue_host_certificate(&host.name, &host.address, Validity::for_days(1))
                .unwrap();
            write_certificate_files(folder.path(), &host.name, &certificate, &key);
        }
        let brief = brief(&hosts, 0, certificates(folder.path(), "a"));
        let routes = topics::routes(&brief);
        let inbox = Arc::new(Inbox::new(routes.len(), hosts.len()));
        for (index, route) in
            routes.iter().enumerate().filter(|(_, route)| route.receiving_hosts.contains(&0))
        {
            inbox.open_route(
                index,
                route.sending_host,
                FrameFilter::new(route.sending_host, LAYOUT_HASH, EXPERIMENT_HASH),
                false,
            );
        }
        let sessions = PeerSessions::open(&brief, &routes, &inbox).unwrap();
        let refusals_before = REFUSAL_REASONS.map(refusals::refusal_count);
        ListeningHost {
            folder,
            authority,
            hosts,
            inbox,
            sessions,
            refusals_before,
            _serial_guard: serial_guard,
        }
    }

    /// Checks that refusals were counted for this reason and no other.
    fn assert_only_refusal(&self, expected: DropReason) {
        let start = Instant::now();
        loop {
            let current_counts = REFUSAL_REASONS.map(refusals::refusal_count);
            let increments = (0..current_counts.len()).map(|reason| {
                (REFUSAL_REASONS[reason], current_counts[reason] - self.refusals_before[reason])
            });
            let increments: Vec<_> = increments.filter(|&(_, count)| count > 0).collect();
            match &increments[..] {
                [(reason, _)] if *reason == expected => return,
                [] if start.elapsed() < TIMEOUT => std::thread::sleep(Duration::from_millis(20)),
                _ => panic!("{increments:?} instead of {expected:?}"),
            }
        }
    }

    /// Connects to a with these certificates, without an access list.
    fn connect(&self, certificates: CertificatesBrief) -> zenoh::Session {
        let mut config = config::session_config(
            &brief(&self.hosts, 1, certificates),
            SessionRole::Connecting(0),
        );
        config["access_control"] = json!({ "enabled": false });
        let config = zenoh::Config::from_json5(&config.to_string()).unwrap();
        zenoh::open(config).wait().unwrap()
    }

    fn connect_as(&self, name: &str) -> zenoh::Session {
        self.connect(certificates(self.folder.path(), name))
    }

    /// Returns the index of the route of a topic, and the route.
    fn find_route(&self, topic: Topic) -> (usize, Route) {
        let brief = brief(&self.hosts, 0, certificates(self.folder.path(), "a"));
        let mut routes = topics::routes(&brief).into_iter().enumerate();
        routes.find(|(_, route)| route.topic == topic).unwrap()
    }

    fn route(&self, topic: Topic) -> Route {
        self.find_route(topic).1
    }

    /// Sends a message to b, as the bridge of a does.
    fn send_order(&self, sequence: u64) {
        let (index, _) = self.find_route(Topic::Orders(1));
        self.sessions.send(index, encode_frame(sequence, ORDERS_CONTENT)).unwrap();
    }

    /// Sends messages as b until one arrives. Panics if another message arrives first.
    fn assert_receives_from_b(&self, session: &zenoh::Session, first: u64) {
        let (start, mut sequence) = (Instant::now(), first);
        let key = self.route(BEACON_TOPIC).key;
        loop {
            session.put(&key, encode_frame(sequence, b"good")).wait().unwrap();
            sequence += 1;
            let arrived = self.inbox.wait_for_frames(clock::now_ns() + 20_000_000);
            assert!(arrived.iter().all(|arrived| arrived.content == b"good"), "{arrived:?}");
            if !arrived.is_empty() {
                return;
            }
            assert!(start.elapsed() < TIMEOUT, "b is not heard");
        }
    }

    /// Returns a counter of the orders of a that this session receives.
    fn count_received_orders(&self, session: &zenoh::Session) -> Arc<AtomicU64> {
        let orders_received = Arc::new(AtomicU64::new(0));
        let count = orders_received.clone();
        let listener =
            session.declare_subscriber(self.route(Topic::Orders(1)).key).callback(move |sample| {
                if sample.payload().to_bytes().ends_with(ORDERS_CONTENT) {
                    count.fetch_add(1, Ordering::Relaxed);
                }
            });
        listener.background().wait().unwrap();
        orders_received
    }

    /// Checks that a stranger with these certificates is neither received nor sent anything, with one counted
    /// reason, and that b is both afterwards.
    fn assert_stranger_refused(&self, certificates: CertificatesBrief, reason: DropReason) {
        let stranger = self.connect(certificates);
        let orders_received = self.count_received_orders(&stranger);
        let (start, key, mut sequence) = (Instant::now(), self.route(BEACON_TOPIC).key, 1);
        while start.elapsed() < ATTEMPT_DURATION {
            stranger.put(&key, encode_frame(sequence, b"forged")).wait().unwrap();
            self.send_order(sequence);
            sequence += 1;
            assert!(
                self.inbox.wait_for_frames(clock::now_ns() + 20_000_000).is_empty(),
                "a stranger is heard"
            );
        }
        assert_eq!(orders_received.load(Ordering::Relaxed), 0, "a stranger hears");
        stranger.close().wait().unwrap();
        self.assert_only_refusal(reason);
        let b = self.connect_as("b");
        let orders_received_by_b = self.count_received_orders(&b);
        self.assert_receives_from_b(&b, 1);
        let start = Instant::now();
        while orders_received_by_b.load(Ordering::Relaxed) == 0 {
            self.send_order(sequence);
            assert!(start.elapsed() < TIMEOUT, "b is told nothing");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Writes a certificate by this authority, with this name, to a new file.
    fn write_host_certificate(
        &self,
        authority: &Authority,
        name: &str,
        valid: Validity,
    ) -> CertificatesBrief {
        let (certificate, key) =
            authority.issue_host_certificate(name, &self.hosts[1].address, valid).unwrap();
        write_certificate_files(self.folder.path(), "forged", &certificate, &key);
        certificates(self.folder.path(), "forged")
    }
}

fn write_certificate_files(folder: &Path, name: &str, certificate: &str, key: &str) {
    fs::write(folder.join(format!("{name}.pem")), certificate).unwrap();
    fs::write(folder.join(format!("{name}.key")), key).unwrap();
}

fn certificates(folder: &Path, name: &str) -> CertificatesBrief {
    CertificatesBrief {
        authority: folder.join("ca.pem"),
        certificate: folder.join(format!("{name}.pem")),
        key: folder.join(format!("{name}.key")),
    }
}

fn brief(hosts: &[HostBrief], here: usize, certificates: CertificatesBrief) -> BridgeBrief {
    let robots = [robot("r0", 0, &[1, 2]), robot("r1", 1, &[0]), robot("r2", 2, &[0])];
    BridgeBrief {
        experiment: format!("{EXPERIMENT_HASH:016x}"),
        here,
        certificates: Some(certificates),
        ..examples::brief(hosts, robots)
    }
}

fn encode_frame(sequence: u64, content: &[u8]) -> Vec<u8> {
    let (version, host, layout, experiment) =
        (WIRE_FORMAT_VERSION, 1, LAYOUT_HASH, EXPERIMENT_HASH);
    let header = FrameHeader {
        version,
        host,
        layout_hash: layout,
        experiment_hash: experiment,
        boot_id: 5,
        sequence,
        source_ns: 0,
    };
    header.encode_frame(&[content])
}

#[test]
fn certificate_of_another_authority_is_refused() {
    let a = ListeningHost::new();
    let other = Authority::new(Validity::for_days(1)).unwrap();
    a.assert_stranger_refused(
        a.write_host_certificate(&other, "b", Validity::for_days(1)),
        DropReason::Certificate,
    );
}

#[test]
fn certificate_with_unknown_name_is_refused() {
    let a = ListeningHost::new();
    let forged = a.write_host_certificate(&a.authority, "stranger", Validity::for_days(1));
    a.assert_stranger_refused(forged, DropReason::UnknownHost);
}

#[test]
fn expired_certificate_is_refused() {
    let a = ListeningHost::new();
    let day = Duration::from_secs(24 * 3600);
    let now = SystemTime::now();
    let past = Validity { not_before: now - 3 * day, not_after: now - day };
    a.assert_stranger_refused(
        a.write_host_certificate(&a.authority, "b", past),
        DropReason::Expired,
    );
}

#[test]
fn host_cannot_write_keys_of_another_host() {
    let a = ListeningHost::new();
    let c = a.connect_as("c");
    let (start, mut sequence) = (Instant::now(), 1);
    let (keys, own) = (a.route(BEACON_TOPIC).key, a.route(Topic::Beacon(2)).key);
    let mut has_received_c = false;
    // Messages of c are received, which shows that it is connected; for this duration no others are.
    while !has_received_c || start.elapsed() < ATTEMPT_DURATION {
        c.put(&keys, encode_frame(sequence, b"forged")).wait().unwrap();
        let header =
            FrameHeader { host: 2, ..FrameHeader::decode(&encode_frame(sequence, b"")).unwrap().0 };
        c.put(&own, header.encode_frame(&[b"own"])).wait().unwrap();
        sequence += 1;
        let arrived = a.inbox.wait_for_frames(clock::now_ns() + 20_000_000);
        assert!(arrived.iter().all(|arrived| arrived.content == b"own"), "{arrived:?}");
        has_received_c |= !arrived.is_empty();
        assert!(start.elapsed() < TIMEOUT, "c is not heard");
    }
    a.assert_receives_from_b(&a.connect_as("b"), 1);
    a.assert_only_refusal(DropReason::Denied);
}

#[test]
fn replayed_or_foreign_frames_are_dropped_and_counted() {
    let a = ListeningHost::new();
    let b = a.connect_as("b");
    a.assert_receives_from_b(&b, 1);
    let (key, sequence_before) = (a.route(BEACON_TOPIC).key, 1_000_000);
    a.assert_receives_from_b(&b, sequence_before);
    let replayed = a.inbox.dropped_count(DropReason::Replayed);
    // Sent on one connection, so they arrive in order.
    let header = FrameHeader {
        layout_hash: LAYOUT_HASH + 1,
        ..FrameHeader::decode(&encode_frame(sequence_before * 2, b"")).unwrap().0
    };
    for bytes in
        [encode_frame(1, b"old"), header.encode_frame(&[b"another build"]), b"garbage".to_vec()]
    {
        b.put(&key, bytes).congestion_control(CongestionControl::Block).wait().unwrap();
    }
    a.assert_receives_from_b(&b, sequence_before * 3);
    assert_eq!(a.inbox.dropped_count(DropReason::Replayed), replayed + 1);
    assert_eq!(a.inbox.dropped_count(DropReason::Layout), 1);
    assert_eq!(a.inbox.dropped_count(DropReason::Garbage), 1);
    assert_eq!(
        REFUSAL_REASONS.map(refusals::refusal_count),
        a.refusals_before,
        "they came from a host of the fleet"
    );
}

#[test]
fn flood_of_garbage_does_not_block_other_hosts() {
    let a = ListeningHost::new();
    let garbage: Vec<u8> =
        (0..4_096_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let b = a.connect_as("b");
    a.assert_receives_from_b(&b, 1);
    for flood in 0..60 {
        // A refused connection is as good as one that is accepted and dropped.
        let Ok(mut stream) = TcpStream::connect(&a.hosts[0].address) else { continue };
        let _ = stream.write_all(&garbage);
        a.assert_receives_from_b(&b, 1_000 * (flood + 1));
    }
    a.assert_only_refusal(DropReason::Handshake);
    b.close().wait().unwrap();
    a.assert_receives_from_b(&a.connect_as("b"), 1_000_000);
}
