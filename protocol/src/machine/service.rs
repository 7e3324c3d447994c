//! iceoryx2 services: names, connection limits and queue lengths.
//!
//! Only the supervisor creates services; it keeps the [`Factory`] of each for the whole run. Agents and the plant
//! open them. Must not: block a sender (safe overflow, discard), or rely on any iceoryx2 default.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::time::Duration;

use iceoryx2::node::NodeListFailure;
use iceoryx2::prelude::{
    AllocationStrategy, BackpressureStrategy, CallbackProgression, NodeBuilder, NodeName,
    NodeState, PortFactory as _, ServiceName, SignalHandlingMode, ZeroCopySend,
};
use iceoryx2::service::builder::publish_subscribe::{Builder, PublishSubscribeOpenError};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::brief::Pace;
use crate::law_message::MESSAGE_QUEUE_LENGTH;
use crate::machine::barrier::LEAD_TICKS_MAX;
use crate::machine::resources::{self, handle_failed_connection};
use crate::message::{
    Beacon, BridgeHeader, Command, Goal, GoalCounts, LatencyHeader, LatencyRow, LinkFaultByHand,
    Odometry, OrderHeader, OrderRow, PeerRow, ReportHeader, ReportRow, StatusHeader, TruthHeader,
    TruthRow,
};

pub use crate::machine::ipc::Ipc;
/// iceoryx2 node of a process. It is not `Send`: each thread that needs one creates its own.
pub type Node = iceoryx2::node::Node<Ipc>;
/// Sending port of a service.
pub type Publisher<P, H = ()> = iceoryx2::port::publisher::Publisher<Ipc, P, H>;
/// Receiving port of a service.
pub type Subscriber<P, H = ()> = iceoryx2::port::subscriber::Subscriber<Ipc, P, H>;
/// Received sample, in shared memory until it is dropped.
pub type Sample<P, H = ()> = iceoryx2::sample::Sample<Ipc, P, H>;

/// Maximum number of senders: one, and its replacement while iceoryx2 still counts the dead one.
const PUBLISHERS_MAX: usize = 2;
/// Additional receivers: replacements of dead receivers that iceoryx2 still counts.
const ADDITIONAL_SUBSCRIBERS: usize = 2;
/// Additional nodes: the supervisor, its clean-up thread, and two monitoring tools.
const ADDITIONAL_NODES: usize = 4;
/// Maximum number of samples that a receiver holds: one while it receives the next.
const BORROWED_SAMPLES_MAX: usize = 2;
/// Maximum number of attempts to open a service. Opening sometimes fails without a reason while other processes
/// start.
const OPEN_ATTEMPTS: usize = 20;
/// Pause between two attempts.
const OPEN_PAUSE: Duration = Duration::from_millis(10);

/// Failure to create or open a service or a port.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {name}: {cause}; {advice}")]
pub struct ServiceError {
    action: &'static str,
    name: String,
    cause: String,
    advice: &'static str,
}

/// Advice in errors about the name, creation, sender or receiver of a service.
const NAME_ADVICE: &str = "names have 1 to 255 bytes";
const CREATE_ADVICE: &str =
    "a name can be created once in a run, and the file system of the run root must not be full";
const SENDING: &str = "it accepts one sender and its replacement, and dead senders count until the \
     supervisor has removed them; a limit on file sizes (`ulimit -f`) also applies to shared memory";
const RECEIVING: &str =
    "the maximum number of receivers was computed from the formation graph at the start of the run";

/// Returns a conversion of a cause to a [`ServiceError`] about this action on this service.
fn service_error<C: Debug>(
    action: &'static str,
    name: &str,
    advice: &'static str,
) -> impl FnOnce(C) -> ServiceError {
    let name = name.to_owned();
    move |cause| {
        let cause = match resources::find_missing_resource() {
            Some(missing) => format!("{cause:?} ({missing})"),
            None => format!("{cause:?}"),
        };
        ServiceError { action, name, cause, advice }
    }
}

