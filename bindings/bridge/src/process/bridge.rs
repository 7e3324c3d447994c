//! Main loop of a bridge: forwards frames that have arrived, and does periodic work.

use std::sync::Arc;

use protocol::brief::BridgeBrief;
use protocol::clock;
use protocol::dropped::Dropped;
use protocol::message::{BridgeHeader, PeerRow, Plain};
use protocol::process::Failure;
use protocol::service::{self, Node, Publisher, send_slice};

use super::inbox::{Arrived, Inbox};
use super::ports::{self, CommandPort, PortError, Sink, Source};
use super::refusals;
use super::status_forwarder::StatusForwarder;
use super::times::Times;
use super::wire::PeerSessions;
use crate::clock::Stamps;
use crate::frame::{Header, VERSION, decode_slice};
use crate::gate::Gate;
use crate::topics::{self, Route, Topic};

/// Period of polling samples of this host, ns. It adds half of it to their age on average.
const LOOK_EVERY_NS: u64 = 500_000;
/// Period of clock measurements after the first [`FIRST_ASKS`], ns.
const ASK_EVERY_NS: u64 = 200_000_000;
const FIRST_ASK_EVERY_NS: u64 = 20_000_000;
const FIRST_ASKS: u64 = 16;
/// Period of forwarding status and latencies to the supervisor, and of reopening lost connections, ns.
const TELL_EVERY_NS: u64 = 20_000_000;
/// Period of the status message to the supervisor, ns.
const STATUS_EVERY_NS: u64 = 100_000_000;
/// Time for which a stamp that was delivered here may be answered, ns: longer than any sample is used.
const STAMPS_KEPT_NS: u64 = 10_000_000_000;

/// A route that starts at this host.
struct Out {
    route: usize,
    topic: Topic,
    /// Source of the samples on this route; `None` for the bridge itself.
    source: Option<Source>,
    layout: u64,
    sequence: u64,
}

/// State of a running bridge.
pub(super) struct Bridge {
    brief: BridgeBrief,
    experiment: u64,
    routes: Vec<Route>,
    outs: Vec<Out>,
    /// Destination of the samples of each route that ends here.
    sinks: Vec<Option<Sink>>,
    /// Port for the commands of each remote robot, on the plant's host.
    commands: Vec<Option<CommandPort>>,
    inbox: Arc<Inbox>,
    /// Counters since the start.
    counts: BridgeHeader,
    times: Times,
    /// Time of the last message of each host, ns.
    heard_ns: Vec<Option<u64>>,
    forwarder: StatusForwarder,
    status: Publisher<[PeerRow], BridgeHeader>,
    due: NextTimes,
    asks: u64,
    // Dropped last, after its senders and ports.
    wire: PeerSessions,
    _node: Node,
}

/// Next times of periodic work, ns.
#[derive(Default)]
struct NextTimes {
    look_ns: u64,
    ask_ns: u64,
    tell_ns: u64,
    status_ns: u64,
}

/// Returns whether work is due at `now_ns`. If so, moves `at_ns` by one period.
fn advance_if_due(at_ns: &mut u64, now_ns: u64, every_ns: u64) -> bool {
    let is_due = now_ns >= *at_ns;
    if is_due {
        *at_ns = (*at_ns + every_ns).max(now_ns + every_ns / 2);
    }
    is_due
}

impl Bridge {
    pub(super) fn open(brief: BridgeBrief) -> Result<Bridge, Failure> {
        let experiment = u64::from_str_radix(&brief.experiment, 16).expect("checked when read");
        let (here, plant) = (brief.here, brief.plant);
        let (hosts, robots) = (brief.hosts.len(), brief.robots.len());
        let name = brief.hosts[here].name.clone();
        let node = service::node(&format!("bridge-{name}"))?;
        let mut routes = topics::routes(&brief);
        routes.retain(|route| route.from == here || route.to.contains(&here));
        let status = service::bridge(&name).open(&node)?.publisher(hosts)?;
        let inbox = Arc::new(Inbox::new(routes.len(), hosts));
        let (mut outs, mut sinks) = (Vec::new(), Vec::new());
        let mut commands: Vec<Option<CommandPort>> = (0..robots).map(|_| None).collect();
        for (place, &Route { topic, from, .. }) in routes.iter().enumerate() {
            let layout = ports::layout(topic);
            if from == here {
                let source = ports::source(&brief, &node, topic)?;
                outs.push(Out { route: place, topic, source, layout, sequence: 0 });
                sinks.push(None);
                continue;
            }
            sinks.push(ports::sink(&brief, &node, topic)?);
            if let Topic::Command(robot) = topic {
                commands[robot] = Some(CommandPort::open(&brief, &node, robot)?);
            }
            let all = matches!(topic, Topic::Told(_));
            inbox.open(place, from, Gate::new(from, layout, experiment), all);
        }
        let wire = PeerSessions::open(&brief, &routes, &inbox)?;
        Ok(Bridge {
            experiment,
            routes,
            outs,
            sinks,
            commands,
            inbox,
            counts: BridgeHeader { boot: random(), ..BridgeHeader::default() },
            times: Times::new(here == plant, robots, STAMPS_KEPT_NS),
            heard_ns: vec![None; hosts],
            forwarder: StatusForwarder::open(&brief, &node)?,
            status,
            due: NextTimes::default(),
            asks: 0,
            wire,
            _node: node,
            brief,
        })
    }

