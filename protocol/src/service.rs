//! The services: their names, who may connect, how deep their queues are.
//!
//! Only the supervisor creates services; it holds the [`Factory`] of each for the whole run.
//! Agents and the plant open them. Must not: push back on a sender (safe overflow, discard), or
//! rely on any iceoryx2 default.

use std::fmt::Debug;
use std::marker::PhantomData;
use std::time::Duration;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::{
    AllocationStrategy, BackpressureStrategy, NodeBuilder, NodeName, PortFactory as _, ServiceName,
    SignalHandlingMode, ZeroCopySend,
};
use iceoryx2::service::builder::publish_subscribe::{
    Builder, PublishSubscribeCreateError, PublishSubscribeOpenError,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::barrier::LEAD_MAX;
use crate::brief::Pace;
use crate::message::{
    Beacon, BridgeHeader, Command, Goal, GoalCounts, LatencyHeader, LatencyRow, LinkFaultByHand,
    NeighborStatus, Odometry, OrderHeader, OrderRow, PeerRow, ReportHeader, ReportRow,
    StatusHeader, TruthHeader, TruthRow,
};

pub use crate::ipc::Ipc;
/// A process's seat in iceoryx2. Not `Send`: a thread that needs one makes its own.
pub type Node = iceoryx2::node::Node<Ipc>;
/// The sending end of a service.
pub type Publisher<P, H = ()> = iceoryx2::port::publisher::Publisher<Ipc, P, H>;
/// The receiving end of a service.
pub type Subscriber<P, H = ()> = iceoryx2::port::subscriber::Subscriber<Ipc, P, H>;
/// What a receiving port received, in shared memory until it is dropped.
pub type Sample<P, H = ()> = iceoryx2::sample::Sample<Ipc, P, H>;

/// One sender, and its replacement while iceoryx2 still counts the dead one.
const PUBLISHERS_MAX: usize = 2;
/// Replacements of dead receivers overlap in the same way.
const SUBSCRIBERS_SPARE: usize = 2;
/// The supervisor, its clean-up thread, and two tools that look on.
const NODES_SPARE: usize = 4;
/// A receiver holds one sample while it takes the next.
const BORROWED_MAX: usize = 2;
/// Opening was seen to fail for no reason while others start; it is tried this often.
const OPEN_ATTEMPTS: usize = 20;
/// Pause between two attempts.
const OPEN_PAUSE: Duration = Duration::from_millis(10);

/// Why a service or a port is not there.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The name is none for iceoryx2.
    #[error("{name:?} is no valid iceoryx2 name: it must have 1 to 255 bytes")]
    Name {
        /// The name.
        name: String,
    },
    /// The process cannot take part at all.
    #[error(
        "cannot create the iceoryx2 node {name}: {cause:?}; is the run root there, writable, and its file system not full?"
    )]
    Node {
        /// The node's name.
        name: String,
        /// Why.
        cause: NodeCreationFailure,
    },
    /// The supervisor cannot create a service.
    #[error(
        "cannot create the service {service}: {cause:?}; a name can be created once in a run, and the file system of the run root must not be full"
    )]
    Create {
        /// Its name.
        service: String,
        /// Why.
        cause: PublishSubscribeCreateError,
    },
    /// A child cannot open a service.
    #[error("cannot open the service {service} ({attempts} attempts): {cause:?}; {advice}")]
    Open {
        /// Its name.
        service: String,
        /// How often it was tried.
        attempts: usize,
        /// Why the last attempt failed.
        cause: PublishSubscribeOpenError,
        /// What to look at.
        advice: &'static str,
    },
    /// No place for another sender.
    #[error(
        "cannot send on the service {service}: {cause:?}; it has room for {PUBLISHERS_MAX} senders, one of them a replacement, and the dead count until the supervisor cleaned up"
    )]
    Publisher {
        /// The service's name.
        service: String,
        /// Why.
        cause: PublisherCreateError,
    },
    /// No place for another receiver.
    #[error(
        "cannot receive from the service {service}: {cause:?}; its room for receivers was counted from the formation graph when the run began"
    )]
    Subscriber {
        /// The service's name.
        service: String,
        /// Why.
        cause: SubscriberCreateError,
    },
}

/// This process's seat, under the configuration that [`crate::run_root::join`] installed.
pub fn node(name: &str) -> Result<Node, ServiceError> {
    let node_name = NodeName::new(name).map_err(|_| ServiceError::Name { name: name.into() })?;
    NodeBuilder::new()
        .name(&node_name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(|cause| ServiceError::Node { name: name.into(), cause })
}

/// How many receive, and how many samples wait for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Receivers in the formation graph, recorder included.
    pub subscribers: usize,
    /// Queue of each receiver; the oldest sample gives way.
    pub buffer: usize,
}