/// Creates the node of this process, under the configuration that [`crate::machine::run_root::join`] installed.
///
/// # Errors
///
/// The name is invalid or the node cannot be created.
pub fn create_node(name: &str) -> Result<Node, ServiceError> {
    const ACTION: &str = "create the iceoryx2 node";
    let node_name = NodeName::new(name).map_err(service_error(ACTION, name, NAME_ADVICE))?;
    let advice = "is the run root there, writable, and its file system not full?";
    NodeBuilder::new()
        .name(&node_name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(service_error(ACTION, name, advice))
}

/// Removes the nodes with these IDs and their ports, if their processes are dead; logs failures. Ends early once
/// `must_end` returns true, which is asked after each node. `attempt_timeout`: maximum time for one node.
///
/// # Errors
///
/// The nodes cannot be listed.
pub fn remove_dead_nodes(
    node: &Node,
    mut ids: BTreeSet<u128>,
    attempt_timeout: Duration,
    must_end: &dyn Fn() -> bool,
) -> Result<(), NodeListFailure> {
    Node::list(node.config(), |state| {
        let is_selected = ids.remove(&state.node_id().value());
        if let (true, NodeState::Dead(dead_node)) = (is_selected, state)
            && let Err(error) = dead_node.blocking_remove_stale_resources(attempt_timeout)
        {
            tracing::debug!(?error, "iceoryx2 could not remove a dead node");
        }
        // Checking an alive process costs as much as removing a port of a dead one.
        let is_done = ids.is_empty() || must_end();
        if is_done { CallbackProgression::Stop } else { CallbackProgression::Continue }
    })
}

/// Connection limit and queue length of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Number of receivers in the formation graph, recorder included.
    pub subscribers: usize,
    /// Queue length of each receiver, in samples. When it is full, the oldest sample is dropped.
    pub queue_length: usize,
}

impl Qos {
    /// Returns the limits for odometry, commands and beacons. In lockstep a neighbor may be one tick ahead; in
    /// real time only the newest sample matters.
    pub fn for_robot(pace: Pace, subscribers: usize) -> Qos {
        let queue_length = match pace {
            Pace::Lockstep => 4,
            Pace::Realtime => 1,
        };
        Qos { subscribers, queue_length }
    }

    /// Returns the limits for beacons. In real time a queue with messages is longer, so that a beacon without a message
    /// displaces no earlier message.
    pub fn for_beacons(pace: Pace, subscribers: usize, with_messages: bool) -> Qos {
        let qos = Qos::for_robot(pace, subscribers);
        Qos {
            queue_length: if with_messages {
                qos.queue_length.max(MESSAGE_QUEUE_LENGTH)
            } else {
                qos.queue_length
            },
            ..qos
        }
    }

    /// Returns the limits for status: twice the lead that the plant may have in lockstep, where every tick may
    /// carry a change and none may be lost; the supervisor reads in bursts.
    pub fn for_status(subscribers: usize) -> Qos {
        Qos { subscribers, queue_length: 2 * (LEAD_TICKS_MAX as usize + 1) }
    }

    /// Returns the limits for messages between supervisors and bridges of several hosts: only the newest one
    /// matters.
    pub fn for_hosts(subscribers: usize) -> Qos {
        Qos { subscribers, queue_length: 1 }
    }

    /// Returns the limits with one more receiver: a bridge, or a supervisor in addition to one.
    pub fn with_additional_receiver(self) -> Qos {
        Qos { subscribers: self.subscribers + 1, ..self }
    }

    /// Returns the limits for latencies: at least 1.6 s of batches, one every 100 ms.
    pub fn for_latency(subscribers: usize) -> Qos {
        Qos { subscribers, queue_length: 16 }
    }

    /// Returns the limits for ground truth: twice the lead that the plant may have in lockstep, or a second at 1
    /// kHz.
    pub fn for_truth(pace: Pace, subscribers: usize) -> Qos {
        let queue_length = match pace {
            Pace::Lockstep => 128,
            Pace::Realtime => 1024,
        };
        Qos { subscribers, queue_length }
    }
}

