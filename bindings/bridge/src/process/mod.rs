//! The process `phalanx bridge`: what crosses between hosts goes through the bridges of both.
//!
//! One loop takes what this host has for others every half a millisecond, and what arrives from others
//! at once. It waits for nobody: whatever finds no place on its way is dropped, and the next sample is newer.
//!
//! | file | question it answers |
//! |---|---|
//! | `config` | what is zenoh told? |
//! | `wire` | how do samples get to other hosts? |
//! | `inbox` | what arrived? |
//! | `local` | which ports has it in this host's share of the run? |
//! | `times` | what becomes of the stamps of a sample? |
//! | `refusals` | what did zenoh refuse before it was a frame? |

pub mod config;
pub mod inbox;
mod local;
pub mod refusals;
mod times;
pub mod wire;

use std::path::Path;
use std::sync::Arc;

use protocol::brief::{self, BridgeBrief, BriefError};
use protocol::clock;
use protocol::message::{
    Beacon, BridgeHeader, Command, LatencyHeader, LatencyRow, NeighborStatus, Odometry,
    OrderHeader, OrderRow, PeerRow, Plain, ReportHeader, ReportRow, StatusHeader,
};
use protocol::process::{self, Stop, Turns, exit};
use protocol::run_root::{self, RunRootError};
use protocol::service::{self, Node, Publisher, Subscriber, send_slice};

use self::inbox::{Arrived, Inbox};
use self::local::{PortError, Retelling, Sink, Source, Telling, newest};
use self::times::Times;
use self::wire::Wire;
use crate::clock::Stamps;
use crate::counters::{Counters, Dropped};
use crate::frame::{self, Header, VERSION, slice_of};
use crate::gate::Gate;
use crate::told::{Heard, Kind, Log, Record};
use crate::topics::{self, Route, Topic};
use crate::wire::WireError;

/// How often it looks for samples of this host, ns: what this adds to their age is half of it on
/// average.
const LOOK_EVERY_NS: u64 = 500_000;
/// How often clocks are compared, ns; the first times more often.
const ASK_EVERY_NS: u64 = 200_000_000;
const FIRST_ASK_EVERY_NS: u64 = 20_000_000;
const FIRST_ASKS: u64 = 16;
/// How often what robots tell the supervisor is taken, sent and handed on, and links that are lost are opened
/// again, ns.
const TELL_EVERY_NS: u64 = 20_000_000;
/// How often it tells its supervisor how it is doing, ns.
const STATUS_EVERY_NS: u64 = 100_000_000;
/// What is told is handed on so much at a time for each robot: the supervisor's queues hold more.
const RETOLD_MAX: usize = 4;
/// How long a stamp that was delivered here may be answered, ns: longer than any sample is used.
const STAMPS_KEPT_NS: u64 = 10_000_000_000;

