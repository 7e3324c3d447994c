//! The ports of a bridge in its own host's share of the run.

use iceoryx2::port::ReceiveError;
use protocol::brief::BridgeBrief;
use protocol::latency;
use protocol::message::{
    Beacon, BridgeHeader, Command, LatencyHeader, LatencyRow, NeighborStatus, Odometry,
    OrderHeader, OrderRow, PeerRow, ReportHeader, ReportRow, StatusHeader,
};
use protocol::service::{self, Factory, Node, Publisher, SendError, ServiceError, Subscriber};

use crate::topics::{Route, Topic};

/// Why a sample did not get through.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// A port could not be made.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A sample could not be taken.
    #[error("cannot receive from a process of this host: {0}")]
    Receive(#[from] ReceiveError),
    /// A sample could not be sent.
    #[error("cannot send to a process of this host: {0}")]
    Send(#[from] iceoryx2::port::SendError),
    /// A slice could not be sent.
    #[error("cannot send to a process of this host: {0}")]
    Slice(#[from] SendError),
}

/// What of this host goes to others.
pub enum Source {
    /// A robot of this host.
    Beacon(Subscriber<Beacon>),
    /// The plant.
    Odometry(Subscriber<Odometry>),
    /// A robot of this host.
    Command(Subscriber<Command>),
    /// The supervisor of the plant's host.
    Orders(Subscriber<[OrderRow], OrderHeader>),
    /// The supervisor of another host.
    Report(Subscriber<[ReportRow], ReportHeader>),
    /// The bridge itself.
    Own,
}

/// Where what arrives goes.
pub enum Sink {
    /// To robots of this host.
    Beacon(Publisher<Beacon>),
    /// To a robot of this host.
    Odometry(Publisher<Odometry>),
    /// To the plant: its sender is made once the robot is there, which the plant takes for ready.
    Command(Factory<Command>, Option<Publisher<Command>>),
    /// To the supervisor.
    Orders(Publisher<[OrderRow], OrderHeader>),
    /// To the supervisor.
    Report(Publisher<[ReportRow], ReportHeader>),
    /// To the supervisor.
    Bridge(Publisher<[PeerRow], BridgeHeader>),
    /// To the bridge itself.
    Own,
}

/// What a robot tells the supervisor.
pub struct Telling {
    /// Whose.
    pub robot: usize,
    /// How it is doing.
    pub status: Subscriber<[NeighborStatus], StatusHeader>,
    /// What it measured.
    pub latency: Subscriber<[LatencyRow], LatencyHeader>,
}

/// The same, told on the plant's host in a robot's place.
pub struct Retelling {
    /// How it is doing.
    pub status: Publisher<[NeighborStatus], StatusHeader>,
    /// What it measured.
    pub latency: Publisher<[LatencyRow], LatencyHeader>,
}

/// The port from which a route that begins here is fed.
pub fn source(brief: &BridgeBrief, node: &Node, route: &Route) -> Result<Source, PortError> {
    let name = |robot: usize| brief.robots[robot].name.as_str();
    let host = |host: usize| brief.hosts[host].name.as_str();
    Ok(match route.topic {
        Topic::Beacon(robot) => {
            Source::Beacon(service::beacon(name(robot)).open(node)?.subscriber()?)
        }
        Topic::Odometry(robot) => {
            Source::Odometry(service::odometry(name(robot)).open(node)?.subscriber()?)
        }
        Topic::Command(robot) => {
            Source::Command(service::command(name(robot)).open(node)?.subscriber()?)
        }
        Topic::Orders(to) => Source::Orders(service::orders(host(to)).open(node)?.subscriber()?),
        Topic::Report(of) => Source::Report(service::report(host(of)).open(node)?.subscriber()?),
        Topic::Bridge(_)
        | Topic::Told(_)
        | Topic::Confirmed(_)
        | Topic::Ask(_)
        | Topic::Answer(_) => Source::Own,
    })
}

/// The port to which a route that ends here leads.
pub fn sink(brief: &BridgeBrief, node: &Node, route: &Route) -> Result<Sink, PortError> {
    let name = |robot: usize| brief.robots[robot].name.as_str();
    let host = |host: usize| brief.hosts[host].name.as_str();
    let robots = brief.robots.len();
    Ok(match route.topic {
        Topic::Beacon(robot) => Sink::Beacon(service::beacon(name(robot)).open(node)?.publisher()?),
        Topic::Odometry(robot) => {
            Sink::Odometry(service::odometry(name(robot)).open(node)?.publisher()?)
        }
        Topic::Command(robot) => Sink::Command(service::command(name(robot)).open(node)?, None),
        Topic::Orders(to) => Sink::Orders(service::orders(host(to)).open(node)?.publisher(robots)?),
        Topic::Report(of) => Sink::Report(service::report(host(of)).open(node)?.publisher(robots)?),
        Topic::Bridge(of) => {
            Sink::Bridge(service::bridge(host(of)).open(node)?.publisher(brief.hosts.len())?)
        }
        Topic::Told(_) | Topic::Confirmed(_) | Topic::Ask(_) | Topic::Answer(_) => Sink::Own,
    })
}

/// What each robot of this host tells, on a host without the plant.
pub fn tellings(brief: &BridgeBrief, node: &Node) -> Result<Vec<Telling>, PortError> {
    let own = brief.robots.iter().enumerate().filter(|(_, robot)| robot.host == brief.here);
    own.filter(|_| brief.here != brief.plant)
        .map(|(place, robot)| {
            Ok(Telling {
                robot: place,
                status: service::status(&robot.name).open(node)?.subscriber()?,
                latency: service::latency(&robot.name).open(node)?.subscriber()?,
            })
        })
        .collect()
}

/// In place of the robots of other hosts, on the plant's host; by robot.
pub fn retellings(brief: &BridgeBrief, node: &Node) -> Result<Vec<Option<Retelling>>, PortError> {
    let robots = brief.robots.iter();
    robots
        .map(|robot| {
            let retold = brief.here == brief.plant && robot.host != brief.plant;
            let open = || {
                let rows_max = latency::rows_max(3 + 2 * robot.hears);
                Ok::<_, PortError>(Retelling {
                    status: service::status(&robot.name).open(node)?.publisher(robot.hears)?,
                    latency: service::latency(&robot.name).open(node)?.publisher(rows_max)?,
                })
            };
            retold.then(open).transpose()
        })
        .collect()
}

/// The newest sample that waits.
pub fn newest<M>(from: &Subscriber<M>) -> Result<Option<M>, PortError>
where
    M: Copy + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let mut newest = None;
    while let Some(sample) = from.receive()? {
        newest = Some(*sample);
    }
    Ok(newest)
}
