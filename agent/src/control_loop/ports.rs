//! Ports of an agent: its own five services, further ones if links can be cut interactively or goals come from
//! external clients, and the beacons of its in-neighbors. Beacons of spares are open only while they replace a
//! neighbor.

use iceoryx2::port::update_connections::UpdateConnections as _;
use protocol::brief::AgentBrief;
use protocol::clock;
use protocol::latency::LatencyRecorder;
use protocol::latency_port::LatencyPort;
use protocol::law_message::Broadcast;
use protocol::message::{
    Beacon, Command, Goal, LinkFaultByHand, NeighborStatus, Odometry, StatusHeader,
};
use protocol::process::Failure;
use protocol::service::{self, Node, Publisher, Sample, ServiceError, Subscriber, send_bytes};

use crate::control_cycle::ReceivedBeacon;
use crate::controller::Answer;
use crate::neighborhood::Neighborhood;

/// All ports of one agent. The command port is created last, because the plant takes it as the sign that this
/// robot is ready.
pub struct Ports {
    odometry: Subscriber<Odometry>,
    /// The in-neighbors, then the spares.
    senders: Vec<Sender>,
    /// Link faults set interactively, if the brief permits them.
    link_faults: Option<Subscriber<[LinkFaultByHand]>>,
    /// Goals from external clients, if the brief permits them.
    goal: Option<Subscriber<Goal>>,
    status: Publisher<[u8], StatusHeader>,
    /// Port for latency measurements.
    pub latency: LatencyPort,
    beacon: Publisher<[u8], Beacon>,
    command: Publisher<Command>,
    node: Node,
}

/// A received beacon in shared memory. The payload is the message of the sender's law, or empty.
pub type BeaconSample = Sample<[u8], Beacon>;

/// Returns a copy of a beacon of the sender `sender_index`, received at `received_ns`.
#[inline]
pub fn copy_beacon(sender_index: usize, sample: &BeaconSample, received_ns: u64) -> ReceivedBeacon {
    let message = sample.payload();
    ReceivedBeacon {
        sender_index,
        broadcast: Broadcast {
            beacon: *sample.user_header(),
            message: (!message.is_empty()).then(|| message.into()),
        },
        received_ns,
    }
}

/// A sender whose beacons can be received.
struct Sender {
    name: String,
    /// Slot of the robot in the barrier.
    barrier_slot: usize,
    /// Receiver of the beacons. For a spare it exists only while the spare is open.
    beacon_port: Option<Subscriber<[u8], Beacon>>,
    /// Whether the sender's law sends messages, so that more than its newest beacon matters.
    has_messages: bool,
    /// Tick up to which the beacons of a spare do not count.
    opened_at_tick: Option<u64>,
}

impl Ports {
    /// Opens the services that the brief names, and one for the `measured` latencies.
    pub fn open(brief: &AgentBrief, measured: &LatencyRecorder) -> Result<Ports, Failure> {
        let node = service::create_node(&format!("agent-{}", brief.name))?;
        let own = brief.name.as_str();
        let senders = brief.senders().enumerate().map(|(sender_index, sender)| {
            let is_received = sender_index < brief.neighbors.len();
            let beacon_port =
                is_received.then(|| open_beacon_port(&node, &sender.name)).transpose()?;
            let (name, barrier_slot) = (sender.name.clone(), sender.index - 1);
            let has_messages = sender.message.is_some();
            Ok(Sender { name, barrier_slot, beacon_port, has_messages, opened_at_tick: None })
        });
        let senders = senders.collect::<Result<_, ServiceError>>()?;
        Ok(Ports {
            odometry: service::odometry_topic(own).open(&node)?.subscriber()?,
            senders,
            link_faults: match brief.links_by_hand {
                true => Some(service::link_faults_topic(own).open(&node)?.subscriber()?),
                false => None,
            },
            goal: match brief.goals_from_outside {
                true => Some(service::goal_topic(own).open(&node)?.subscriber()?),
                false => None,
            },
            status: service::status_topic(own).open(&node)?.publisher(status_bytes_max(brief))?,
            latency: LatencyPort::new(&service::latency_topic(own).open(&node)?, measured)?,
            beacon: service::beacon_topic(own)
                .open(&node)?
                .publisher(brief.message.as_ref().map_or(0, |format| format.bytes_max))?,
            command: service::command_topic(own).open(&node)?.publisher()?,
            node,
        })
    }

    /// Opens the beacon ports of the spares in use, and closes the ports of all other spares.
    pub fn update_spare_ports(&mut self, neighborhood: &Neighborhood) -> Result<(), Failure> {
        for (sender_index, opening_tick) in neighborhood.spares() {
            let Sender { name, beacon_port, opened_at_tick, .. } = &mut self.senders[sender_index];
            if *opened_at_tick != opening_tick {
                *opened_at_tick = opening_tick;
                *beacon_port =
                    opening_tick.map(|_| open_beacon_port(&self.node, name)).transpose()?;
            }
        }
        Ok(())
    }

    /// Connects to all ports present. Without this call it happens at the next sample.
    ///
    /// # Errors
    /// This process lacks descriptors or memory for a connection.
    pub fn connect(&self) -> Result<(), Failure> {
        (self.senders.iter().filter_map(|sender| sender.beacon_port.as_ref()))
            .map(|port| port.update_connections())
            .chain([self.odometry.update_connections()])
            .chain([self.beacon.update_connections(), self.command.update_connections()])
            .try_for_each(|connected| connected.map_err(|cause| port_error("connect", cause)))
    }