/// Why a bridge gave up.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// Its brief is unreadable.
    #[error(transparent)]
    Brief(#[from] BriefError),
    /// The run it belongs to is not there.
    #[error(transparent)]
    RunRoot(#[from] RunRootError),
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// No connection.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// Signals cannot be handled.
    #[error("cannot handle signals: {0}")]
    Signals(#[from] std::io::Error),
}

/// What the process does: named, logging, and with an exit code that tells.
pub fn main(brief_path: &Path, realtime_priority: bool) -> u8 {
    process::set_name("phalanx-bridge");
    process::log_to_stderr_and(refusals::Listener::layer(), refusals::is_counted);
    if realtime_priority {
        process::hurry();
    }
    match run(brief_path) {
        Ok(()) => exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            exit::INFRASTRUCTURE
        }
    }
}

/// Carries what the brief says until told to stop.
pub fn run(brief_path: &Path) -> Result<(), BridgeError> {
    let brief: BridgeBrief = brief::read(brief_path)?;
    let stop = Stop::on_signals()?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    process::take_turns(Turns::Short);
    let mut bridge = Bridge::open(brief)?;
    tracing::info!(host = bridge.brief.hosts[bridge.brief.here].name, "ready");
    while !stop.requested() {
        bridge.turn()?;
    }
    bridge.wire.close();
    Ok(())
}

/// A route that begins here, by its place.
struct Out {
    route: usize,
    topic: Topic,
    source: Source,
    layout: u64,
    sequence: u64,
}

struct Bridge {
    brief: BridgeBrief,
    experiment: u64,
    boot: u64,
    routes: Vec<Route>,
    outs: Vec<Out>,
    /// By route, those that end here.
    sinks: Vec<Option<Sink>>,
    inbox: Arc<Inbox>,
    counters: Counters,
    times: Times,
    /// When each host was heard last, ns.
    heard_ns: Vec<Option<u64>>,
    tellings: Vec<Telling>,
    log: Log,
    retellings: Vec<Option<Retelling>>,
    /// What other hosts' robots told and was not handed on, by robot.
    retold: Vec<std::collections::VecDeque<Record>>,
    /// What arrived of other hosts' logs.
    heard: Vec<Heard>,
    status: Publisher<[PeerRow], BridgeHeader>,
    due: Due,
    asks: u64,
    // Last: its senders and ports must go first.
    wire: Wire,
    _node: Node,
}

/// When what is due next, ns.
#[derive(Default)]
struct Due {
    look_ns: u64,
    ask_ns: u64,
    tell_ns: u64,
    status_ns: u64,
}

/// Whether it is time; if so, the next time is one period on.
fn due(at_ns: &mut u64, now_ns: u64, every_ns: u64) -> bool {
    let is_due = now_ns >= *at_ns;
    if is_due {
        *at_ns = (*at_ns + every_ns).max(now_ns + every_ns / 2);
    }
    is_due
}

/// The layout of the content of a topic.
fn layout(topic: Topic) -> u64 {
    match topic {
        Topic::Beacon(_) => Beacon::LAYOUT,
        Topic::Odometry(_) => Odometry::LAYOUT,
        Topic::Command(_) => Command::LAYOUT,
        Topic::Orders(_) => frame::layout::<OrderRow, OrderHeader>(),
        Topic::Report(_) => frame::layout::<ReportRow, ReportHeader>(),
        Topic::Bridge(_) => frame::layout::<PeerRow, BridgeHeader>(),
        Topic::Told(_) => {
            frame::layout::<NeighborStatus, StatusHeader>()
                ^ frame::layout::<LatencyRow, LatencyHeader>().rotate_left(7)
        }
        Topic::Confirmed(_) | Topic::Ask(_) | Topic::Answer(_) => frame::layout::<u64, ()>(),
    }
}

impl Bridge {
    fn open(brief: BridgeBrief) -> Result<Bridge, BridgeError> {
        let experiment = u64::from_str_radix(&brief.experiment, 16).expect("checked when read");
        let (here, plant) = (brief.here, brief.plant);
        let name = brief.hosts[here].name.clone();
        let node = service::node(&format!("bridge-{name}")).map_err(PortError::from)?;
        let routes: Vec<Route> = topics::routes(&brief)
            .into_iter()
            .filter(|route| route.from == here || route.to.contains(&here))
            .collect();
        let status = service::bridge(&name).open(&node).map_err(PortError::from)?;
        let status = status.publisher(brief.hosts.len()).map_err(PortError::from)?;
        let inbox = Arc::new(Inbox::new(routes.len(), brief.hosts.len()));
        let (mut outs, mut sinks) = (Vec::new(), Vec::new());
        for (place, route) in routes.iter().enumerate() {
            let Route { topic, from, .. } = *route;
            let layout = layout(topic);
            if from == here {
                let source = local::source(&brief, &node, route)?;
                outs.push(Out { route: place, topic, source, layout, sequence: 0 });
                sinks.push(None);
            } else {
                sinks.push(Some(local::sink(&brief, &node, route)?));
                let all = matches!(topic, Topic::Told(_));
                inbox.open(place, from, Gate::new(from, layout, experiment), all);
            }
        }
        let wire = Wire::open(&brief, &routes, &inbox)?;
        let robots = brief.robots.len();
        Ok(Bridge {
            experiment,
            boot: random(),
            routes,
            outs,
            sinks,
            inbox,
            counters: Counters::default(),
            times: Times::new(here == plant, robots, STAMPS_KEPT_NS),
            heard_ns: vec![None; brief.hosts.len()],
            tellings: local::tellings(&brief, &node)?,
            log: Log::default(),
            retellings: local::retellings(&brief, &node)?,
            retold: (0..robots).map(|_| Default::default()).collect(),
            heard: (0..brief.hosts.len()).map(|_| Heard::default()).collect(),
            status,
            due: Due::default(),
            asks: 0,
            wire,
            _node: node,
            brief,
        })
    }

    /// What arrived, and what is due.
    fn turn(&mut self) -> Result<(), BridgeError> {
        for arrived in self.inbox.wait(self.due.look_ns) {
            self.take(&arrived)?;
        }
        let now_ns = clock::now_ns();
        if due(&mut self.due.look_ns, now_ns, LOOK_EVERY_NS) {
            self.look(now_ns)?;
        }
        let asking = self.brief.here != self.brief.plant;
        let ask_every_ns = if self.asks < FIRST_ASKS { FIRST_ASK_EVERY_NS } else { ASK_EVERY_NS };
        if asking && due(&mut self.due.ask_ns, now_ns, ask_every_ns) {
            self.asks += 1;
            self.send_own(|topic| matches!(topic, Topic::Ask(_)), &[clock::now_ns()]);
        }
        if due(&mut self.due.tell_ns, now_ns, TELL_EVERY_NS) {
            self.wire.mend();
            self.tell(now_ns)?;
            self.hand_on()?;
            self.confirm();
        }
        if due(&mut self.due.status_ns, now_ns, STATUS_EVERY_NS) {
            self.times.forget(now_ns);
            self.report(now_ns)?;
        }
        Ok(())
    }

    /// Takes what this host has for others.
    fn look(&mut self, now_ns: u64) -> Result<(), BridgeError> {
        let head = self.head(now_ns);
        let Bridge { outs, times, counters, wire, .. } = self;
        for out in outs {
            match &out.source {
                Source::Beacon(from) => {
                    let Some(beacon) = newest(from)? else { continue };
                    match times.beacon_out(beacon, now_ns) {
                        Ok(beacon) => send(wire, out, head, &[beacon.bytes()], counters),
                        Err(why) => counters.drop(why),
                    }
                }
                Source::Command(from) => {
                    let Some(command) = newest(from)? else { continue };
                    match times.command_out(command, now_ns) {
                        Ok(command) => send(wire, out, head, &[command.bytes()], counters),
                        Err(why) => counters.drop(why),
                    }
                }
                Source::Odometry(from) => {
                    let Some(odometry) = newest(from)? else { continue };
                    times.run_began(odometry.stamp_ns.saturating_sub(odometry.t_ns));
                    send(wire, out, head, &[odometry.bytes()], counters);
                }
                Source::Orders(from) => {
                    if let Some(content) = newest_slice(from)? {
                        send(wire, out, head, &[&content], counters);
                    }
                }
                Source::Report(from) => {
                    if let Some(content) = newest_slice(from)? {
                        send(wire, out, head, &[&content], counters);
                    }
                }
                Source::Own => {}
            }
        }
        Ok(())
    }

    /// Takes a sample of another host over, or drops it.
    fn take(&mut self, arrived: &Arrived) -> Result<(), BridgeError> {
        let route = &self.routes[arrived.route];
        let (topic, from) = (route.topic, route.from);
        let now_ns = clock::now_ns();
        if self
            .times
            .run_ns(now_ns)
            .is_some_and(|t_ns| topics::apart(&self.brief, self.brief.here, from, t_ns))
        {
            self.counters.drop(Dropped::Partition);
            return Ok(());
        }
        self.heard_ns[from] = Some(now_ns);
        let taken = self.deliver(topic, from, arrived, now_ns)?;
        match taken {
            Ok(()) => self.counters.taken += 1,
            Err(why) => self.counters.drop(why),
        }
        Ok(())
    }

    fn deliver(
        &mut self,
        topic: Topic,
        from: usize,
        arrived: &Arrived,
        now_ns: u64,
    ) -> Result<Result<(), Dropped>, BridgeError> {
        let content = arrived.content.as_slice();
        let brief = &self.brief;
        let (odometry_age, beacon_age) = (brief.odometry_age_ns_max, brief.beacon_age_ns_max);
        let times = &mut self.times;
        let sink = self.sinks[arrived.route].as_mut().expect("it ends here");
        match (topic, sink) {
            (Topic::Beacon(_), Sink::Beacon(to)) => {
                let beacon = Beacon::of_bytes(content).ok_or(Dropped::Garbage);
                let beacon = beacon.and_then(|beacon| match beacon.is_plausible() {
                    true => times.beacon_in(beacon, now_ns, beacon_age),
                    false => Err(Dropped::Implausible),
                });
                return deliver_one(to, beacon);
            }
            (Topic::Odometry(robot), Sink::Odometry(to)) => {
                let odometry = Odometry::of_bytes(content).ok_or(Dropped::Garbage);
                let odometry = odometry.and_then(|odometry| match is_plausible(&odometry) {
                    true => times.odometry_in(robot, odometry, now_ns, odometry_age),
                    false => Err(Dropped::Implausible),
                });
                return deliver_one(to, odometry);
            }
            (Topic::Command(_), Sink::Command(service, to)) => {
                let command = Command::of_bytes(content).ok_or(Dropped::Garbage);
                let command = command.and_then(|command| match command.is_plausible() {
                    true => times.command_in(command, now_ns, odometry_age),
                    false => Err(Dropped::Implausible),
                });
                if to.is_none() {
                    *to = Some(service.publisher().map_err(PortError::from)?);
                }
                return deliver_one(to.as_ref().expect("just made"), command);
            }
            (Topic::Orders(_), Sink::Orders(to)) => return deliver_slice(to, content),
            (Topic::Report(_), Sink::Report(to)) => return deliver_slice(to, content),
            (Topic::Bridge(_), Sink::Bridge(to)) => return deliver_slice(to, content),
            (Topic::Told(_), Sink::Own) => {
                let records = self.heard[from].take(arrived.header.boot, content);
                let Some(records) = records else { return Ok(Err(Dropped::Garbage)) };
                let own = |record: &Record| {
                    brief.robots.get(record.robot).is_some_and(|robot| robot.host == from)
                };
                if !records.iter().all(own) {
                    return Ok(Err(Dropped::Owner));
                }
                for record in records {
                    self.is_there(record.robot)?;
                    self.retold[record.robot].push_back(record);
                }
            }
            (Topic::Confirmed(_), Sink::Own) => match slice_of::<u64, ()>(content) {
                Some((_, numbers)) if numbers.len() == 2 => {
                    if numbers[0] == self.boot {
                        self.log.confirm(numbers[1]);
                    }
                }
                _ => return Ok(Err(Dropped::Garbage)),
            },
            (Topic::Ask(host), Sink::Own) => match slice_of::<u64, ()>(content) {
                Some((_, asked)) if asked.len() == 1 => {
                    let taken_ns = arrived.at_ns;
                    let stamps = [asked[0], taken_ns, clock::now_ns()];
                    self.send_own(|topic| topic == Topic::Answer(host), &stamps);
                }
                _ => return Ok(Err(Dropped::Garbage)),
            },
            (Topic::Answer(_), Sink::Own) => match slice_of::<u64, ()>(content) {
                Some((_, stamps)) if stamps.len() == 3 => {
                    let stamps = Stamps {
                        sent_ns: stamps[0],
                        there_taken_ns: stamps[1],
                        there_sent_ns: stamps[2],
                        taken_ns: arrived.at_ns,
                    };
                    if !times.measured(&stamps) {
                        return Ok(Err(Dropped::Clock));
                    }
                }
                _ => return Ok(Err(Dropped::Garbage)),
            },
            _ => unreachable!("a topic has its own sink"),
        }
        Ok(Ok(()))
    }

    /// A robot of another host said something: it is there, which the plant waits for.
    fn is_there(&mut self, robot: usize) -> Result<(), BridgeError> {
        let place = self.routes.iter().position(|route| route.topic == Topic::Command(robot));
        let sink = place.and_then(|place| self.sinks[place].as_mut());
        if let Some(Sink::Command(service, to @ None)) = sink {
            *to = Some(service.publisher().map_err(PortError::from)?);
        }
        Ok(())
    }

    /// Takes in what the robots of this host tell, and sends what is not confirmed.
    fn tell(&mut self, now_ns: u64) -> Result<(), BridgeError> {
        for telling in &self.tellings {
            let robot = telling.robot;
            while let Some(content) = next_slice(&telling.status)? {
                self.log.push(Record { kind: Kind::Status, robot, content });
            }
            while let Some(content) = next_slice(&telling.latency)? {
                self.log.push(Record { kind: Kind::Latency, robot, content });
            }
        }
        if self.tellings.is_empty() {
            return Ok(());
        }
        if let Some(batch) = self.log.batch(now_ns) {
            let head = self.head(now_ns);
            let Bridge { outs, counters, wire, .. } = self;
            let out = outs.iter_mut().find(|out| matches!(out.topic, Topic::Told(_)));
            if let Some(out) = out {
                send(wire, out, head, &[&batch], counters);
            }
        }
        Ok(())
    }

    /// Hands on what other hosts' robots told, no faster than the supervisor takes it.
    fn hand_on(&mut self) -> Result<(), BridgeError> {
        for (records, retelling) in self.retold.iter_mut().zip(&self.retellings) {
            let Some(retelling) = retelling else { continue };
            for _ in 0..RETOLD_MAX {
                let Some(Record { kind, content, .. }) = records.pop_front() else { break };
                let taken = match kind {
                    Kind::Status => deliver_slice(&retelling.status, &content)?,
                    Kind::Latency => deliver_slice(&retelling.latency, &content)?,
                };
                if let Err(why) = taken {
                    self.counters.drop(why);
                }
            }
        }
        Ok(())
    }

    /// Tells other hosts up to where what their robots told has arrived, once all of it was handed on: a host
    /// that is confirmed may end, and the run with it.
    fn confirm(&mut self) {
        for host in 0..self.heard.len() {
            let mut robots = self.brief.robots.iter().zip(&self.retold);
            if robots.any(|(robot, waiting)| robot.host == host && !waiting.is_empty()) {
                continue;
            }
            if let Some(confirmed) = self.heard[host].confirmed() {
                self.send_own(|topic| topic == Topic::Confirmed(host), &confirmed);
            }
        }
    }

    /// Tells the supervisor how it is doing, and that of the plant's host.
    fn report(&mut self, now_ns: u64) -> Result<(), BridgeError> {
        for (why, words) in refusals::news() {
            tracing::warn!(why = why.word(), "refused, and counted from here on: {words}");
        }
        let mut header = self.counters.told();
        for why in Dropped::ALL {
            header.dropped[why as usize] += self.inbox.dropped(why) + refusals::counted(why);
        }
        header.boot = self.boot;
        header.unconfirmed = self.log.unconfirmed() as u64;
        header.told_dropped = self.log.dropped;
        let [round_trip_ns, uncertainty_ns_max] = self.times.quality();
        let peers = topics::peers(&self.brief, self.brief.here);
        let rows: Vec<PeerRow> = peers
            .into_iter()
            .map(|host| {
                let of_plant = |ns: u64| if host == self.brief.plant { ns } else { 0 };
                PeerRow {
                    host: host as u64,
                    silent_ns: self.heard_ns[host]
                        .map_or(u64::MAX, |heard_ns| now_ns.saturating_sub(heard_ns)),
                    round_trip_ns: of_plant(round_trip_ns),
                    uncertainty_ns_max: of_plant(uncertainty_ns_max),
                }
            })
            .collect();
        send_slice(&self.status, header, rows.len(), |place| rows[place])
            .map_err(PortError::from)?;
        let head = self.head(now_ns);
        let Bridge { outs, counters, wire, .. } = self;
        for out in outs.iter_mut().filter(|out| matches!(out.topic, Topic::Bridge(_))) {
            let mut content = header.bytes().to_vec();
            rows.iter().for_each(|row| content.extend(row.bytes()));
            send(wire, out, head, &[&content], counters);
        }
        Ok(())
    }

    /// Sends numbers of its own under the topics that are meant.
    fn send_own(&mut self, meant: impl Fn(Topic) -> bool, numbers: &[u64]) {
        let head = self.head(clock::now_ns());
        let content: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let Bridge { outs, counters, wire, .. } = self;
        for out in outs.iter_mut().filter(|out| meant(out.topic)) {
            send(wire, out, head, &[&content], counters);
        }
    }

    /// What all frames sent now begin with.
    fn head(&mut self, now_ns: u64) -> Header {
        Header {
            version: VERSION,
            host: self.brief.here as u16,
            layout: 0,
            experiment: self.experiment,
            boot: self.boot,
            sequence: 0,
            source_ns: self.times.plant_ns(now_ns).unwrap_or(0),
        }
    }
}

/// Sends one frame. What finds no place is dropped by zenoh.
fn send(wire: &Wire, out: &mut Out, head: Header, parts: &[&[u8]], counters: &mut Counters) {
    out.sequence += 1;
    let header = Header { layout: out.layout, sequence: out.sequence, ..head };
    match wire.send(out.route, header.frame(parts)) {
        Ok(()) => {
            counters.sent += 1;
            counters.samples_sent += u64::from(out.topic.is_of_robot());
        }
        Err(error) => tracing::debug!(%error, topic = ?out.topic, "not sent"),
    }
}

fn deliver_one<M>(
    to: &Publisher<M>,
    message: Result<M, Dropped>,
) -> Result<Result<(), Dropped>, BridgeError>
where
    M: Copy + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    match message {
        Ok(message) => {
            to.send_copy(message).map_err(PortError::from)?;
            Ok(Ok(()))
        }
        Err(why) => Ok(Err(why)),
    }
}