    /// Returns the name of this host.
    pub(super) fn host(&self) -> &str {
        &self.brief.hosts[self.brief.here].name
    }

    /// Closes all connections.
    pub(super) fn close(self) {
        self.wire.close();
    }

    /// Delivers the frames that have arrived, and does the periodic work that is due. Waits until either is
    /// possible.
    pub(super) fn iterate(&mut self) -> Result<(), Failure> {
        for arrived in self.inbox.wait(self.due.look_ns) {
            self.receive_frame(&arrived)?;
        }
        let now_ns = clock::now_ns();
        if advance_if_due(&mut self.due.look_ns, now_ns, LOOK_EVERY_NS) {
            self.send_samples(now_ns)?;
        }
        let asking = self.brief.here != self.brief.plant;
        let ask_every_ns = if self.asks < FIRST_ASKS { FIRST_ASK_EVERY_NS } else { ASK_EVERY_NS };
        if asking && advance_if_due(&mut self.due.ask_ns, now_ns, ask_every_ns) {
            self.asks += 1;
            self.send(|topic| matches!(topic, Topic::Ask(_)), &bytes(&[clock::now_ns()]));
        }
        if advance_if_due(&mut self.due.tell_ns, now_ns, TELL_EVERY_NS) {
            self.wire.mend();
            self.forward_status(now_ns)?;
        }
        if advance_if_due(&mut self.due.status_ns, now_ns, STATUS_EVERY_NS) {
            self.times.forget(now_ns);
            self.report(now_ns)?;
        }
        Ok(())
    }