    /// Returns the next odometry sample in the queue, without copying it because it is large.
    pub fn receive_odometry(&self) -> Result<Option<Sample<Odometry>>, Failure> {
        self.odometry.receive().map_err(|cause| port_error("receive odometry", cause))
    }

    /// Returns the number of senders whose beacons can be received.
    pub fn sender_count(&self) -> usize {
        self.senders.len()
    }

    /// Returns the name of the sender `sender_index` in the order of the brief, and its slot in the
    /// barrier.
    pub fn sender_name_and_slot(&self, sender_index: usize) -> (&str, usize) {
        let Sender { name, barrier_slot, .. } = &self.senders[sender_index];
        (name, *barrier_slot)
    }

    /// Returns whether the beacon that the sender `sender_index` sends at this lockstep tick is in the
    /// queue.
    pub fn has_beacon_of_tick(&self, sender_index: usize, tick: u64) -> bool {
        let Sender { beacon_port, opened_at_tick, .. } = &self.senders[sender_index];
        beacon_port.is_some() && opened_at_tick.is_none_or(|opened_at_tick| tick > opened_at_tick)
    }

    /// Returns the next beacon in the queue of the sender `sender_index`, with its message, or `None` if there is
    /// none or the port is closed.
    pub fn receive_beacon(&self, sender_index: usize) -> Result<Option<BeaconSample>, Failure> {
        let Some(port) = &self.senders[sender_index].beacon_port else { return Ok(None) };
        port.receive().map_err(|cause| port_error("receive beacon", cause))
    }

    /// Returns the newest beacon of each sender (real time only), and the queued ones before it if they may carry
    /// messages. Each one is received when the iterator reaches it.
    pub fn receive_newest_beacons(&self) -> impl Iterator<Item = Result<ReceivedBeacon, Failure>> {
        let (mut sender_index, mut is_first) = (0, true);
        // One function in place of nested iterators, between which beacons would be copied.
        std::iter::from_fn(move || {
            while let Some(sender) = self.senders.get(sender_index) {
                if is_first || sender.has_messages {
                    is_first = false;
                    match self.receive_beacon(sender_index) {
                        Ok(Some(sample)) => {
                            return Some(Ok(copy_beacon(sender_index, &sample, clock::now_ns())));
                        }
                        Ok(None) => {}
                        Err(failure) => return Some(Err(failure)),
                    }
                }
                (sender_index, is_first) = (sender_index + 1, true);
            }
            None
        })
    }

    /// Returns the newest list of links cut and restored interactively, or `None` if there is no new one.
    pub fn receive_link_faults(&self) -> Result<Option<Sample<[LinkFaultByHand]>>, Failure> {
        let Some(faults) = &self.link_faults else { return Ok(None) };
        let mut newest = None;
        while let Some(sample) =
            faults.receive().map_err(|cause| port_error("receive faults", cause))?
        {
            newest = Some(sample);
        }
        Ok(newest)
    }

    /// Returns the newest goal from an external client, or `None` if there is no new one.
    pub fn receive_goal(&self) -> Result<Option<Goal>, Failure> {
        self.goal.as_ref().map_or(Ok(None), |goal| receive_message(goal, "receive goal"))
    }

    /// Sends an answer with the time `sent_ns`, the beacon first because other robots wait for it.
    pub fn send_answer(&self, answer: &mut Answer, sent_ns: u64) -> Result<(), Failure> {
        answer.broadcast.beacon.sent_ns = sent_ns;
        answer.command.sent_ns = sent_ns;
        if !answer.is_withheld {
            send_bytes(&self.beacon, answer.beacon(), answer.message())
                .map_err(|cause| port_error("send beacon", cause))?;
        }
        self.command
            .send_copy(answer.command)
            .map_err(|cause| port_error("send command", cause))?;
        Ok(())
    }

    /// Sends the status of the robot to the supervisor, with the recorded message of the control law; empty if there is
    /// none.
    pub fn send_status(
        &self,
        header: StatusHeader,
        neighbors: impl ExactSizeIterator<Item = NeighborStatus>,
        message: &[u8],
    ) -> Result<(), Failure> {
        let payload = StatusHeader::encode_payload(neighbors, message);
        let sent = send_bytes(&self.status, &header, &payload);
        sent.map(drop).map_err(|cause| port_error("send status", cause))
    }
}

/// Returns the maximum length of a status after its header, bytes.
fn status_bytes_max(brief: &AgentBrief) -> usize {
    let recorded = brief.message.as_ref().filter(|_| brief.records_messages);
    let message_bytes_max = recorded.map_or(0, |format| format.bytes_max);
    StatusHeader::payload_bytes_max(brief.senders().count(), message_bytes_max)
}

/// Opens a receiver of the beacons of `robot`.
fn open_beacon_port(node: &Node, robot: &str) -> Result<Subscriber<[u8], Beacon>, ServiceError> {
    service::beacon_topic(robot).open(node)?.subscriber()
}

fn receive_message<M>(from: &Subscriber<M>, what: &str) -> Result<Option<M>, Failure>
where
    M: Copy + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let sample = from.receive().map_err(|cause| port_error(what, cause))?;
    Ok(sample.map(|sample| *sample))
}

fn port_error(what: &str, cause: impl std::fmt::Display) -> Failure {
    format!("cannot {what}: {cause}").into()
}
