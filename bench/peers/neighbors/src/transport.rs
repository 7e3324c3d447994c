//! What carries the samples, and when their ages are taken.
//!
//! A payload opens with two little-endian numbers: when it was sent (CLOCK_MONOTONIC, ns), and by
//! which process. Nothing here waits for a receiver: samples that find no room are lost.

use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use protocol::clock;
use zenoh::Wait as _;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::Sample;

use crate::{Failed, PAYLOAD_BYTES, Plan};

/// When an age is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// When the timer of whoever hears looks.
    Polled,
    /// When the sample comes.
    Woken,
}

impl How {
    /// The word for it on the command line.
    pub fn word(self) -> &'static str {
        match self {
            How::Polled => "polled",
            How::Woken => "woken",
        }
    }
}

impl std::str::FromStr for How {
    type Err = Failed;

    fn from_str(word: &str) -> Result<How, Failed> {
        match word {
            "polled" => Ok(How::Polled),
            "woken" => Ok(How::Woken),
            other => Err(format!("HOW: expected polled or woken, got {other:?}").into()),
        }
    }
}

/// Ages of what was heard, ns, by the place of the sender among those heard.
#[derive(Clone)]
pub struct Ages {
    from_ns: Arc<AtomicU64>,
    by_place: Arc<Vec<Mutex<Vec<u64>>>>,
}

impl Ages {
    /// Of so many senders; nothing counts yet.
    pub fn of(places: usize) -> Ages {
        Ages {
            from_ns: Arc::new(AtomicU64::new(u64::MAX)),
            by_place: Arc::new((0..places).map(|_| Mutex::default()).collect()),
        }
    }

    /// What was sent from now on counts.
    pub fn count_from(&self, from_ns: u64) {
        self.from_ns.store(from_ns, Ordering::Relaxed);
    }

    /// All ages so far.
    pub fn take(&self) -> impl Iterator<Item = Vec<u64>> {
        let lists = self.by_place.iter().map(|list| list.lock().expect("nobody panics with it"));
        lists.map(|mut list| std::mem::take(&mut *list))
    }

    fn heard(&self, place: usize, sent_ns: u64, now_ns: u64) {
        if sent_ns >= self.from_ns.load(Ordering::Relaxed) {
            let mut list = self.by_place[place].lock().expect("nobody panics with it");
            list.push(now_ns.saturating_sub(sent_ns));
        }
    }
}

/// One process's end.
pub trait Transport {
    /// Takes the newest sample of each sender, where samples are polled.
    fn look(&mut self) -> Result<(), Failed>;
    /// Tells everybody who hears this process.
    fn publish(&mut self, payload: &[u8; PAYLOAD_BYTES]) -> Result<(), Failed>;
}

fn number(payload: &[u8], place: usize) -> u64 {
    let bytes = payload.get(8 * place..8 * (place + 1));
    bytes.map_or(0, |bytes| u64::from_le_bytes(bytes.try_into().expect("8 bytes")))
}

/// zenoh: peers that know each other's end points on the loopback interface, over TCP. Samples are
/// express (not batched), of the highest priority, and dropped where there is no room.
pub struct Zenoh {
    publisher: Publisher<'static>,
    ages: Ages,
    polled: Vec<Subscriber<RingChannelHandler<Sample>>>,
    _woken: Vec<Subscriber<()>>,
    _session: zenoh::Session,
}

impl Zenoh {
    /// Connects to the processes before this one, which are there already.
    pub fn new(plan: &Plan, own: usize, heard: &[usize], ages: &Ages) -> Result<Zenoh, Failed> {
        let points = |ports: &[u16]| {
            let points: Vec<String> =
                ports.iter().map(|port| format!("\"tcp/127.0.0.1:{port}\"")).collect();
            format!("[{}]", points.join(", "))
        };
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"peer\"".to_owned()),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("scouting/gossip/enabled", "false".to_owned()),
            ("listen/endpoints", points(&plan.ports[own..=own])),
            ("connect/endpoints", points(&plan.ports[..own])),
        ] {
            config.insert_json5(key, &value)?;
        }
        let session = zenoh::open(config).wait()?;
        let key = |process: usize| format!("neighbors/{process}/beacon");
        let publisher = session
            .declare_publisher(key(own))
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::RealTime)
            .express(true)
            .wait()?;
        let (mut polled, mut woken) = (Vec::new(), Vec::new());
        for (place, &process) in heard.iter().enumerate() {
            let subscriber = session.declare_subscriber(key(process));
            match plan.how {
                How::Polled => polled.push(subscriber.with(RingChannel::new(1)).wait()?),
                How::Woken => {
                    let ages = ages.clone();
                    let take = move |sample: Sample| {
                        let now_ns = clock::now_ns();
                        ages.heard(place, number(&sample.payload().to_bytes(), 0), now_ns);
                    };
                    woken.push(subscriber.callback(take).wait()?);
                }
            }
        }
        Ok(Zenoh { publisher, ages: ages.clone(), polled, _woken: woken, _session: session })
    }
}