impl Qos {
    /// For odometry, commands and beacons. In lockstep a neighbour may be a tick ahead; in real
    /// time only the newest sample matters.
    pub fn of_robot(pace: Pace, subscribers: usize) -> Qos {
        let buffer = match pace {
            Pace::Lockstep => 4,
            Pace::Realtime => 1,
        };
        Qos { subscribers, buffer }
    }

    /// For status: twice the lead that the plant may have in lockstep, where every tick may bring news
    /// and none may be lost; the supervisor takes them in bursts.
    pub fn of_status(subscribers: usize) -> Qos {
        Qos { subscribers, buffer: 2 * (LEAD_MAX as usize + 1) }
    }

    /// For what supervisors and bridges of several hosts tell each other: only the newest counts.
    pub fn of_hosts(subscribers: usize) -> Qos {
        Qos { subscribers, buffer: 1 }
    }

    /// The same with one more receiver: a bridge, or a supervisor beside one.
    pub fn and_one_more(self) -> Qos {
        Qos { subscribers: self.subscribers + 1, ..self }
    }

    /// For latencies: at least 1.6 s of what comes every 100 ms.
    pub fn of_latency(subscribers: usize) -> Qos {
        Qos { subscribers, buffer: 16 }
    }

    /// For truth: twice the lead that the plant may have in lockstep; a second at 1 kHz.
    pub fn of_truth(pace: Pace, subscribers: usize) -> Qos {
        let buffer = match pace {
            Pace::Lockstep => 128,
            Pace::Realtime => 1024,
        };
        Qos { subscribers, buffer }
    }
}

/// A service by name and type: payload `P` (a message, or a slice of them), user header `H`.
#[derive(Debug, Clone)]
pub struct Topic<P: ?Sized, H = ()> {
    name: String,
    payload: PhantomData<fn(&P, &H)>,
}

/// `robot/<id>/odometry`: plant to agent.
pub fn odometry(robot: &str) -> Topic<Odometry> {
    Topic::new(format!("robot/{robot}/odometry"))
}

/// `robot/<id>/command`: agent to plant.
pub fn command(robot: &str) -> Topic<Command> {
    Topic::new(format!("robot/{robot}/command"))
}

/// `robot/<id>/beacon`: agent to those that hear it.
pub fn beacon(robot: &str) -> Topic<Beacon> {
    Topic::new(format!("robot/{robot}/beacon"))
}

/// `robot/<id>/status`: agent to supervisor.
pub fn status(robot: &str) -> Topic<[NeighborStatus], StatusHeader> {
    Topic::new(format!("robot/{robot}/status"))
}

/// `robot/<id>/faults`: supervisor to agent, in real time, where links may be cut by hand: how all of its links are, each time that one
/// is cut or mended by hand.
pub fn faults(robot: &str) -> Topic<[LinkFaultByHand]> {
    Topic::new(format!("robot/{robot}/faults"))
}

/// `robot/<id>/goal`: the process of ROS 2 to agent, in real time, where a robot takes goals from outside.
pub fn goal(robot: &str) -> Topic<Goal> {
    Topic::new(format!("robot/{robot}/goal"))
}

/// `ros2/goals`: the process of ROS 2 to the supervisor, where robots take goals from outside.
pub fn goal_counts() -> Topic<GoalCounts> {
    Topic::new("ros2/goals".into())
}

/// `robot/<id>/latency`: agent to supervisor.
pub fn latency(robot: &str) -> Topic<[LatencyRow], LatencyHeader> {
    Topic::new(format!("robot/{robot}/latency"))
}

/// `plant/latency`: plant to supervisor.
pub fn plant_latency() -> Topic<[LatencyRow], LatencyHeader> {
    Topic::new("plant/latency".into())
}

/// `machine/latency`: the control timer of a run in real time to the supervisor.
pub fn machine_latency() -> Topic<[LatencyRow], LatencyHeader> {
    Topic::new("machine/latency".into())
}

/// `host/<name>/orders`: the supervisor of the plant's host to that of another, by their bridges.
pub fn orders(host: &str) -> Topic<[OrderRow], OrderHeader> {
    Topic::new(format!("host/{host}/orders"))
}

/// `host/<name>/report`: the supervisor of a host to that of the plant's, by their bridges.
pub fn report(host: &str) -> Topic<[ReportRow], ReportHeader> {
    Topic::new(format!("host/{host}/report"))
}