/// A service, by name and type: payload `P` (a message, or a slice of messages), user header `H`.
#[derive(Debug, Clone)]
pub struct Topic<P: ?Sized, H = ()> {
    name: String,
    payload: PhantomData<fn(&P, &H)>,
}

/// Returns `robot/<id>/odometry`: plant to agent.
pub fn odometry_topic(robot: &str) -> Topic<Odometry> {
    Topic::new(format!("robot/{robot}/odometry"))
}

/// Returns `robot/<id>/command`: agent to plant.
pub fn command_topic(robot: &str) -> Topic<Command> {
    Topic::new(format!("robot/{robot}/command"))
}

/// Returns `robot/<id>/beacon`: agent to its out-neighbors. The slice is the message of the control law, empty if
/// the beacon carries none.
pub fn beacon_topic(robot: &str) -> Topic<[u8], Beacon> {
    Topic::new(format!("robot/{robot}/beacon"))
}

/// Returns `robot/<id>/status`: agent to supervisor. The slice is the payload of [`StatusHeader::split_payload`].
pub fn status_topic(robot: &str) -> Topic<[u8], StatusHeader> {
    Topic::new(format!("robot/{robot}/status"))
}

/// Returns `robot/<id>/faults`: supervisor to agent (real time only), if links may be cut by a user. Each message
/// has the state of all links of the robot, and is sent when one changes.
pub fn link_faults_topic(robot: &str) -> Topic<[LinkFaultByHand]> {
    Topic::new(format!("robot/{robot}/faults"))
}

/// Returns `robot/<id>/goal`: ROS 2 process to agent (real time only), if the robot accepts goals from outside.
pub fn goal_topic(robot: &str) -> Topic<Goal> {
    Topic::new(format!("robot/{robot}/goal"))
}

/// Returns `ros2/goals`: ROS 2 process to supervisor, if any robot accepts goals from outside.
pub fn goal_counts_topic() -> Topic<GoalCounts> {
    Topic::new("ros2/goals".into())
}

/// Returns `robot/<id>/latency`: agent to supervisor.
pub fn latency_topic(robot: &str) -> Topic<[LatencyRow], LatencyHeader> {
    Topic::new(format!("robot/{robot}/latency"))
}

/// Returns `plant/latency`: plant to supervisor.
pub fn plant_latency_topic() -> Topic<[LatencyRow], LatencyHeader> {
    Topic::new("plant/latency".into())
}

/// Returns `machine/latency`: control timer of a real-time run to supervisor.
pub fn machine_latency_topic() -> Topic<[LatencyRow], LatencyHeader> {
    Topic::new("machine/latency".into())
}

/// Returns `host/<name>/orders`: supervisor of the plant's host to that of another host, through their bridges.
pub fn orders_topic(host: &str) -> Topic<[OrderRow], OrderHeader> {
    Topic::new(format!("host/{host}/orders"))
}

/// Returns `host/<name>/report`: supervisor of a host to that of the plant's host, through their bridges.
pub fn host_report_topic(host: &str) -> Topic<[ReportRow], ReportHeader> {
    Topic::new(format!("host/{host}/report"))
}

/// Returns `host/<name>/bridge`: bridge of a host to its supervisor, and to that of the plant's host.
pub fn bridge_topic(host: &str) -> Topic<[PeerRow], BridgeHeader> {
    Topic::new(format!("host/{host}/bridge"))
}

/// Returns `probe`: used by the supervisor alone, to find the files that a service has.
pub fn probe_topic() -> Topic<u64> {
    Topic::new("probe".into())
}

/// Returns `plant/truth`: plant to supervisor.
pub fn truth_topic() -> Topic<[TruthRow], TruthHeader> {
    Topic::new("plant/truth".into())
}

