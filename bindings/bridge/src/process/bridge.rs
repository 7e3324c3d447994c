//! Main loop of a bridge: forwards frames that have arrived, and does periodic work.

use std::sync::Arc;

use protocol::brief::BridgeBrief;
use protocol::clock;
use protocol::dropped::DropReason;
use protocol::message::{BridgeHeader, PeerRow, Plain};
use protocol::process::Failure;
use protocol::service::{self, Node, Publisher, send_slice};

use super::inbox::{Inbox, ReceivedFrame};
use super::ports::{self, CommandPort, PortError, SampleSink, SampleSource};
use super::refusals;
use super::status_forwarder::StatusForwarder;
use super::times::StampConverter;
use super::wire::PeerSessions;
use crate::clock::RoundTripStamps;
use crate::frame::{FrameHeader, WIRE_FORMAT_VERSION, decode_slice};
use crate::gate::FrameFilter;
use crate::topics::{self, Route, Topic};

/// Period of polling samples of this host, ns. It adds half of it to their age on average.
const POLL_PERIOD_NS: u64 = 500_000;
/// Period of clock measurements after the first [`FIRST_CLOCK_REQUESTS`], ns.
const CLOCK_REQUEST_PERIOD_NS: u64 = 200_000_000;
const FIRST_CLOCK_REQUEST_PERIOD_NS: u64 = 20_000_000;
const FIRST_CLOCK_REQUESTS: u64 = 16;
/// Period of forwarding status and latencies to the supervisor, and of reopening lost connections, ns.
const FORWARD_PERIOD_NS: u64 = 20_000_000;
/// Period of the status message to the supervisor, ns.
const STATUS_PERIOD_NS: u64 = 100_000_000;
/// Time for which a stamp that was delivered here may be answered, ns: longer than any sample is used.
const STAMP_LIFETIME_NS: u64 = 10_000_000_000;

/// A route that starts at this host.
struct OutgoingRoute {
    route_index: usize,
    topic: Topic,
    /// Source of the samples on this route; `None` for the bridge itself.
    source: Option<SampleSource>,
    layout_hash: u64,
    sequence: u64,
}

/// State of a running bridge.
pub(super) struct Bridge {
    brief: BridgeBrief,
    experiment_hash: u64,
    routes: Vec<Route>,
    outgoing_routes: Vec<OutgoingRoute>,
    /// Destination of the samples of each route that ends here.
    sinks: Vec<Option<SampleSink>>,
    /// Port for the commands of each remote robot, on the plant's host.
    command_ports: Vec<Option<CommandPort>>,
    inbox: Arc<Inbox>,
    /// Counters since the start.
    counts: BridgeHeader,
    stamp_converter: StampConverter,
    /// Time of the last message of each host, ns.
    last_message_ns: Vec<Option<u64>>,
    forwarder: StatusForwarder,
    status_publisher: Publisher<[PeerRow], BridgeHeader>,
    next_times: NextTimes,
    clock_request_count: u64,
    // Dropped last, after its senders and ports.
    sessions: PeerSessions,
    _node: Node,
}