/// `host/<name>/bridge`: the bridge of a host to its supervisor, and on to that of the plant's host.
pub fn bridge(host: &str) -> Topic<[PeerRow], BridgeHeader> {
    Topic::new(format!("host/{host}/bridge"))
}

/// `probe`: the supervisor to itself, to see what files a service has.
pub fn probe() -> Topic<u64> {
    Topic::new("probe".into())
}

/// `plant/truth`: plant to supervisor.
pub fn truth() -> Topic<[TruthRow], TruthHeader> {
    Topic::new("plant/truth".into())
}

/// A service created or opened by this process; it stays while one of them lives.
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

    /// The service's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn service_name(&self) -> Result<ServiceName, ServiceError> {
        ServiceName::new(&self.name).map_err(|_| ServiceError::Name { name: self.name.clone() })
    }
}

/// A service that carries one message, or a slice of them behind a header. Not generic: what iceoryx2
/// makes of a message to open and to connect is compiled here once, and not again in each crate.
macro_rules! service {
    ([$row:ty], $header:ty) => {
        service!(of [$row], $header);

        impl Factory<[$row], $header> {
            /// A sender of slices up to a length, which never waits and never allocates.
            pub fn publisher(
                &self,
                length_max: usize,
            ) -> Result<Publisher<[$row], $header>, ServiceError> {
                self.ports
                    .publisher_builder()
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .initial_max_slice_len(length_max.max(1))
                    .allocation_strategy(AllocationStrategy::Static)
                    .create()
                    .map_err(|cause| ServiceError::Publisher { service: self.name.clone(), cause })
            }
        }
    };
    ($message:ty) => {
        service!(of $message, ());

        impl Factory<$message> {
            /// A sender that never waits.
            pub fn publisher(&self) -> Result<Publisher<$message>, ServiceError> {
                self.ports
                    .publisher_builder()
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .create()
                    .map_err(|cause| ServiceError::Publisher { service: self.name.clone(), cause })
            }
        }
    };
    (of $payload:ty, $header:ty) => {
        impl Topic<$payload, $header> {
            /// Creates the service. The supervisor only: a process killed in here would leave
            /// the name unusable for the rest of the run.
            pub fn create(
                &self,
                node: &Node,
                qos: Qos,
            ) -> Result<Factory<$payload, $header>, ServiceError> {
                let builder = node.service_builder(&self.service_name()?);
                let builder = builder.publish_subscribe::<$payload>().user_header::<$header>();
                let ports = with_qos(builder, qos).create().map_err(|cause| {
                    ServiceError::Create { service: self.name.clone(), cause }
                })?;
                Ok(Factory { name: self.name.clone(), ports })
            }

            /// Opens the service that the supervisor created.
            pub fn open(&self, node: &Node) -> Result<Factory<$payload, $header>, ServiceError> {
                let name = self.service_name()?;
                let mut attempts = 1;
                loop {
                    let builder = node.service_builder(&name).publish_subscribe::<$payload>();
                    match builder.user_header::<$header>().open() {
                        Ok(ports) => return Ok(Factory { name: self.name.clone(), ports }),
                        Err(cause) if attempts == OPEN_ATTEMPTS || !passing(cause) => {
                            let service = self.name.clone();
                            let advice = advice(cause);
                            return Err(ServiceError::Open { service, attempts, cause, advice });
                        }
                        Err(_) => std::thread::sleep(OPEN_PAUSE),
                    }
                    attempts += 1;
                }
            }
        }

        impl Factory<$payload, $header> {
            /// A receiver with the service's full queue.
            pub fn subscriber(&self) -> Result<Subscriber<$payload, $header>, ServiceError> {
                self.ports
                    .subscriber_builder()
                    .create()
                    .map_err(|cause| ServiceError::Subscriber { service: self.name.clone(), cause })
            }
        }
    };
}

service!(Odometry);
service!(Command);
service!(Beacon);
service!(Goal);
service!(GoalCounts);
service!([NeighborStatus], StatusHeader);
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
    let subscribers = qos.subscribers + SUBSCRIBERS_SPARE;
    builder
        .enable_safe_overflow(true)
        .history_size(0)
        .max_publishers(PUBLISHERS_MAX)
        .max_subscribers(subscribers)
        .max_nodes(PUBLISHERS_MAX + subscribers + NODES_SPARE)
        .subscriber_max_buffer_size(qos.buffer)
        .subscriber_max_borrowed_samples(BORROWED_MAX)
}