/// A service created or opened by this process. It exists while one of its factories exists.
#[derive(Debug)]
pub struct Factory<P: Debug + ?Sized + iceoryx2::prelude::IceoryxSend, H: Debug + ZeroCopySend = ()>
{
    name: String,
    ports: PortFactory<Ipc, P, H>,
}

impl<P: ?Sized, H> Topic<P, H> {
    fn new(name: String) -> Topic<P, H> {
        Topic { name, payload: PhantomData }
    }

    /// Returns the name of the service.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn service_name(&self) -> Result<ServiceName, ServiceError> {
        ServiceName::new(&self.name).map_err(service_error(
            "name the service",
            &self.name,
            NAME_ADVICE,
        ))
    }
}

/// Implements a service that carries one message, or a slice of messages after a header. It is not generic, so
/// that the code of iceoryx2 for each message is compiled once here and not again in each crate.
macro_rules! service {
    ([$row:ty], $header:ty) => {
        service!(of [$row], $header);

        impl Factory<[$row], $header> {
            /// Creates a sender of slices of at most `length_max` elements. It never waits and never allocates.
            pub fn publisher(
                &self,
                length_max: usize,
            ) -> Result<Publisher<[$row], $header>, ServiceError> {
                self.ports
                    .publisher_builder()
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .set_degradation_handler(|_, _| handle_failed_connection())
                    .initial_max_slice_len(length_max.max(1))
                    .allocation_strategy(AllocationStrategy::Static)
                    .create()
                    .map_err(service_error("send on the service", &self.name, SENDING))
            }
        }
    };
    ($message:ty) => {
        service!(of $message, ());

        impl Factory<$message> {
            /// Creates a sender, which never waits.
            pub fn publisher(&self) -> Result<Publisher<$message>, ServiceError> {
                self.ports
                    .publisher_builder()
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .set_degradation_handler(|_, _| handle_failed_connection())
                    .create()
                    .map_err(service_error("send on the service", &self.name, SENDING))
            }
        }
    };
    (of $payload:ty, $header:ty) => {
        impl Topic<$payload, $header> {
            /// Creates the service. Only the supervisor may call this: a process killed during the call leaves
            /// the name unusable for the rest of the run.
            pub fn create(
                &self,
                node: &Node,
                qos: Qos,
            ) -> Result<Factory<$payload, $header>, ServiceError> {
                let builder = node.service_builder(&self.service_name()?);
                let builder = builder.publish_subscribe::<$payload>().user_header::<$header>();
                let ports = with_qos(builder, qos)
                    .create()
                    .map_err(service_error("create the service", &self.name, CREATE_ADVICE))?;
                Ok(Factory { name: self.name.clone(), ports })
            }

            /// Opens the service that the supervisor created. Tries again if the failure may be transient.
            pub fn open(&self, node: &Node) -> Result<Factory<$payload, $header>, ServiceError> {
                let name = self.service_name()?;
                let mut attempts = 1;
                loop {
                    let builder = node.service_builder(&name).publish_subscribe::<$payload>();
                    match builder.user_header::<$header>().open() {
                        Ok(ports) => return Ok(Factory { name: self.name.clone(), ports }),
                        Err(cause) if attempts == OPEN_ATTEMPTS || !is_transient(cause) => {
                            let advice = error_advice(cause);
                            return Err(service_error("open the service", &self.name, advice)(cause));
                        }
                        Err(_) => std::thread::sleep(OPEN_PAUSE),
                    }
                    attempts += 1;
                }
            }
        }

        impl Factory<$payload, $header> {
            /// Creates a receiver with the queue length of the service.
            pub fn subscriber(&self) -> Result<Subscriber<$payload, $header>, ServiceError> {
                self.ports
                    .subscriber_builder()
                    .set_degradation_handler(|_, _| handle_failed_connection())
                    .create()
                    .map_err(service_error("receive from the service", &self.name, RECEIVING))
            }
        }
    };
}