    /// Sends the newest samples of this host to other hosts.
    fn send_samples(&mut self, now_ns: u64) -> Result<(), Failure> {
        let head = self.head(now_ns);
        let Bridge { outs, times, counts, wire, .. } = self;
        for out in outs {
            let Some(source) = &mut out.source else { continue };
            match source(times, now_ns) {
                Ok(Some(content)) => send(wire, out, head, &content, counts),
                Ok(None) => {}
                Err(PortError::Dropped(why)) => counts.dropped[why as usize] += 1,
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Delivers a frame of another host, or drops it and counts the reason.
    fn receive_frame(&mut self, arrived: &Arrived) -> Result<(), Failure> {
        match self.deliver(arrived, clock::now_ns()) {
            Ok(()) => self.counts.taken += 1,
            Err(PortError::Dropped(why)) => self.counts.dropped[why as usize] += 1,
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    fn deliver(&mut self, arrived: &Arrived, now_ns: u64) -> Result<(), PortError> {
        let Route { topic, from, .. } = self.routes[arrived.route];
        let content = arrived.content.as_slice();
        let (brief, times) = (&self.brief, &mut self.times);
        let run_ns = times.run_ns(now_ns);
        if run_ns.is_some_and(|t_ns| brief.are_apart(brief.here, from, t_ns)) {
            return Err(Dropped::Partition.into());
        }
        self.heard_ns[from] = Some(now_ns);
        match topic {
            Topic::Command(robot) => {
                let port = self.commands[robot].as_mut().expect("it ends here");
                port.deliver(times, content, now_ns, brief.odometry_age_ns_max)?;
            }
            Topic::Told(_) => {
                for robot in self.forwarder.receive_batch(from, arrived.header.boot, content)? {
                    // The robot has sent something, so it is running, which the plant waits for.
                    if let Some(port) = &mut self.commands[robot] {
                        port.is_there()?;
                    }
                }
            }
            Topic::Confirmed(_) => {
                let [boot, next] = numbers(content)?;
                if boot == self.counts.boot {
                    self.forwarder.queue.acknowledge(next);
                }
            }
            Topic::Ask(host) => {
                let [asked_ns] = numbers(content)?;
                let stamps = bytes(&[asked_ns, arrived.at_ns, clock::now_ns()]);
                self.send(|topic| topic == Topic::Answer(host), &stamps);
            }
            Topic::Answer(_) => {
                let [sent_ns, there_taken_ns, there_sent_ns] = numbers(content)?;
                let taken_ns = arrived.at_ns;
                if !times.measured(&Stamps {
                    sent_ns,
                    remote_received_ns: there_taken_ns,
                    remote_sent_ns: there_sent_ns,
                    received_ns: taken_ns,
                }) {
                    return Err(Dropped::Clock.into());
                }
            }
            _ => {
                let sink = self.sinks[arrived.route].as_mut().expect("it ends here");
                sink(times, content, now_ns)?;
            }
        }
        Ok(())
    }

    /// Sends status and latencies to the plant's host, or forwards them to the supervisor there, and acknowledges
    /// them.
    fn forward_status(&mut self, now_ns: u64) -> Result<(), Failure> {
        if let Some(batch) = self.forwarder.batch(now_ns)? {
            self.send(|topic| matches!(topic, Topic::Told(_)), &batch);
        }
        for why in self.forwarder.publish_records()? {
            self.counts.dropped[why as usize] += 1;
        }
        for (host, confirmed) in self.forwarder.acknowledgments() {
            self.send(|topic| topic == Topic::Confirmed(host), &bytes(&confirmed));
        }
        Ok(())
    }

    /// Sends the bridge status to the own supervisor and to that of the plant's host.
    fn report(&mut self, now_ns: u64) -> Result<(), Failure> {
        for (why, words) in refusals::take_first_refusals() {
            tracing::warn!(
                why = why.keyword(),
                "refused; further refusals are only counted: {words}"
            );
        }
        let mut header = self.counts;
        for why in Dropped::ALL {
            header.dropped[why as usize] +=
                self.inbox.dropped_count(why) + refusals::refusal_count(why);
        }
        header.unconfirmed = self.forwarder.queue.len_unacked() as u64;
        header.told_dropped = self.forwarder.queue.dropped;
        let [round_trip_ns, uncertainty_ns_max] = self.times.round_trip_and_error_ns();
        let peers = topics::peers(&self.brief, self.brief.here).into_iter();
        let rows: Vec<PeerRow> = peers
            .map(|host| {
                let of_plant = |ns: u64| if host == self.brief.plant { ns } else { 0 };
                let silent_ns = |heard_ns| now_ns.saturating_sub(heard_ns);
                PeerRow {
                    host: host as u64,
                    silent_ns: self.heard_ns[host].map_or(u64::MAX, silent_ns),
                    round_trip_ns: of_plant(round_trip_ns),
                    uncertainty_ns_max: of_plant(uncertainty_ns_max),
                }
            })
            .collect();
        send_slice(&self.status, header, rows.len(), |place| rows[place])
            .map_err(PortError::from)?;
        let mut content = header.bytes().to_vec();
        rows.iter().for_each(|row| content.extend(row.bytes()));
        self.send(|topic| matches!(topic, Topic::Bridge(_)), &content);
        Ok(())
    }

    /// Sends a message of the bridge itself on all topics for which `is_meant` returns `true`.
    fn send(&mut self, is_meant: impl Fn(Topic) -> bool, content: &[u8]) {
        let head = self.head(clock::now_ns());
        let Bridge { outs, counts, wire, .. } = self;
        for out in outs.iter_mut().filter(|out| is_meant(out.topic)) {
            send(wire, out, head, content, counts);
        }
    }

    /// Returns the common fields of the headers of frames sent now.
    fn head(&mut self, now_ns: u64) -> Header {
        Header {
            version: VERSION,
            host: self.brief.here as u16,
            layout: 0,
            experiment: self.experiment,
            boot: self.counts.boot,
            sequence: 0,
            source_ns: self.times.plant_ns(now_ns).unwrap_or(0),
        }
    }
}

/// Sends one frame. If the queue is full, zenoh drops it.
fn send(
    wire: &PeerSessions,
    out: &mut Out,
    head: Header,
    content: &[u8],
    counts: &mut BridgeHeader,
) {
    out.sequence += 1;
    let header = Header { layout: out.layout, sequence: out.sequence, ..head };
    match wire.send(out.route, header.frame(&[content])) {
        Ok(()) => {
            counts.sent += 1;
            counts.samples_sent += u64::from(out.topic.is_of_robot());
        }
        Err(error) => tracing::debug!(%error, topic = ?out.topic, "not sent"),
    }
}

fn bytes(numbers: &[u64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Decodes content of exactly `COUNT` numbers.
fn numbers<const COUNT: usize>(content: &[u8]) -> Result<[u64; COUNT], Dropped> {
    let (_, numbers) = decode_slice::<u64, ()>(content).ok_or(Dropped::Garbage)?;
    numbers.try_into().map_err(|_| Dropped::Garbage)
}

/// Returns a random number that identifies this bridge process.
fn random() -> u64 {
    use std::hash::{BuildHasher as _, Hasher as _};
    let mut hasher = std::collections::hash_map::RandomState::new().build_hasher();
    hasher.write_u64(clock::now_ns());
    hasher.write_u32(std::process::id());
    hasher.finish()
}