/// Whether another attempt may go better.
fn passing(cause: PublishSubscribeOpenError) -> bool {
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

fn advice(cause: PublishSubscribeOpenError) -> &'static str {
    use PublishSubscribeOpenError as E;
    match cause {
        E::DoesNotExist => "the supervisor creates it: is the robot's name right, is the run over?",
        E::IncompatibleTypes => {
            "this process was built with another layout of the message than the supervisor: rebuild both"
        }
        E::ExceedsMaxNumberOfNodes => {
            "its room was counted from the formation graph; dead processes count until cleaned up"
        }
        _ => "IOX2_LOG_LEVEL=debug says more",
    }
}

impl<P, H> Factory<P, H>
where
    P: Debug + ?Sized + iceoryx2::prelude::IceoryxSend,
    H: Debug + ZeroCopySend,
{
    /// The service's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How many send on this service now, the dead not yet cleaned up included.
    pub fn number_of_publishers(&self) -> usize {
        self.ports.dynamic_config().number_of_publishers()
    }

    /// How many receive from this service now, the dead not yet cleaned up included.
    pub fn number_of_subscribers(&self) -> usize {
        self.ports.dynamic_config().number_of_subscribers()
    }
}

/// Why a slice was not sent.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// No memory to write it to.
    #[error("no room for a slice of {length}: {cause:?}; the sender was made for a certain length")]
    Loan {
        /// How long it was.
        length: usize,
        /// Why.
        cause: iceoryx2::port::LoanError,
    },
    /// It was written, and not delivered.
    #[error("a slice was not delivered: {cause:?}")]
    Send {
        /// Why.
        cause: iceoryx2::port::SendError,
    },
}