service!(Odometry);
service!(Command);
service!([u8], Beacon);
service!(Goal);
service!(GoalCounts);
service!([u8], StatusHeader);
service!([LinkFaultByHand], ());
service!([LatencyRow], LatencyHeader);
service!([TruthRow], TruthHeader);
service!([OrderRow], OrderHeader);
service!([ReportRow], ReportHeader);
service!([PeerRow], BridgeHeader);
service!(u64);

fn with_qos<P, H>(builder: Builder<P, H, Ipc>, qos: Qos) -> Builder<P, H, Ipc>
where
    P: Debug + iceoryx2::prelude::IceoryxSend + ?Sized,
    H: Debug + ZeroCopySend,
{
    let subscribers = qos.subscribers + ADDITIONAL_SUBSCRIBERS;
    builder
        .enable_safe_overflow(true)
        .history_size(0)
        .max_publishers(PUBLISHERS_MAX)
        .max_subscribers(subscribers)
        .max_nodes(PUBLISHERS_MAX + subscribers + ADDITIONAL_NODES)
        .subscriber_max_buffer_size(qos.queue_length)
        .subscriber_max_borrowed_samples(BORROWED_SAMPLES_MAX)
}

/// Returns whether a failure may be transient.
fn is_transient(cause: PublishSubscribeOpenError) -> bool {
    use PublishSubscribeOpenError as E;
    matches!(
        cause,
        E::DoesNotExist
            | E::InternalFailure
            | E::Interrupt
            | E::IsMarkedForDestruction
            | E::ServiceInCorruptedState
            | E::UnableToCreateServiceTag
    )
}

fn error_advice(cause: PublishSubscribeOpenError) -> &'static str {
    use PublishSubscribeOpenError as E;
    match cause {
        E::DoesNotExist => "the supervisor creates it: is the robot's name right, is the run over?",
        E::IncompatibleTypes => {
            "this process was built with another layout of the message than the supervisor: rebuild both"
        }
        E::ExceedsMaxNumberOfNodes => {
            "the maximum number of nodes was computed from the formation graph; dead processes count until they are cleaned up"
        }
        _ => "set IOX2_LOG_LEVEL=debug for details",
    }
}

impl<P, H> Factory<P, H>
where
    P: Debug + ?Sized + iceoryx2::prelude::IceoryxSend,
    H: Debug + ZeroCopySend,
{
    /// Returns the name of the service.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the number of senders, including dead ones that are not cleaned up.
    pub fn number_of_publishers(&self) -> usize {
        self.ports.dynamic_config().number_of_publishers()
    }

    /// Returns the number of receivers, including dead ones that are not cleaned up.
    pub fn number_of_subscribers(&self) -> usize {
        self.ports.dynamic_config().number_of_subscribers()
    }
}

/// Failure to send a slice.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SendError {
    /// There is no free memory for the slice.
    #[error(
        "no memory for a slice of {length} elements: {cause:?}; the sender was created with a maximum length"
    )]
    Loan { length: usize, cause: iceoryx2::port::LoanError },
    /// The slice was written and not delivered.
    #[error("a slice was not delivered: {cause:?}")]
    Send { cause: iceoryx2::port::SendError },
}

/// Sends a header and a slice, whose elements `row` writes in place. Returns the number of receivers.
pub fn send_slice<P, H>(
    publisher: &Publisher<[P], H>,
    header: H,
    length: usize,
    row: impl FnMut(usize) -> P,
) -> Result<usize, SendError>
where
    P: Debug + ZeroCopySend + iceoryx2::prelude::IceoryxSend,
    H: Debug + Default + ZeroCopySend,
{
    let loan = publisher.loan_slice_uninit(length);
    let mut sample = loan.map_err(|cause| SendError::Loan { length, cause })?;
    *sample.user_header_mut() = header;
    sample.write_from_fn(row).send().map_err(|cause| SendError::Send { cause })
}

