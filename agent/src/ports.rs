//! An agent's ports: its own five services, more where links may be cut by hand or goals come from
//! outside, and the beacons of those it hears; those of spares while they replace somebody. It opens no
//! others.

use iceoryx2::port::update_connections::UpdateConnections as _;
use protocol::brief::AgentBrief;
use protocol::clock;
use protocol::latency::{LatencyPort, Recorder};
use protocol::message::{
    Beacon, Command, Goal, LinkFaultByHand, NeighborStatus, Odometry, StatusHeader,
};
use protocol::process::Failure;
use protocol::service::{self, Node, Publisher, Sample, ServiceError, Subscriber, send_slice};

use crate::brain::Answer;
use crate::neighborhood::Neighborhood;
use crate::turn::Delivery;

/// All ports of one agent. The command's is made last: the plant takes it as the sign that this
/// robot is ready.
pub struct Ports {
    odometry: Subscriber<Odometry>,
    /// Of those that it hears, then of its spares.
    senders: Vec<Sender>,
    /// Where links may be cut by hand.
    faults: Option<Subscriber<[LinkFaultByHand]>>,
    /// Where goals come from outside.
    goal: Option<Subscriber<Goal>>,
    status: Publisher<[NeighborStatus], StatusHeader>,
    /// For what is measured.
    pub latency: LatencyPort,
    beacon: Publisher<Beacon>,
    command: Publisher<Command>,
    node: Node,
}

/// One whose beacons may be opened.
struct Sender {
    name: String,
    /// Its slot in the barrier.
    slot: usize,
    /// Of a spare only while it is open.
    port: Option<Subscriber<Beacon>>,
    /// A spare's beacons up to this tick do not count.
    opened_at: Option<u64>,
}

impl Ports {
    /// Opens the services that the brief names, and one for what is `measured`.
    pub fn open(brief: &AgentBrief, measured: &Recorder) -> Result<Ports, Failure> {
        let node = service::node(&format!("agent-{}", brief.name))?;
        let own = brief.name.as_str();
        let senders = brief.senders().enumerate().map(|(place, sender)| {
            let is_heard = place < brief.neighbors.len();
            let port = is_heard.then(|| receiver(&node, &sender.name)).transpose()?;
            let (name, slot) = (sender.name.clone(), sender.index - 1);
            Ok(Sender { name, slot, port, opened_at: None })
        });
        let senders = senders.collect::<Result<_, ServiceError>>()?;
        Ok(Ports {
            odometry: service::odometry(own).open(&node)?.subscriber()?,
            senders,
            faults: match brief.links_by_hand {
                true => Some(service::faults(own).open(&node)?.subscriber()?),
                false => None,
            },
            goal: match brief.goals_from_outside {
                true => Some(service::goal(own).open(&node)?.subscriber()?),
                false => None,
            },
            status: service::status(own).open(&node)?.publisher(brief.senders().count())?,
            latency: LatencyPort::new(&service::latency(own).open(&node)?, measured)?,
            beacon: service::beacon(own).open(&node)?.publisher()?,
            command: service::command(own).open(&node)?.publisher()?,
            node,
        })
    }

    /// Opens the beacons of the spares that are listened to now, and closes those of the others.
    pub fn listen(&mut self, neighborhood: &Neighborhood) -> Result<(), Failure> {
        for (place, opened_at) in neighborhood.spares() {
            let Sender { name, port, opened_at: was, .. } = &mut self.senders[place];
            if *was != opened_at {
                *was = opened_at;
                *port = opened_at.map(|_| receiver(&self.node, name)).transpose()?;
            }
        }
        Ok(())
    }

    /// Connects to everybody who is there by now, which otherwise happens at the next sample.
    pub fn connect(&self) {
        let connected = (self.senders.iter().filter_map(|sender| sender.port.as_ref()))
            .map(|port| port.update_connections())
            .chain([self.odometry.update_connections()])
            .chain([self.beacon.update_connections(), self.command.update_connections()]);
        // A failure shows again, with its reason, at the next sample.
        connected.for_each(|_| ());
    }