/// Sends a header and a slice written in place; returns how many receive it.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run_root::{PATH_BYTES_MAX, RunRoot, join};

    /// A stranger's layout under the name of a command.
    type Wrong = Beacon;

    /// One test, because iceoryx2's configuration is process-wide.
    #[test]
    fn every_service_carries_its_message_and_refuses_another_layout() {
        let parent = tempfile::tempdir_in("/dev/shm").unwrap();
        // The longest that is accepted: iceoryx2 must not run out of it further down.
        let base =
            "b".repeat(PATH_BYTES_MAX - "//01234567".len() - parent.path().as_os_str().len());
        assert!(RunRoot::create(&parent.path().join(format!("{base}b"))).is_err());
        let root = RunRoot::create(&parent.path().join(base)).unwrap();
        join(root.path()).unwrap();
        join(root.path()).unwrap();
        let other = RunRoot::create(&parent.path().join("base")).unwrap();
        assert!(join(other.path()).unwrap_err().to_string().contains("already"));
        drop(other);

        let before = listing("/tmp/iceoryx2");
        let supervisor = node("supervisor").unwrap();
        let child = node("agent r1").unwrap();

        let qos = Qos::of_robot(Pace::Lockstep, 1);
        let sent = Command {
            tick: 7,
            stamp_ns: 1,
            sent_ns: 2,
            sequence: 3,
            incarnation: 0,
            v_m_s: 0.1,
            w_rad_s: -1.0,
        };
        let held = command("r1").create(&supervisor, qos).unwrap();
        let opened = command("r1").open(&child).unwrap();
        let publisher = opened.publisher().unwrap();
        let subscriber = held.subscriber().unwrap();
        assert_eq!((held.number_of_publishers(), held.number_of_subscribers()), (1, 1));
        publisher.send_copy(sent).unwrap();
        assert_eq!(*subscriber.receive().unwrap().unwrap(), sent);
        assert!(subscriber.receive().unwrap().is_none());

        // The oldest gives way, the sender never waits.
        for tick in 0..10 {
            publisher.send_copy(Command { tick, ..sent }).unwrap();
        }
        let mut ticks = Vec::new();
        while let Some(sample) = subscriber.receive().unwrap() {
            ticks.push(sample.tick);
        }
        assert_eq!(ticks, [6, 7, 8, 9]);

        let wrong: Topic<Wrong> = Topic::new(command("r1").name().into());
        let error = wrong.open(&child).unwrap_err().to_string();
        assert!(error.contains("robot/r1/command") && error.contains("another layout"), "{error}");
        let error = command("nobody").open(&child).unwrap_err().to_string();
        assert!(
            error.contains("robot/nobody/command") && error.contains("DoesNotExist"),
            "{error}"
        );

        let held = beacon("r1").create(&supervisor, qos).unwrap();
        let beacon_sent = Beacon {
            tick: 1,
            stamp_ns: 2,
            sent_ns: 3,
            incarnation: 4,
            x_m: 1.0,
            y_m: 2.0,
            vx_m_s: 3.0,
            vy_m_s: 4.0,
            ..Beacon::default()
        };
        let subscriber = held.subscriber().unwrap();
        let publisher = beacon("r1").open(&child).unwrap().publisher().unwrap();
        publisher.send_copy(beacon_sent).unwrap();
        assert_eq!(*subscriber.receive().unwrap().unwrap(), beacon_sent);

        let held = odometry("r1").create(&supervisor, qos).unwrap();
        let odometry_sent = Odometry {
            tick: 1,
            t_ns: 2,
            stamp_ns: 3,
            sent_ns: 4,
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: 3.0,
            v_m_s: 4.0,
            w_rad_s: 5.0,
            pose_valid: 1,
            proximity_valid: 1,
            proximity_cut: 0,
            proximity_count: 1,
            velocities_sensed: 0,
            near: [[0.5; 2]; crate::message::PROXIMITY_MAX],
            walls_count: 1,
            walls_cut: 0,
            walls: [[6.0, 7.0]; crate::message::WALLS_MAX],
        };
        let subscriber = odometry("r1").open(&child).unwrap().subscriber().unwrap();
        let publisher = held.publisher().unwrap();
        publisher.send_copy(odometry_sent).unwrap();
        assert_eq!(*subscriber.receive().unwrap().unwrap(), odometry_sent);

        let held = status("r1").create(&supervisor, Qos::of_status(1)).unwrap();
        let subscriber = held.subscriber().unwrap();
        let publisher = status("r1").open(&child).unwrap().publisher(2).unwrap();
        let header = StatusHeader { tick: 5, ..StatusHeader::default() };
        let neighbor =
            |i| NeighborStatus { robot: i as u64 + 1, contact: 1, since_tick: 0, since_t_ns: 0 };
        send_slice(&publisher, header, 2, neighbor).unwrap();
        send_slice(&publisher, header, 0, neighbor).unwrap();
        assert!(send_slice(&publisher, header, 3, neighbor).is_err());
        let sample = subscriber.receive().unwrap().unwrap();
        assert_eq!((*sample.user_header(), sample.len()), (header, 2));
        assert_eq!(sample[1], neighbor(1));
        assert_eq!(subscriber.receive().unwrap().unwrap().len(), 0);

        let one = Qos::of_robot(Pace::Realtime, 1);
        let publisher = faults("r1").create(&supervisor, one).unwrap().publisher(2).unwrap();
        let subscriber = faults("r1").open(&child).unwrap().subscriber().unwrap();
        let link = |i: usize| LinkFaultByHand { robot: i as u64 + 1, cut: 1 };
        for length in [1, 2] {
            send_slice(&publisher, (), length, link).unwrap();
        }
        let sample = subscriber.receive().unwrap().unwrap();
        assert_eq!(sample.payload(), [link(0), link(1)], "the newest wins");

        let held = truth().create(&supervisor, Qos::of_truth(Pace::Realtime, 1)).unwrap();
        let subscriber = held.subscriber().unwrap();
        let publisher = truth().open(&child).unwrap().publisher(64).unwrap();
        let row = |i| TruthRow {
            x_m: i as f64,
            y_m: 0.0,
            heading_rad: 0.0,
            v_m_s: 0.0,
            w_rad_s: 0.0,
            commanded: 1,
        };
        for tick in 0..1024 {
            let header = TruthHeader { tick, ..TruthHeader::default() };
            send_slice(&publisher, header, 64, row).unwrap();
        }
        for tick in 0..1024 {
            let sample = subscriber.receive().unwrap().unwrap();
            assert_eq!((sample.user_header().tick, sample[63]), (tick, row(63)));
        }

        // All of it is in the root. With ports still open, as after a SIGKILL, nothing outlives it.
        let of_a_kind = |end: &str| {
            let names = listing(root.path().to_str().unwrap());
            names.iter().filter(|name| name.ends_with(end)).count()
        };
        assert_eq!([".dynamic", ".data", ".connection"].map(of_a_kind), [6, 6, 6]);
        let id = root.path().file_name().unwrap().to_str().unwrap();
        assert!(!listing("/dev/shm").iter().any(|name| name.contains(id)));
        root.remove().unwrap();
        assert_eq!(listing("/tmp/iceoryx2"), before);
        assert!(listing(parent.path().to_str().unwrap()).is_empty());
    }

    fn listing(directory: &str) -> Vec<String> {
        std::fs::read_dir(directory)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect()
    }
}
