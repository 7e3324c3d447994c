//! The two ends: a process on each host, in a network of its own.
//!
//! They take turns by files. The first sends until the second says that it hears, then counts; the
//! second takes in what comes until a while after the first says that it is done.

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bridge::process::config;
use protocol::brief::{self, BridgeBrief, Pace};
use protocol::clock::{self, Timer};
use protocol::message::Beacon;
use protocol::run_root;
use protocol::service::{self, Factory, Node, Qos};
use rustix::thread::UnshareFlags;
use supervisor::child::Child;
use supervisor::spawn::{Launcher, Role};
use zenoh::Wait as _;
use zenoh::qos::{CongestionControl, Priority};

use super::{ADDRESSES, NAMES, PERIOD_NS, ROBOT, SAMPLE_BYTES, Seen, Way, ip};
use crate::peers;
use crate::quantiles::quantiles_us;
use crate::{BenchError, failed};

/// The other end is heard, or done, within this.
const PATIENCE: Duration = Duration::from_secs(60);
/// What is under way has arrived by then.
const UNDER_WAY: Duration = Duration::from_millis(200);
/// So many samples must be heard before those that count are sent: the path is warm then.
const WARM: usize = 200;
/// How often beacons are looked for.
const LOOK_EVERY: Duration = Duration::from_micros(50);
/// A warming sample's number.
const UNCOUNTED: u64 = 0;
const PORT: u16 = 7600;
const KEY: &str = "phalanx/1/a/r1/beacon";

/// One end of the cable: that of the host of this brief. The second leaves what it saw in `result`.
pub(crate) fn peer(brief_path: &Path, samples: u64, result: &Path) -> Result<(), BenchError> {
    // SAFETY: this process has one thread, and no descriptors are unshared.
    let unshared = unsafe { rustix::thread::unshare_unsafe(UnshareFlags::NEWNET) };
    unshared.map_err(|error| {
        BenchError::Wrong(format!("a network of its own is refused to this process: {error}"))
    })?;
    let brief: BridgeBrief = brief::read(brief_path)?;
    let here = brief.here;
    let dir = result.parent().unwrap_or(result);
    clock::tighten_timer_slack();
    peers::await_go(dir, here)?;
    ip(["link", "set", "lo", "up"])?;
    ip(["addr", "add", &format!("{}/24", ADDRESSES[here]), "dev", "eth0"])?;
    ip(["link", "set", "eth0", "up"])?;
    let end = End { dir: dir.into(), samples };
    let mut seen = Vec::new();
    for way in Way::ALL {
        seen.extend(match (way, here) {
            (Way::Udp, 0) => end.send_datagrams()?,
            (Way::Udp, _) => end.take_datagrams()?,
            (Way::Zenoh, 0) => end.put(&brief)?,
            (Way::Zenoh, _) => end.subscribe(&brief)?,
            (Way::Bridges, 0) => end.be_heard(&brief)?,
            (Way::Bridges, _) => end.hear(&brief)?,
        });
    }
    match here {
        0 => {
            end.wait_for("all-seen")?;
            std::thread::sleep(PATIENCE);
            Ok(())
        }
        _ => {
            end.say("all-seen")?;
            peers::tell(result, &seen)
        }
    }
}

/// What both ends have in common.
struct End {
    dir: PathBuf,
    /// How many samples count.
    samples: u64,
}

/// What arrived: numbers, and how long each was under way, ns.
#[derive(Default)]
struct Arrived(Vec<(u64, u64)>);

impl Arrived {
    fn take(&mut self, number: u64, sent_ns: u64) {
        self.0.push((number, clock::now_ns().saturating_sub(sent_ns)));
    }
}

impl End {
    fn say(&self, sign: &str) -> Result<(), BenchError> {
        let path = self.dir.join(sign);
        std::fs::write(&path, "").map_err(failed("make", &path))
    }

    fn said(&self, sign: &str) -> bool {
        self.dir.join(sign).exists()
    }