/// Sends a header and bytes, copied as one piece. Returns the number of receivers.
pub fn send_bytes<H>(
    publisher: &Publisher<[u8], H>,
    header: &H,
    bytes: &[u8],
) -> Result<usize, SendError>
where
    H: Copy + Debug + Default + ZeroCopySend,
{
    let length = bytes.len();
    let loan = publisher.loan_slice_uninit(length);
    let mut sample = loan.map_err(|cause| SendError::Loan { length, cause })?;
    *sample.user_header_mut() = *header;
    sample.write_from_slice(bytes).send().map_err(|cause| SendError::Send { cause })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::run_root::{PATH_BYTES_MAX, RunRoot, join};

    /// Another layout under the name of a command.
    type MismatchedCommand = Goal;

    /// Sends one message over a service that the supervisor creates and a child opens, or the reverse.
    macro_rules! check_transfer {
        ($sender:expr, $receiver:expr, $message:expr) => {{
            let (publisher, subscriber) =
                ($sender.publisher().unwrap(), $receiver.subscriber().unwrap());
            publisher.send_copy($message).unwrap();
            assert_eq!(*subscriber.receive().unwrap().unwrap(), $message);
            assert!(subscriber.receive().unwrap().is_none());
        }};
    }

    /// A single test, because iceoryx2's configuration is process-wide.
    #[test]
    fn services_carry_messages_and_refuse_other_layouts() {
        let parent = tempfile::tempdir_in("/dev/shm").unwrap();
        // The longest path that is accepted: iceoryx2 must not exceed its limit further down.
        let base =
            "b".repeat(PATH_BYTES_MAX - "//01234567".len() - parent.path().as_os_str().len());
        assert!(RunRoot::create(&parent.path().join(format!("{base}b"))).is_err());
        let root = RunRoot::create(&parent.path().join(base)).unwrap();
        join(root.path()).unwrap();
        join(root.path()).unwrap();
        let other = RunRoot::create(&parent.path().join("base")).unwrap();
        assert!(join(other.path()).unwrap_err().to_string().contains("already"));
        drop(other);

        let before = list_directory("/tmp/iceoryx2");
        let supervisor = create_node("supervisor").unwrap();
        let child = create_node("agent r1").unwrap();
        let qos = Qos::for_robot(Pace::Lockstep, 1);
        let created = command_topic("r1").create(&supervisor, qos).unwrap();
        let opened = command_topic("r1").open(&child).unwrap();
        let publisher = opened.publisher().unwrap();
        let subscriber = created.subscriber().unwrap();
        assert_eq!((created.number_of_publishers(), created.number_of_subscribers()), (1, 1));
        // The oldest sample is dropped; the sender never waits.
        for tick in 0..10 {
            publisher.send_copy(Command { tick, v_m_s: 0.1, ..Command::default() }).unwrap();
        }
        let received = std::iter::from_fn(|| subscriber.receive().unwrap());
        let ticks: Vec<(u64, f64)> = received.map(|sample| (sample.tick, sample.v_m_s)).collect();
        assert_eq!(ticks, [(6, 0.1), (7, 0.1), (8, 0.1), (9, 0.1)]);

        let mismatched: Topic<MismatchedCommand> = Topic::new(command_topic("r1").name().into());
        let error = mismatched.open(&child).unwrap_err().to_string();
        assert!(error.contains("robot/r1/command") && error.contains("another layout"), "{error}");
        let error = command_topic("absent").open(&child).unwrap_err().to_string();
        assert!(
            error.contains("robot/absent/command") && error.contains("DoesNotExist"),
            "{error}"
        );

        check_beacons(&supervisor, &child);
        let odometry =
            Odometry { tick: 1, walls_count: 1, near: [[0.5; 2]; 32], ..Odometry::default() };
        let created = odometry_topic("r1").create(&supervisor, qos).unwrap();
        check_transfer!(created, odometry_topic("r1").open(&child).unwrap(), odometry);

        check_statuses_and_faults(&supervisor, &child);
        check_truths(&supervisor, &child);

        // All files are in the root. With a port still open, as after a SIGKILL, nothing remains after removal.
        let files = list_directory(root.path().to_str().unwrap());
        for suffix in [".dynamic", ".data", ".connection"] {
            assert!(files.iter().any(|name| name.ends_with(suffix)), "{suffix}: {files:?}");
        }
        let id = root.path().file_name().unwrap().to_str().unwrap();
        assert!(!list_directory("/dev/shm").iter().any(|name| name.contains(id)));
        root.remove().unwrap();
        assert_eq!(list_directory("/tmp/iceoryx2"), before);
        assert!(list_directory(parent.path().to_str().unwrap()).is_empty());
    }

    /// Sends a beacon with and one without a message of the control law.
    fn check_beacons(supervisor: &Node, child: &Node) {
        let qos = Qos::for_robot(Pace::Lockstep, 1);
        let subscriber = beacon_topic("r1").create(supervisor, qos).unwrap().subscriber().unwrap();
        let publisher = beacon_topic("r1").open(child).unwrap().publisher(3).unwrap();
        let header = Beacon { tick: 1, x_m: 1.0, frame_scale: 2.0, ..Beacon::default() };
        for message in [&[7, 8, 9][..], &[]] {
            send_bytes(&publisher, &header, message).unwrap();
            let sample = subscriber.receive().unwrap().unwrap();
            assert_eq!((*sample.user_header(), sample.payload()), (header, message));
        }
        assert!(send_bytes(&publisher, &header, &[0; 4]).is_err());
    }

    fn check_statuses_and_faults(supervisor: &Node, child: &Node) {
        let created = status_topic("r1").create(supervisor, Qos::for_status(1)).unwrap();
        let subscriber = created.subscriber().unwrap();
        let publisher = status_topic("r1").open(child).unwrap().publisher(2).unwrap();
        let header = StatusHeader { tick: 5, ..StatusHeader::default() };
        send_bytes(&publisher, &header, &[1, 2]).unwrap();
        send_bytes(&publisher, &header, &[]).unwrap();
        assert!(send_bytes(&publisher, &header, &[1, 2, 3]).is_err());
        let sample = subscriber.receive().unwrap().unwrap();
        assert_eq!((*sample.user_header(), sample.payload()), (header, &[1, 2][..]));
        assert_eq!(subscriber.receive().unwrap().unwrap().len(), 0);

        let qos = Qos::for_robot(Pace::Realtime, 1);
        let publisher =
            link_faults_topic("r1").create(supervisor, qos).unwrap().publisher(2).unwrap();
        let subscriber = link_faults_topic("r1").open(child).unwrap().subscriber().unwrap();
        let link = |i: usize| LinkFaultByHand { robot: i as u64 + 1, cut: 1 };
        for length in [1, 2] {
            send_slice(&publisher, (), length, link).unwrap();
        }
        let sample = subscriber.receive().unwrap().unwrap();
        assert_eq!(sample.payload(), [link(0), link(1)], "the newest wins");
    }

    /// Sends one second of ground truth at 1 kHz.
    fn check_truths(supervisor: &Node, child: &Node) {
        let created = truth_topic().create(supervisor, Qos::for_truth(Pace::Realtime, 1)).unwrap();
        let subscriber = created.subscriber().unwrap();
        let publisher = truth_topic().open(child).unwrap().publisher(64).unwrap();
        let row = |i| TruthRow { x_m: i as f64, commanded: 1, ..TruthRow::default() };
        for tick in 0..1024 {
            let header = TruthHeader { tick, ..TruthHeader::default() };
            send_slice(&publisher, header, 64, row).unwrap();
        }
        for tick in 0..1024 {
            let sample = subscriber.receive().unwrap().unwrap();
            assert_eq!((sample.user_header().tick, sample[63]), (tick, row(63)));
        }
    }

    fn list_directory(directory: &str) -> Vec<String> {
        let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
    }
}
