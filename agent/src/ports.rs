//! An agent's ports: its own five services, more where links may be cut by hand or goals come from
//! outside, and the beacons of those it hears. It opens no others.

use iceoryx2::port::update_connections::UpdateConnections as _;
use protocol::brief::AgentBrief;
use protocol::latency::LatencyPort;
use protocol::message::{
    Beacon, Command, Goal, LinkFaultByHand, NeighborStatus, Odometry, StatusHeader,
};
use protocol::service::{
    self, Node, Publisher, Sample, SendError, ServiceError, Subscriber, send_slice,
};

use crate::brain::{Answer, Brain};

/// All ports of one agent. The command's is made last: the plant takes it as the sign that this
/// robot is ready.
pub struct Ports {
    odometry: Subscriber<Odometry>,
    neighbors: Vec<Subscriber<Beacon>>,
    /// Where links may be cut by hand.
    faults: Option<Subscriber<[LinkFaultByHand]>>,
    /// Where goals come from outside.
    goal: Option<Subscriber<Goal>>,
    status: Publisher<[NeighborStatus], StatusHeader>,
    /// For what the loop measures.
    pub latency: LatencyPort,
    beacon: Publisher<Beacon>,
    command: Publisher<Command>,
    _node: Node,
}

/// Why a sample did not get through.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// A port could not be made.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A sample could not be taken.
    #[error("cannot receive {what}: {cause}")]
    Receive {
        /// Of which service.
        what: &'static str,
        /// Why.
        cause: iceoryx2::port::ReceiveError,
    },
    /// A sample could not be sent.
    #[error("cannot send {what}: {cause}")]
    Send {
        /// On which service.
        what: &'static str,
        /// Why.
        cause: iceoryx2::port::SendError,
    },
    /// The status could not be sent.
    #[error("cannot send status: {0}")]
    Status(#[from] SendError),
}

impl Ports {
    /// Opens the services that the brief names.
    pub fn open(brief: &AgentBrief, incarnation: u64) -> Result<Ports, PortError> {
        let node = service::node(&format!("agent-{}", brief.name))?;
        let own = brief.name.as_str();
        let neighbors = brief
            .neighbors
            .iter()
            .map(|neighbor| service::beacon(&neighbor.name).open(&node)?.subscriber())
            .collect::<Result<_, _>>()?;
        Ok(Ports {
            odometry: service::odometry(own).open(&node)?.subscriber()?,
            neighbors,
            faults: match brief.links_by_hand {
                true => Some(service::faults(own).open(&node)?.subscriber()?),
                false => None,
            },
            goal: match brief.goals_from_outside {
                true => Some(service::goal(own).open(&node)?.subscriber()?),
                false => None,
            },
            status: service::status(own).open(&node)?.publisher(brief.neighbors.len())?,
            latency: LatencyPort::new(
                &service::latency(own).open(&node)?,
                incarnation,
                latency_rows_per_tick(brief),
            )?,
            beacon: service::beacon(own).open(&node)?.publisher()?,
            command: service::command(own).open(&node)?.publisher()?,
            _node: node,
        })
    }

    /// Connects to everybody who is there by now, which otherwise happens at the next sample.
    pub fn connect(&self) {
        let connected = (self.neighbors.iter().map(Subscriber::update_connections))
            .chain([self.odometry.update_connections()])
            .chain([self.beacon.update_connections(), self.command.update_connections()]);
        // A failure shows again, with its reason, at the next sample.
        connected.for_each(|_| ());
    }

    /// The next odometry sample in the queue, where the plant put it: it is large, and not copied.
    pub fn odometry(&self) -> Result<Option<Sample<Odometry>>, PortError> {
        receive(&self.odometry, "odometry")
    }

    /// The next beacon in the queue of the neighbour at `place`.
    pub fn beacon(&self, place: usize) -> Result<Option<Beacon>, PortError> {
        take(&self.neighbors[place], "beacon")
    }

    /// Takes what was cut and mended by hand, if that changed: hands each neighbour's place in the
    /// scenario, from 1, and whether its link is cut, to `link`.
    pub fn faults_by_hand(&self, mut link: impl FnMut(u64, bool)) -> Result<(), PortError> {
        let Some(faults) = &self.faults else { return Ok(()) };
        let failed = |cause| PortError::Receive { what: "faults", cause };
        while let Some(sample) = faults.receive().map_err(failed)? {
            sample.payload().iter().for_each(|fault| link(fault.robot, fault.cut == 1));
        }
        Ok(())
    }

    /// The goal that somebody outside said last, if one came since.
    pub fn goal(&self) -> Result<Option<Goal>, PortError> {
        self.goal.as_ref().map_or(Ok(None), |goal| take(goal, "goal"))
    }

    /// Sends an answer: the beacon first, for others wait for it.
    pub fn send(&self, answer: &Answer, sent_ns: u64) -> Result<(), PortError> {
        let beacon = Beacon { sent_ns, ..answer.beacon };
        let command = Command { sent_ns, ..answer.command };
        let failed = |what| move |cause| PortError::Send { what, cause };
        self.beacon.send_copy(beacon).map_err(failed("beacon"))?;
        self.command.send_copy(command).map_err(failed("command"))?;
        Ok(())
    }

    /// Tells the supervisor how the brain is doing. `odometry_old`: samples too old for an answer.
    pub fn report(
        &self,
        brain: &Brain,
        deadline_misses: u64,
        odometry_old: u64,
    ) -> Result<(), PortError> {
        let (header, mut rows) = brain.status(deadline_misses);
        let header = StatusHeader { odometry_old, ..header };
        let length = rows.len();
        let next = |_| rows.next().expect("as many rows as announced");
        send_slice(&self.status, header, length, next)?;
        Ok(())
    }
}

/// How many values an agent measures in one tick, at most.
pub fn latency_rows_per_tick(brief: &AgentBrief) -> usize {
    3 + 2 * brief.neighbors.len()
}

fn take<M>(from: &Subscriber<M>, what: &'static str) -> Result<Option<M>, PortError>
where
    M: Copy + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    Ok(receive(from, what)?.map(|sample| *sample))
}

fn receive<M>(from: &Subscriber<M>, what: &'static str) -> Result<Option<Sample<M>>, PortError>
where
    M: std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    from.receive().map_err(|cause| PortError::Receive { what, cause })
}