    fn wait_for(&self, sign: &str) -> Result<(), BenchError> {
        let began = Instant::now();
        while !self.said(sign) {
            if began.elapsed() > PATIENCE {
                return Err(BenchError::Wrong(format!("the other host is not heard: {sign}")));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// Sends a number every period: 0 until the other end hears, then those that count.
    fn send(
        &self,
        way: &str,
        mut send: impl FnMut(u64) -> Result<(), BenchError>,
    ) -> Result<Option<Seen>, BenchError> {
        let mut timer = Timer::new(PERIOD_NS, 0);
        let began = Instant::now();
        let heard = format!("heard-{way}");
        while !self.said(&heard) {
            if began.elapsed() > PATIENCE {
                return Err(BenchError::Wrong(format!("nothing is heard over {way}")));
            }
            if timer.wait().is_some() {
                send(UNCOUNTED)?;
            }
        }
        let mut number = UNCOUNTED;
        while number < self.samples {
            if timer.wait().is_some() {
                number += 1;
                send(number)?;
            }
        }
        std::thread::sleep(UNDER_WAY);
        self.say(&format!("sent-{way}"))?;
        self.wait_for(&format!("done-{way}"))?;
        Ok(None)
    }

    /// Takes what comes until the other end is done; `take` waits a while for something.
    fn take(
        &self,
        way: &str,
        mut take: impl FnMut(&mut Arrived) -> Result<(), BenchError>,
    ) -> Result<Option<Seen>, BenchError> {
        let (mut arrived, mut heard) = (Arrived::default(), false);
        let (sent, mut looked) = (format!("sent-{way}"), Instant::now());
        let began = Instant::now();
        loop {
            take(&mut arrived)?;
            if !heard && arrived.0.len() >= WARM {
                heard = true;
                self.say(&format!("heard-{way}"))?;
            }
            // Files are not looked at between any two samples.
            if looked.elapsed() > UNDER_WAY {
                if heard && self.said(&sent) {
                    break;
                }
                if began.elapsed() > PATIENCE {
                    return Err(BenchError::Wrong(format!("nothing comes over {way}")));
                }
                looked = Instant::now();
            }
        }
        self.say(&format!("done-{way}"))?;
        let counted = arrived.0.iter().filter(|(number, _)| *number != UNCOUNTED);
        let way_ns: Vec<u64> = counted.map(|&(_, way_ns)| way_ns).collect();
        let lost = self.samples.saturating_sub(way_ns.len() as u64);
        let nothing = || BenchError::Wrong(format!("all was lost over {way}"));
        Ok(Some(Seen { way_us: quantiles_us(way_ns).ok_or_else(nothing)?, lost }))
    }

    fn send_datagrams(&self) -> Result<Option<Seen>, BenchError> {
        let socket = UdpSocket::bind((ADDRESSES[0], 0)).map_err(of_socket)?;
        socket.connect((ADDRESSES[1], PORT)).map_err(of_socket)?;
        self.send("udp", |number| {
            // Nobody listens yet: an error of the one before.
            let _ = socket.send(&sample(number));
            Ok(())
        })
    }

    fn take_datagrams(&self) -> Result<Option<Seen>, BenchError> {
        let socket = UdpSocket::bind((ADDRESSES[1], PORT)).map_err(of_socket)?;
        socket.set_read_timeout(Some(UNDER_WAY)).map_err(of_socket)?;
        self.take("udp", |arrived| {
            let mut bytes = [0; SAMPLE_BYTES];
            match socket.recv(&mut bytes) {
                Ok(_) => of_sample(&bytes, arrived),
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => Ok(()),
                Err(error) => Err(of_socket(error)),
            }
        })
    }

    fn put(&self, brief: &BridgeBrief) -> Result<Option<Seen>, BenchError> {
        let session = session(brief)?;
        let publisher = session
            .declare_publisher(KEY)
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::RealTime)
            .express(true)
            .wait()
            .map_err(of_zenoh)?;
        self.send("zenoh", |number| publisher.put(&sample(number)[..]).wait().map_err(of_zenoh))?;
        drop(publisher);
        session.close().wait().map_err(of_zenoh)?;
        Ok(None)
    }

    fn subscribe(&self, brief: &BridgeBrief) -> Result<Option<Seen>, BenchError> {
        let session = session(brief)?;
        let arrived = Arc::new(Mutex::new(Arrived::default()));
        let taken = arrived.clone();
        let subscribed = session.declare_subscriber(KEY).callback(move |sample| {
            let bytes = sample.payload().to_bytes();
            if let Ok(mut arrived) = taken.lock() {
                // Whatever is none is not counted.
                let _ = of_sample(&bytes, &mut arrived);
            }
        });
        let subscriber = subscribed.wait().map_err(of_zenoh)?;
        let seen = self.take("zenoh", |all| {
            std::thread::sleep(Duration::from_millis(20));
            if let Ok(mut arrived) = arrived.lock() {
                all.0.append(&mut arrived.0);
            }
            Ok(())
        })?;
        drop(subscriber);
        session.close().wait().map_err(of_zenoh)?;
        Ok(seen)
    }

    fn be_heard(&self, brief: &BridgeBrief) -> Result<Option<Seen>, BenchError> {
        let (_node, beacon, _others) = services(brief)?;
        let publisher = beacon.publisher()?;
        let _bridge = self.bridge(brief)?;
        self.send("bridges", |number| {
            let sent_ns = clock::now_ns();
            // A place that says which it is; the stamp that matters is not touched on the way.
            let x_m = number as f64;
            let beacon =
                Beacon { tick: sent_ns, stamp_ns: sent_ns, sent_ns, x_m, ..Beacon::default() };
            let sent = publisher.send_copy(beacon);
            sent.map(drop).map_err(|error| BenchError::Wrong(format!("not sent: {error}")))
        })
    }

    fn hear(&self, brief: &BridgeBrief) -> Result<Option<Seen>, BenchError> {
        let (_node, beacon, _others) = services(brief)?;
        let subscriber = beacon.subscriber()?;
        let _bridge = self.bridge(brief)?;
        self.take("bridges", |arrived| {
            let failed = |error| BenchError::Wrong(format!("not received: {error}"));
            while let Some(beacon) = subscriber.receive().map_err(failed)? {
                arrived.take(beacon.x_m as u64, beacon.tick);
            }
            std::thread::sleep(LOOK_EVERY);
            Ok(())
        })
    }

    /// The bridge of this host: it ends with this process.
    fn bridge(&self, brief: &BridgeBrief) -> Result<Child, BenchError> {
        let here = NAMES[brief.here];
        let path = self.dir.join(format!("brief-{}.toml", brief.here));
        let log = self.dir.join(format!("bridge-{here}.log"));
        Ok(Launcher::of_this_executable().spawn(Role::Bridge { brief: &path }, &log)?)
    }
}

/// What the supervisor of either host makes before its bridge starts, the beacon first: one process hears it, the
/// bridge where it is sent.
fn services(brief: &BridgeBrief) -> Result<(Node, Factory<Beacon>, impl Sized), BenchError> {
    run_root::join(&brief.run_root)?;
    let node = service::node("host")?;
    let beacon = service::beacon(ROBOT).create(&node, Qos::of_robot(Pace::Realtime, 1))?;
    let of_hosts = Qos::of_hosts(1);
    let others = (
        service::orders(NAMES[1]).create(&node, of_hosts)?,
        service::report(NAMES[1]).create(&node, of_hosts)?,
        service::bridge(NAMES[0]).create(&node, of_hosts)?,
        service::bridge(NAMES[1]).create(&node, of_hosts)?,
    );
    Ok((node, beacon, others))
}

/// As a bridge has it.
fn session(brief: &BridgeBrief) -> Result<zenoh::Session, BenchError> {
    let end = if brief.here == 0 { config::End::Listening } else { config::End::To(0) };
    bridge::wire::open(&config::of(brief, end)).map_err(of_zenoh)
}

/// A number, and when it is sent.
fn sample(number: u64) -> [u8; SAMPLE_BYTES] {
    let mut bytes = [0; SAMPLE_BYTES];
    bytes[..8].copy_from_slice(&number.to_le_bytes());
    bytes[8..16].copy_from_slice(&clock::now_ns().to_le_bytes());
    bytes
}

fn of_sample(bytes: &[u8], arrived: &mut Arrived) -> Result<(), BenchError> {
    let number = |from: usize| Some(u64::from_le_bytes(*bytes.get(from..)?.first_chunk()?));
    let (Some(number), Some(sent_ns)) = (number(0), number(8)) else {
        return Err(BenchError::Wrong(format!("a sample of {} bytes", bytes.len())));
    };
    arrived.take(number, sent_ns);
    Ok(())
}

fn of_socket(error: std::io::Error) -> BenchError {
    BenchError::Wrong(format!("a socket: {error}"))
}

fn of_zenoh(error: zenoh::Error) -> BenchError {
    BenchError::Wrong(format!("zenoh: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_tells_its_number_and_how_long_it_was_under_way() {
        let mut arrived = Arrived::default();
        let early = clock::now_ns();
        of_sample(&sample(7), &mut arrived).unwrap();
        let [(number, way_ns)] = arrived.0[..] else { panic!("one") };
        assert!(number == 7 && way_ns <= clock::now_ns() - early);
        assert!(of_sample(&[0; 9], &mut arrived).is_err());
    }
}