impl Transport for Zenoh {
    fn look(&mut self) -> Result<(), Failed> {
        for (place, subscriber) in self.polled.iter().enumerate() {
            while let Some(sample) = subscriber.try_recv()? {
                let now_ns = clock::now_ns();
                self.ages.heard(place, number(&sample.payload().to_bytes(), 0), now_ns);
            }
        }
        Ok(())
    }

    fn publish(&mut self, payload: &[u8; PAYLOAD_BYTES]) -> Result<(), Failed> {
        self.publisher.put(&payload[..]).wait()
    }
}

/// Unix datagrams: a socket for all that comes, in the abstract name space, and one to send from.
pub struct Datagram {
    incoming: UnixDatagram,
    out: UnixDatagram,
    hearers: Vec<SocketAddr>,
    heard: Vec<usize>,
    ages: Ages,
    how: How,
}

impl Datagram {
    /// Binds this process's name; the others' sockets need not be there yet.
    pub fn new(plan: &Plan, own: usize, heard: &[usize], ages: &Ages) -> Result<Datagram, Failed> {
        let address = |process: usize| {
            let name = format!("neighbors-{}-{process}", plan.ports[process]);
            SocketAddr::from_abstract_name(name)
        };
        let hears_own = |process: &usize| plan.heard_by(*process).contains(&own);
        let hearers = (0..plan.robots).filter(hears_own).map(address).collect::<Result<_, _>>()?;
        let incoming = UnixDatagram::bind_addr(&address(own)?)?;
        let out = UnixDatagram::unbound()?;
        out.set_nonblocking(true)?;
        let heard = heard.to_vec();
        match plan.how {
            How::Polled => incoming.set_nonblocking(true)?,
            How::Woken => {
                let (incoming, heard, ages) = (incoming.try_clone()?, heard.clone(), ages.clone());
                // Ends with the process.
                std::thread::spawn(move || {
                    while let Ok((place, sent_ns, now_ns)) = receive(&incoming, &heard) {
                        ages.heard(place, sent_ns, now_ns);
                    }
                });
            }
        }
        Ok(Datagram { incoming, out, hearers, heard, ages: ages.clone(), how: plan.how })
    }
}

/// The next datagram: the sender's place, when it was sent, and when it was taken, ns.
fn receive(socket: &UnixDatagram, heard: &[usize]) -> std::io::Result<(usize, u64, u64)> {
    let mut payload = [0; PAYLOAD_BYTES];
    loop {
        socket.recv(&mut payload)?;
        let now_ns = clock::now_ns();
        let sender = number(&payload, 1) as usize;
        if let Some(place) = heard.iter().position(|&process| process == sender) {
            return Ok((place, number(&payload, 0), now_ns));
        }
    }
}

impl Transport for Datagram {
    fn look(&mut self) -> Result<(), Failed> {
        if self.how == How::Woken {
            return Ok(());
        }
        let mut newest = vec![None; self.heard.len()];
        loop {
            match receive(&self.incoming, &self.heard) {
                Ok((place, sent_ns, now_ns)) => newest[place] = Some((sent_ns, now_ns)),
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error.into()),
            }
        }
        for (place, newest) in newest.into_iter().enumerate() {
            if let Some((sent_ns, now_ns)) = newest {
                self.ages.heard(place, sent_ns, now_ns);
            }
        }
        Ok(())
    }

    fn publish(&mut self, payload: &[u8; PAYLOAD_BYTES]) -> Result<(), Failed> {
        for hearer in &self.hearers {
            // No room, not there yet, or gone already: a sample is lost, as with the others.
            let _ = self.out.send_to_addr(payload, hearer);
        }
        Ok(())
    }
}