fn deliver_slice<P, H>(
    to: &Publisher<[P], H>,
    content: &[u8],
) -> Result<Result<(), Dropped>, BridgeError>
where
    P: Plain + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
    H: Plain + std::fmt::Debug + Default + iceoryx2::prelude::ZeroCopySend,
{
    let Some((header, rows)) = slice_of::<P, H>(content) else { return Ok(Err(Dropped::Garbage)) };
    match send_slice(to, header, rows.len(), |place| rows[place]) {
        Ok(_) => Ok(Ok(())),
        // Longer than any that is sent here.
        Err(service::SendError::Loan { .. }) => Ok(Err(Dropped::Implausible)),
        Err(error) => Err(PortError::from(error).into()),
    }
}

/// The next slice that waits, as it lies in memory.
fn next_slice<P, H>(from: &Subscriber<[P], H>) -> Result<Option<Vec<u8>>, BridgeError>
where
    P: Plain + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
    H: Plain + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let Some(sample) = from.receive().map_err(PortError::from)? else { return Ok(None) };
    let mut content = sample.user_header().bytes().to_vec();
    sample.payload().iter().for_each(|row| content.extend(row.bytes()));
    Ok(Some(content))
}

fn newest_slice<P, H>(from: &Subscriber<[P], H>) -> Result<Option<Vec<u8>>, BridgeError>
where
    P: Plain + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
    H: Plain + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let mut newest = None;
    while let Some(content) = next_slice(from)? {
        newest = Some(content);
    }
    Ok(newest)
}

/// Whether a plant that works could have said this.
fn is_plausible(odometry: &Odometry) -> bool {
    let Odometry { x_m, y_m, heading_rad, v_m_s, w_rad_s, .. } = *odometry;
    let near = odometry.near.iter().chain(&odometry.walls).flatten();
    near.chain(&[x_m, y_m, heading_rad, v_m_s, w_rad_s]).all(|number| number.is_finite())
}

/// A number that no other bridge has.
fn random() -> u64 {
    use std::hash::{BuildHasher as _, Hasher as _};
    let mut hasher = std::collections::hash_map::RandomState::new().build_hasher();
    hasher.write_u64(clock::now_ns());
    hasher.write_u32(std::process::id());
    hasher.finish()
}