/// Next times of periodic work, ns.
#[derive(Default)]
struct NextTimes {
    poll_ns: u64,
    clock_request_ns: u64,
    forward_ns: u64,
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
        let experiment_hash =
            u64::from_str_radix(&brief.experiment, 16).expect("checked when read");
        let (own_host, plant) = (brief.here, brief.plant);
        let (hosts, robots) = (brief.hosts.len(), brief.robots.len());
        let name = brief.hosts[own_host].name.clone();
        let node = service::create_node(&format!("bridge-{name}"))?;
        let mut routes = topics::routes(&brief);
        routes.retain(|route| {
            route.sending_host == own_host || route.receiving_hosts.contains(&own_host)
        });
        let status_publisher = service::bridge_topic(&name).open(&node)?.publisher(hosts)?;
        let inbox = Arc::new(Inbox::new(routes.len(), hosts));
        let (mut outgoing_routes, mut sinks) = (Vec::new(), Vec::new());
        let mut command_ports: Vec<Option<CommandPort>> = (0..robots).map(|_| None).collect();
        for (index, &Route { topic, sending_host, .. }) in routes.iter().enumerate() {
            let layout_hash = ports::topic_layout_hash(topic);
            if sending_host == own_host {
                let source = ports::open_source(&brief, &node, topic)?;
                outgoing_routes.push(OutgoingRoute {
                    route_index: index,
                    topic,
                    source,
                    layout_hash,
                    sequence: 0,
                });
                sinks.push(None);
                continue;
            }
            sinks.push(ports::open_sink(&brief, &node, topic)?);
            if let Topic::Command(robot) = topic {
                command_ports[robot] = Some(CommandPort::open(&brief, &node, robot)?);
            }
            let all = matches!(topic, Topic::StatusRecords(_));
            inbox.open_route(
                index,
                sending_host,
                FrameFilter::new(sending_host, layout_hash, experiment_hash),
                all,
            );
        }
        let sessions = PeerSessions::open(&brief, &routes, &inbox)?;
        Ok(Bridge {
            experiment_hash,
            routes,
            outgoing_routes,
            sinks,
            command_ports,
            inbox,
            counts: BridgeHeader { boot: random_boot_id(), ..BridgeHeader::default() },
            stamp_converter: StampConverter::new(own_host == plant, robots, STAMP_LIFETIME_NS),
            last_message_ns: vec![None; hosts],
            forwarder: StatusForwarder::open(&brief, &node)?,
            status_publisher,
            next_times: NextTimes::default(),
            clock_request_count: 0,
            sessions,
            _node: node,
            brief,
        })
    }

    /// Returns the name of this host.
    pub(super) fn host_name(&self) -> &str {
        &self.brief.hosts[self.brief.here].name
    }

    /// Closes all connections.
    pub(super) fn close(self) {
        self.sessions.close();
    }

    /// Delivers the frames that have arrived, and does the periodic work that is due. Waits until either is
    /// possible.
    pub(super) fn iterate(&mut self) -> Result<(), Failure> {
        for frame in self.inbox.wait_for_frames(self.next_times.poll_ns) {
            self.receive_frame(&frame)?;
        }
        let now_ns = clock::now_ns();
        if advance_if_due(&mut self.next_times.poll_ns, now_ns, POLL_PERIOD_NS) {
            self.send_samples(now_ns)?;
        }
        let is_measuring_clock = self.brief.here != self.brief.plant;
        let ask_every_ns = if self.clock_request_count < FIRST_CLOCK_REQUESTS {
            FIRST_CLOCK_REQUEST_PERIOD_NS
        } else {
            CLOCK_REQUEST_PERIOD_NS
        };
        if is_measuring_clock
            && advance_if_due(&mut self.next_times.clock_request_ns, now_ns, ask_every_ns)
        {
            self.clock_request_count += 1;
            self.send_bridge_message(
                |topic| matches!(topic, Topic::ClockRequest(_)),
                &encode_numbers(&[clock::now_ns()]),
            );
        }
        if advance_if_due(&mut self.next_times.forward_ns, now_ns, FORWARD_PERIOD_NS) {
            self.sessions.reopen_lost_sessions();
            self.forward_status(now_ns)?;
        }
        if advance_if_due(&mut self.next_times.status_ns, now_ns, STATUS_PERIOD_NS) {
            self.stamp_converter.remove_old_stamps(now_ns);
            self.send_status(now_ns)?;
        }
        Ok(())
    }

    /// Sends the newest samples of this host to other hosts.
    fn send_samples(&mut self, now_ns: u64) -> Result<(), Failure> {
        let header_base = self.common_header(now_ns);
        let Bridge { outgoing_routes, stamp_converter, counts, sessions, .. } = self;
        for route in outgoing_routes {
            let Some(source) = &mut route.source else { continue };
            match source(stamp_converter, now_ns) {
                Ok(Some(content)) => send_frame(sessions, route, header_base, &content, counts),
                Ok(None) => {}
                Err(PortError::Dropped(reason)) => counts.dropped[reason as usize] += 1,
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Delivers a frame of another host, or drops it and counts the reason.
    fn receive_frame(&mut self, frame: &ReceivedFrame) -> Result<(), Failure> {
        match self.deliver_frame(frame, clock::now_ns()) {
            Ok(()) => self.counts.taken += 1,
            Err(PortError::Dropped(reason)) => self.counts.dropped[reason as usize] += 1,
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    fn deliver_frame(&mut self, frame: &ReceivedFrame, now_ns: u64) -> Result<(), PortError> {
        let Route { topic, sending_host, .. } = self.routes[frame.route];
        let content = frame.content.as_slice();
        let (brief, stamp_converter) = (&self.brief, &mut self.stamp_converter);
        let run_ns = stamp_converter.run_time_ns(now_ns);
        if run_ns.is_some_and(|t_ns| brief.are_partitioned(brief.here, sending_host, t_ns)) {
            return Err(DropReason::Partition.into());
        }
        self.last_message_ns[sending_host] = Some(now_ns);
        match topic {
            Topic::Command(robot) => {
                let port = self.command_ports[robot].as_mut().expect("it ends here");
                port.deliver(stamp_converter, content, now_ns, brief.odometry_age_ns_max)?;
            }
            Topic::StatusRecords(_) => {
                for robot in
                    self.forwarder.receive_batch(sending_host, frame.header.boot_id, content)?
                {
                    // The robot has sent something, so it is running, which the plant waits for.
                    if let Some(port) = &mut self.command_ports[robot] {
                        port.open_publisher()?;
                    }
                }
            }
            Topic::Acknowledgment(_) => {
                let [boot, next] = decode_numbers(content)?;
                if boot == self.counts.boot {
                    self.forwarder.queue.acknowledge(next);
                }
            }
            Topic::ClockRequest(host) => {
                let [sent_ns] = decode_numbers(content)?;
                let stamps = encode_numbers(&[sent_ns, frame.arrival_ns, clock::now_ns()]);
                self.send_bridge_message(|topic| topic == Topic::ClockResponse(host), &stamps);
            }
            Topic::ClockResponse(_) => {
                let [sent_ns, remote_received_ns, remote_sent_ns] = decode_numbers(content)?;
                let received_ns = frame.arrival_ns;
                if !stamp_converter.add_measurement(&RoundTripStamps {
                    sent_ns,
                    remote_received_ns,
                    remote_sent_ns,
                    received_ns,
                }) {
                    return Err(DropReason::UnconvertibleTime.into());
                }
            }
            _ => {
                let sink = self.sinks[frame.route].as_mut().expect("it ends here");
                sink(stamp_converter, content, now_ns)?;
            }
        }
        Ok(())
    }

    /// Sends status and latencies to the plant's host, or forwards them to the supervisor there, and acknowledges
    /// them.
    fn forward_status(&mut self, now_ns: u64) -> Result<(), Failure> {
        if let Some(batch) = self.forwarder.next_batch(now_ns)? {
            self.send_bridge_message(|topic| matches!(topic, Topic::StatusRecords(_)), &batch);
        }
        for reason in self.forwarder.publish_records()? {
            self.counts.dropped[reason as usize] += 1;
        }
        for (host, confirmed) in self.forwarder.acknowledgments() {
            self.send_bridge_message(
                |topic| topic == Topic::Acknowledgment(host),
                &encode_numbers(&confirmed),
            );
        }
        Ok(())
    }

    /// Sends the bridge status to the own supervisor and to that of the plant's host.
    fn send_status(&mut self, now_ns: u64) -> Result<(), Failure> {
        for (reason, text) in refusals::take_first_refusals() {
            tracing::warn!(
                why = reason.keyword(),
                "refused; further refusals are only counted: {text}"
            );
        }
        let mut header = self.counts;
        for reason in DropReason::ALL {
            header.dropped[reason as usize] +=
                self.inbox.dropped_count(reason) + refusals::refusal_count(reason);
        }
        header.unconfirmed = self.forwarder.queue.unacked_count() as u64;
        header.told_dropped = self.forwarder.queue.dropped_count;
        let [round_trip_ns, uncertainty_ns_max] = self.stamp_converter.round_trip_and_error_ns();
        let peers = topics::peer_hosts(&self.brief, self.brief.here).into_iter();
        let rows: Vec<PeerRow> = peers
            .map(|host| {
                let of_plant = |ns: u64| if host == self.brief.plant { ns } else { 0 };
                let silent_ns = |received_ns| now_ns.saturating_sub(received_ns);
                PeerRow {
                    host: host as u64,
                    silent_ns: self.last_message_ns[host].map_or(u64::MAX, silent_ns),
                    round_trip_ns: of_plant(round_trip_ns),
                    uncertainty_ns_max: of_plant(uncertainty_ns_max),
                }
            })
            .collect();
        send_slice(&self.status_publisher, header, rows.len(), |index| rows[index])
            .map_err(PortError::from)?;
        let mut content = header.bytes().to_vec();
        rows.iter().for_each(|row| content.extend(row.bytes()));
        self.send_bridge_message(|topic| matches!(topic, Topic::BridgeStatus(_)), &content);
        Ok(())
    }

    /// Sends a message of the bridge itself on all topics for which `is_meant` returns `true`.
    fn send_bridge_message(&mut self, is_meant: impl Fn(Topic) -> bool, content: &[u8]) {
        let header_base = self.common_header(clock::now_ns());
        let Bridge { outgoing_routes, counts, sessions, .. } = self;
        for route in outgoing_routes.iter_mut().filter(|route| is_meant(route.topic)) {
            send_frame(sessions, route, header_base, content, counts);
        }
    }

    /// Returns the common fields of the headers of frames sent now.
    fn common_header(&mut self, now_ns: u64) -> FrameHeader {
        FrameHeader {
            version: WIRE_FORMAT_VERSION,
            host: self.brief.here as u16,
            layout_hash: 0,
            experiment_hash: self.experiment_hash,
            boot_id: self.counts.boot,
            sequence: 0,
            source_ns: self.stamp_converter.plant_time_ns(now_ns).unwrap_or(0),
        }
    }
}

/// Sends one frame. If the queue is full, zenoh drops it.
fn send_frame(
    sessions: &PeerSessions,
    route: &mut OutgoingRoute,
    header_base: FrameHeader,
    content: &[u8],
    counts: &mut BridgeHeader,
) {
    route.sequence += 1;
    let header =
        FrameHeader { layout_hash: route.layout_hash, sequence: route.sequence, ..header_base };
    match sessions.send(route.route_index, header.encode_frame(&[content])) {
        Ok(()) => {
            counts.sent += 1;
            counts.samples_sent += u64::from(route.topic.is_robot_topic());
        }
        Err(error) => tracing::debug!(%error, topic = ?route.topic, "not sent"),
    }
}

fn encode_numbers(numbers: &[u64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Decodes content of exactly `COUNT` numbers.
fn decode_numbers<const COUNT: usize>(content: &[u8]) -> Result<[u64; COUNT], DropReason> {
    let (_, numbers) = decode_slice::<u64, ()>(content).ok_or(DropReason::Garbage)?;
    numbers.try_into().map_err(|_| DropReason::Garbage)
}

/// Returns a random number that identifies this bridge process.
fn random_boot_id() -> u64 {
    use std::hash::{BuildHasher as _, Hasher as _};
    let mut hasher = std::collections::hash_map::RandomState::new().build_hasher();
    hasher.write_u64(clock::now_ns());
    hasher.write_u32(std::process::id());
    hasher.finish()
}
