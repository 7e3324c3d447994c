//! iceoryx2 ports of a bridge on its own host: sources of the frames that it sends, and destinations of the
//! frames that arrive.

use std::fmt::Debug;

use iceoryx2::port::ReceiveError;
use iceoryx2::prelude::ZeroCopySend;
use protocol::brief::BridgeBrief;
use protocol::dropped::DropReason;
use protocol::message::{
    Beacon, BridgeHeader, Command, LatencyHeader, LatencyRow, NeighborStatus, Odometry,
    OrderHeader, OrderRow, PeerRow, Plain, ReportHeader, ReportRow, StatusHeader,
};
use protocol::service::{
    self, Factory, Node, Publisher, SendError, ServiceError, Subscriber, send_bytes, send_slice,
};

use super::times::StampConverter;
use crate::frame::{self, decode_slice};
use crate::topics::Topic;

/// Failure to forward a sample.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The sample is dropped and counted, for this reason.
    #[error("dropped: {}", .0.keyword())]
    Dropped(DropReason),
    /// A port could not be created.
    #[error(transparent)]
    CreatePort(#[from] ServiceError),
    /// A sample could not be received.
    #[error("cannot receive from a process of this host: {0}")]
    Receive(#[from] ReceiveError),
    /// A sample could not be sent.
    #[error("cannot send to a process of this host: {0}")]
    Send(#[from] iceoryx2::port::SendError),
    /// A slice could not be sent.
    #[error("cannot send to a process of this host: {0}")]
    SendSlice(#[from] SendError),
}

impl From<DropReason> for PortError {
    fn from(reason: DropReason) -> PortError {
        PortError::Dropped(reason)
    }
}

/// Function that returns the newest sample of a process of this host, converted for other hosts; `None` if there is
/// no new one. The number is the current time, ns.
pub type SampleSource =
    Box<dyn FnMut(&mut StampConverter, u64) -> Result<Option<Vec<u8>>, PortError>>;
/// Function that delivers a sample from another host to a process of this host. The number is the current time, ns.
pub type SampleSink = Box<dyn FnMut(&mut StampConverter, &[u8], u64) -> Result<(), PortError>>;

/// Returns the layout hash of the content of a topic.
pub fn topic_layout_hash(topic: Topic) -> u64 {
    match topic {
        // Behind the beacon follow the bytes of its message.
        Topic::Beacon(_) => Beacon::LAYOUT.rotate_left(3),
        Topic::Odometry(_) => Odometry::LAYOUT,
        Topic::Command(_) => Command::LAYOUT,
        Topic::Orders(_) => frame::layout_hash::<OrderRow, OrderHeader>(),
        Topic::Report(_) => frame::layout_hash::<ReportRow, ReportHeader>(),
        Topic::BridgeStatus(_) => frame::layout_hash::<PeerRow, BridgeHeader>(),
        Topic::StatusRecords(_) => {
            frame::layout_hash::<NeighborStatus, StatusHeader>()
                ^ frame::layout_hash::<LatencyRow, LatencyHeader>().rotate_left(7)
        }
        Topic::Acknowledgment(_) | Topic::ClockRequest(_) | Topic::ClockResponse(_) => {
            frame::layout_hash::<u64, ()>()
        }
    }
}

/// Returns the source of a topic that starts here; `None` if that is the bridge itself.
pub fn open_source(
    brief: &BridgeBrief,
    node: &Node,
    topic: Topic,
) -> Result<Option<SampleSource>, PortError> {
    let robot_name = |index: usize| brief.robots[index].name.as_str();
    let host_name = |index: usize| brief.hosts[index].name.as_str();
    let source = match topic {
        Topic::Beacon(index) => {
            let subscriber = service::beacon_topic(robot_name(index)).open(node)?.subscriber()?;
            beacon_source(subscriber)
        }
        Topic::Odometry(index) => {
            let subscriber = service::odometry_topic(robot_name(index)).open(node)?.subscriber()?;
            sample_source(subscriber, |times, odometry: Odometry, _| {
                times.set_run_start(odometry.stamp_ns.saturating_sub(odometry.t_ns));
                Ok(odometry)
            })
        }
        Topic::Command(index) => {
            let subscriber = service::command_topic(robot_name(index)).open(node)?.subscriber()?;
            sample_source(subscriber, StampConverter::convert_outgoing_command)
        }
        Topic::Orders(host) => {
            slice_source(service::orders_topic(host_name(host)).open(node)?.subscriber()?)
        }
        Topic::Report(host) => {
            slice_source(service::host_report_topic(host_name(host)).open(node)?.subscriber()?)
        }
        _ => return Ok(None),
    };
    Ok(Some(source))
}

fn sample_source<M>(
    subscriber: Subscriber<M>,
    mut convert: impl FnMut(&mut StampConverter, M, u64) -> Result<M, DropReason> + 'static,
) -> SampleSource
where
    M: Plain + Debug + ZeroCopySend,
{
    Box::new(move |times, now_ns| {
        let mut newest = None;
        while let Some(sample) = subscriber.receive()? {
            newest = Some(*sample);
        }
        let Some(sample) = newest else { return Ok(None) };
        Ok(Some(convert(times, sample, now_ns)?.bytes().to_vec()))
    })
}

/// Returns the source of beacons and their messages. If several are queued, each message is forwarded in turn, and only
/// the newest beacon without a message.
fn beacon_source(subscriber: Subscriber<[u8], Beacon>) -> SampleSource {
    Box::new(move |times, now_ns| {
        let mut newest = None;
        while let Some(sample) = subscriber.receive()? {
            let message = sample.payload();
            newest = Some((*sample.user_header(), message.to_vec()));
            if !message.is_empty() {
                break;
            }
        }
        let Some((beacon, message)) = newest else { return Ok(None) };
        let mut content = times.convert_outgoing_beacon(beacon, now_ns)?.bytes().to_vec();
        content.extend(message);
        Ok(Some(content))
    })
}

fn slice_source<P, H>(subscriber: Subscriber<[P], H>) -> SampleSource
where
    P: Plain + Debug + ZeroCopySend,
    H: Plain + Debug + ZeroCopySend,
{
    Box::new(move |_, _| {
        let mut newest = None;
        while let Some(content) = receive_encoded_slice(&subscriber)? {
            newest = Some(content);
        }
        Ok(newest)
    })
}

/// Returns the next queued slice, encoded; `None` if there is none.
pub fn receive_encoded_slice<P, H>(
    subscriber: &Subscriber<[P], H>,
) -> Result<Option<Vec<u8>>, PortError>
where
    P: Plain + Debug + ZeroCopySend,
    H: Plain + Debug + ZeroCopySend,
{
    let Some(sample) = subscriber.receive()? else { return Ok(None) };
    let mut content = sample.user_header().bytes().to_vec();
    sample.payload().iter().for_each(|row| content.extend(row.bytes()));
    Ok(Some(content))
}

/// Returns the destination of a topic that ends here; `None` if that is the bridge itself or a [`CommandPort`].
pub fn open_sink(
    brief: &BridgeBrief,
    node: &Node,
    topic: Topic,
) -> Result<Option<SampleSink>, PortError> {
    let robot_name = |index: usize| brief.robots[index].name.as_str();
    let host_name = |index: usize| brief.hosts[index].name.as_str();
    let (odometry_age, beacon_age) = (brief.odometry_age_ns_max, brief.beacon_age_ns_max);
    let robots = brief.robots.len();
    let sink: SampleSink = match topic {
        Topic::Beacon(index) => {
            let message_bytes_max = brief.robots[index].message_bytes_max;
            let publisher = service::beacon_topic(robot_name(index))
                .open(node)?
                .publisher(message_bytes_max)?;
            Box::new(move |times, content, now_ns| {
                let parts = content.split_at_checked(size_of::<Beacon>());
                let (beacon, message) = parts.ok_or(DropReason::Garbage)?;
                let beacon = decode_plausible_message(beacon, Beacon::is_plausible)?;
                if message.len() > message_bytes_max {
                    return Err(DropReason::Implausible.into());
                }
                let beacon = times.convert_incoming_beacon(beacon, now_ns, beacon_age)?;
                send_bytes(&publisher, &beacon, message)?;
                Ok(())
            })
        }
        Topic::Odometry(index) => {
            let publisher = service::odometry_topic(robot_name(index)).open(node)?.publisher()?;
            Box::new(move |times, content, now_ns| {
                let odometry = decode_plausible_message(content, is_plausible_odometry)?;
                publisher.send_copy(times.convert_incoming_odometry(
                    index,
                    odometry,
                    now_ns,
                    odometry_age,
                )?)?;
                Ok(())
            })
        }
        Topic::Orders(host) => {
            let publisher = service::orders_topic(host_name(host)).open(node)?.publisher(robots)?;
            Box::new(move |_, content, _| deliver_slice(&publisher, content))
        }
        Topic::Report(host) => {
            let publisher =
                service::host_report_topic(host_name(host)).open(node)?.publisher(robots)?;
            Box::new(move |_, content, _| deliver_slice(&publisher, content))
        }
        Topic::BridgeStatus(host) => {
            let publisher =
                service::bridge_topic(host_name(host)).open(node)?.publisher(brief.hosts.len())?;
            Box::new(move |_, content, _| deliver_slice(&publisher, content))
        }
        _ => return Ok(None),
    };
    Ok(Some(sink))
}

/// Port for the commands of a remote robot. Its sender is created once the robot is running, because the plant
/// takes a sender for a ready robot.
pub struct CommandPort {
    service: Factory<Command>,
    publisher: Option<Publisher<Command>>,
}

impl CommandPort {
    /// Opens the service of the robot with this index.
    pub fn open(brief: &BridgeBrief, node: &Node, robot: usize) -> Result<CommandPort, PortError> {
        let service = service::command_topic(&brief.robots[robot].name).open(node)?;
        Ok(CommandPort { service, publisher: None })
    }

    /// Creates the sender if there is none: the robot is running.
    pub fn open_publisher(&mut self) -> Result<&Publisher<Command>, PortError> {
        if self.publisher.is_none() {
            self.publisher = Some(self.service.publisher()?);
        }
        Ok(self.publisher.as_ref().expect("just made"))
    }

    /// Delivers a command of the robot, unless it is too old.
    pub fn deliver(
        &mut self,
        times: &mut StampConverter,
        content: &[u8],
        now_ns: u64,
        age_ns_max: u64,
    ) -> Result<(), PortError> {
        let command = decode_plausible_message(content, Command::is_plausible)?;
        let command = times.check_incoming_command(command, now_ns, age_ns_max);
        let publisher = self.open_publisher()?;
        publisher.send_copy(command?)?;
        Ok(())
    }
}

/// Decodes a message and checks that it is plausible.
fn decode_plausible_message<M: Plain>(
    content: &[u8],
    is_plausible: impl Fn(&M) -> bool,
) -> Result<M, DropReason> {
    let message = M::from_bytes(content).ok_or(DropReason::Garbage)?;
    if is_plausible(&message) { Ok(message) } else { Err(DropReason::Implausible) }
}

/// Returns whether a working plant could have sent this odometry sample: all its numbers are finite.
fn is_plausible_odometry(odometry: &Odometry) -> bool {
    let Odometry { x_m, y_m, heading_rad, v_m_s, side_m_s, w_rad_s, .. } = *odometry;
    let neighbors = odometry.near.iter().chain(&odometry.walls).flatten();
    neighbors
        .chain(&[x_m, y_m, heading_rad, v_m_s, side_m_s, w_rad_s])
        .all(|number| number.is_finite())
}

/// Delivers a slice from another host.
pub fn deliver_slice<P, H>(publisher: &Publisher<[P], H>, content: &[u8]) -> Result<(), PortError>
where
    P: Plain + Debug + ZeroCopySend,
    H: Plain + Debug + Default + ZeroCopySend,
{
    let (header, rows) = decode_slice::<P, H>(content).ok_or(DropReason::Garbage)?;
    match send_slice(publisher, header, rows.len(), |index| rows[index]) {
        Ok(_) => Ok(()),
        // Longer than any slice that is sent here.
        Err(SendError::Loan { .. }) => Err(DropReason::Implausible.into()),
        Err(error) => Err(error.into()),
    }
}
