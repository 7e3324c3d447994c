//! Services of a run. The supervisor creates all of them and keeps them open; agents and the plant connect to them.

use protocol::brief::{BridgeBrief, Pace};
use protocol::message::{
    Beacon, Command, Goal, GoalCounts, LatencyHeader, LatencyRow, LinkFaultByHand, Odometry,
    StatusHeader, TruthHeader, TruthRow,
};
use protocol::ros2::Ros2Brief;
use protocol::service::{self, Factory, Node, Qos, ServiceError, Topic};

use experiment::scenario::Scenario;

/// Services of robots, kept open.
pub(crate) struct RobotServices {
    _odometry: Vec<Factory<Odometry>>,
    _command: Vec<Factory<Command>>,
    _beacon: Vec<Factory<[u8], Beacon>>,
    /// Status services of the robots, in scenario order.
    pub(super) status: Vec<Factory<[u8], StatusHeader>>,
    /// Latency services: of the plant, then of the robots in scenario order, then of the control process if
    /// there is one.
    pub(super) latencies: Vec<Factory<[LatencyRow], LatencyHeader>>,
}

/// Services of the whole run, kept open.
pub(super) struct RunServices {
    pub(super) robots: RobotServices,
    pub(super) truth: Factory<[TruthRow], TruthHeader>,
    /// Services of interactive link faults for the robots, in scenario order; empty unless links may be cut
    /// interactively.
    pub(super) faults: Vec<Factory<[LinkFaultByHand]>>,
    /// Goal services of the robots that accept goals from outside.
    _goals: Vec<Factory<Goal>>,
    /// Service of goal counts, if there are such robots.
    pub(super) goal_counts: Option<Factory<GoalCounts>>,
}

/// Returns whether the run has a control process.
pub(super) fn has_control_timer(scenario: &Scenario, pace: Pace) -> bool {
    pace == Pace::Realtime && scenario.realtime.control_timer
}

impl RobotServices {
    /// Creates the services on a host without the plant: for its robots, and for the beacons of remote
    /// robots that they receive.
    pub(crate) fn open_for_host(
        node: &Node,
        scenario: &Scenario,
        brief: &BridgeBrief,
    ) -> Result<RobotServices, ServiceError> {
        let is_local = |robot: usize| brief.robots[robot].host == brief.here;
        let robot_qos = Qos::for_robot(Pace::Realtime, 1).with_additional_receiver();
        let graph = scenario.graph_of_receivers();
        let beacon_qos = |robot: usize| {
            let local_receivers =
                graph.outgoing_edges(robot).filter(|edge| is_local(edge.to)).count();
            let with_messages = scenario.message_format(robot).is_some();
            let qos = Qos::for_beacons(Pace::Realtime, local_receivers, with_messages)
                .with_additional_receiver();
            (is_local(robot) || local_receivers > 0).then_some(qos)
        };
        RobotServices::create(
            node,
            scenario,
            is_local,
            robot_qos,
            robot_qos,
            beacon_qos,
            [None, None],
        )
    }

    /// Creates the services of robots of this host, of the beacons for which `beacon_qos` returns a value, and
    /// the latencies of other processes, ordered before and after the robots' latencies.
    fn create(
        node: &Node,
        scenario: &Scenario,
        is_local: impl Fn(usize) -> bool,
        odometry: Qos,
        command: Qos,
        beacon_qos: impl Fn(usize) -> Option<Qos>,
        [before, after]: [Option<Topic<[LatencyRow], LatencyHeader>>; 2],
    ) -> Result<RobotServices, ServiceError> {
        let names: Vec<&str> = scenario.robots.iter().map(|robot| robot.name.as_str()).collect();
        let local_robots =
            || (0..names.len()).filter(|&robot| is_local(robot)).map(|robot| names[robot]);
        let beacon_robots =
            (0..names.len()).filter_map(|robot| Some((names[robot], beacon_qos(robot)?)));
        let latencies = local_robots().map(service::latency_topic);
        Ok(RobotServices {
            _odometry: local_robots()
                .map(|name| service::odometry_topic(name).create(node, odometry))
                .collect::<Result<_, _>>()?,
            _command: local_robots()
                .map(|name| service::command_topic(name).create(node, command))
                .collect::<Result<_, _>>()?,
            _beacon: beacon_robots
                .map(|(name, qos)| service::beacon_topic(name).create(node, qos))
                .collect::<Result<_, _>>()?,
            status: local_robots()
                .map(|name| service::status_topic(name).create(node, Qos::for_status(1)))
                .collect::<Result<_, _>>()?,
            latencies: before
                .into_iter()
                .chain(latencies)
                .chain(after)
                .map(|topic| topic.create(node, Qos::for_latency(1)))
                .collect::<Result<_, _>>()?,
        })
    }
}

impl RunServices {
    pub(super) fn create(
        node: &Node,
        scenario: &Scenario,
        pace: Pace,
        links_by_hand: bool,
        has_bridge: bool,
        ros2: Option<&Ros2Brief>,
    ) -> Result<RunServices, ServiceError> {
        // With several hosts, the bridge is another subscriber.
        let with_bridge = |qos: Qos| if has_bridge { qos.with_additional_receiver() } else { qos };
        let robot_qos = with_bridge(Qos::for_robot(pace, 1));
        // With ROS 2, its bridge is another subscriber of odometry.
        let odometry =
            if ros2.is_some() { robot_qos.with_additional_receiver() } else { robot_qos };
        let graph = scenario.graph_of_receivers();
        let beacon_qos = |i| {
            let with_messages = scenario.message_format(i).is_some();
            let receiver_count = graph.outgoing_edges(i).count();
            Some(with_bridge(Qos::for_beacons(pace, receiver_count, with_messages)))
        };
        let control_timer = has_control_timer(scenario, pace).then(service::machine_latency_topic);
        let others = [Some(service::plant_latency_topic()), control_timer];
        let goal_receivers = ros2.map_or(&[][..], |ros2| &ros2.goals);
        let names = scenario.robots.iter().map(|robot| robot.name.as_str());
        Ok(RunServices {
            robots: RobotServices::create(
                node,
                scenario,
                |_| true,
                odometry,
                robot_qos,
                beacon_qos,
                others,
            )?,
            truth: service::truth_topic().create(node, Qos::for_truth(pace, 1))?,
            faults: names
                .filter(|_| links_by_hand)
                .map(|name| service::link_faults_topic(name).create(node, robot_qos))
                .collect::<Result<_, _>>()?,
            _goals: goal_receivers
                .iter()
                .map(|goal_receiver| {
                    service::goal_topic(&goal_receiver.robot).create(node, Qos::for_robot(pace, 1))
                })
                .collect::<Result<_, _>>()?,
            goal_counts: (!goal_receivers.is_empty())
                .then(|| service::goal_counts_topic().create(node, Qos::for_robot(pace, 1)))
                .transpose()?,
        })
    }
}