    /// The next odometry sample in the queue, where the plant put it: it is large, and not copied.
    pub fn odometry(&self) -> Result<Option<Sample<Odometry>>, Failure> {
        self.odometry.receive().map_err(|cause| cannot("receive odometry", cause))
    }

    /// How many there are whose beacons may be opened.
    pub fn senders(&self) -> usize {
        self.senders.len()
    }

    /// The name of the sender at `place` (in the brief's order), and its slot in the barrier.
    pub fn sender(&self, place: usize) -> (&str, usize) {
        let Sender { name, slot, .. } = &self.senders[place];
        (name, *slot)
    }

    /// Whether what the sender at `place` says at this tick of lockstep is in the queue.
    pub fn awaits(&self, place: usize, tick: u64) -> bool {
        let Sender { port, opened_at, .. } = &self.senders[place];
        port.is_some() && opened_at.is_none_or(|opened_at| tick > opened_at)
    }

    /// The next beacon in the queue of the sender at `place`, if it is open.
    pub fn beacon(&self, place: usize) -> Result<Option<Beacon>, Failure> {
        let port = self.senders[place].port.as_ref();
        port.map_or(Ok(None), |port| take(port, "receive beacon"))
    }

    /// In real time: what everybody said last, as it is asked for.
    pub fn newest_beacons(&self) -> impl Iterator<Item = Result<Delivery, Failure>> {
        let delivery = |place, beacon| Delivery { place, beacon, taken_ns: clock::now_ns() };
        (0..self.senders.len()).filter_map(move |place| {
            let taken = self.beacon(place).transpose()?;
            Some(taken.map(|beacon| delivery(place, beacon)))
        })
    }

    /// The newest list of links cut and mended by hand, if one came since.
    pub fn cuts(&self) -> Result<Option<Sample<[LinkFaultByHand]>>, Failure> {
        let Some(faults) = &self.faults else { return Ok(None) };
        let mut newest = None;
        while let Some(sample) =
            faults.receive().map_err(|cause| cannot("receive faults", cause))?
        {
            newest = Some(sample);
        }
        Ok(newest)
    }

    /// The goal that somebody outside said last, if one came since.
    pub fn goal(&self) -> Result<Option<Goal>, Failure> {
        self.goal.as_ref().map_or(Ok(None), |goal| take(goal, "receive goal"))
    }

    /// Sends an answer: the beacon first, for others wait for it.
    pub fn send(&self, answer: &Answer, sent_ns: u64) -> Result<(), Failure> {
        let beacon = Beacon { sent_ns, ..answer.beacon };
        let command = Command { sent_ns, ..answer.command };
        self.beacon.send_copy(beacon).map_err(|cause| cannot("send beacon", cause))?;
        self.command.send_copy(command).map_err(|cause| cannot("send command", cause))?;
        Ok(())
    }

    /// Tells the supervisor how the robot is doing.
    pub fn report(
        &self,
        header: StatusHeader,
        mut neighbors: impl ExactSizeIterator<Item = NeighborStatus>,
    ) -> Result<(), Failure> {
        let length = neighbors.len();
        let next = |_| neighbors.next().expect("as many rows as announced");
        let sent = send_slice(&self.status, header, length, next);
        sent.map(drop).map_err(|cause| cannot("send status", cause))
    }
}

/// A receiver of that robot's beacons.
fn receiver(node: &Node, robot: &str) -> Result<Subscriber<Beacon>, ServiceError> {
    service::beacon(robot).open(node)?.subscriber()
}

fn take<M>(from: &Subscriber<M>, what: &str) -> Result<Option<M>, Failure>
where
    M: Copy + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let sample = from.receive().map_err(|cause| cannot(what, cause))?;
    Ok(sample.map(|sample| *sample))
}

fn cannot(what: &str, cause: impl std::fmt::Display) -> Failure {
    format!("cannot {what}: {cause}").into()
}
