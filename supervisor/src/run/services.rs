//! Every service of a run. The supervisor makes them all and keeps them in being; agents and the plant
//! open them.

use protocol::brief::Pace;
use protocol::message::{
    Beacon, Command, Goal, GoalCounts, LatencyHeader, LatencyRow, LinkFaultByHand, NeighborStatus,
    Odometry, StatusHeader, TruthHeader, TruthRow,
};
use protocol::ros2::Ros2Brief;
use protocol::service::{self, Factory, Node, Qos, ServiceError};

use experiment::scenario::Scenario;

/// Every service of the run, kept in being.
pub(super) struct Services {
    _odometry: Vec<Factory<Odometry>>,
    _command: Vec<Factory<Command>>,
    _beacon: Vec<Factory<Beacon>>,
    pub(super) status: Vec<Factory<[NeighborStatus], StatusHeader>>,
    pub(super) truth: Factory<[TruthRow], TruthHeader>,
    /// Of the plant, then of the robots in scenario order, then of the control timer if there is one.
    pub(super) latencies: Vec<Factory<[LatencyRow], LatencyHeader>>,
    /// Of the robots in scenario order; none unless links may be cut by hand.
    pub(super) faults: Vec<Factory<[LinkFaultByHand]>>,
    /// Of the robots that take goals from outside.
    _goals: Vec<Factory<Goal>>,
    /// What became of those, if there are such robots.
    pub(super) goal_counts: Option<Factory<GoalCounts>>,
}

/// Whether a process with the robots' timer and nothing else runs beside them.
pub(super) fn has_control_timer(scenario: &Scenario, pace: Pace) -> bool {
    pace == Pace::Realtime && scenario.control_timer
}

impl Services {
    pub(super) fn create(
        node: &Node,
        scenario: &Scenario,
        pace: Pace,
        links_by_hand: bool,
        bridged: bool,
        ros2: Option<&Ros2Brief>,
    ) -> Result<Services, ServiceError> {
        let robots = || scenario.robots.iter().enumerate();
        // Where there are several hosts, the bridge hears as well.
        let with_bridge = |qos: Qos| if bridged { qos.and_one_more() } else { qos };
        let one = with_bridge(Qos::of_robot(pace, 1));
        // Where ROS 2 listens, somebody takes odometry as well.
        let odometry = if ros2.is_some() { one.and_one_more() } else { one };
        let takers = ros2.map_or(&[][..], |ros2| &ros2.goals);
        let hearers = |i| with_bridge(Qos::of_robot(pace, scenario.graph.hearers_of(i).count()));
        Ok(Services {
            _odometry: robots()
                .map(|(_, robot)| service::odometry(&robot.name).create(node, odometry))
                .collect::<Result<_, _>>()?,
            _command: robots()
                .map(|(_, robot)| service::command(&robot.name).create(node, one))
                .collect::<Result<_, _>>()?,
            _beacon: robots()
                .map(|(i, robot)| service::beacon(&robot.name).create(node, hearers(i)))
                .collect::<Result<_, _>>()?,
            status: robots()
                .map(|(_, robot)| service::status(&robot.name).create(node, Qos::of_status(1)))
                .collect::<Result<_, _>>()?,
            truth: service::truth().create(node, Qos::of_truth(pace, 1))?,
            latencies: std::iter::once(service::plant_latency())
                .chain(robots().map(|(_, robot)| service::latency(&robot.name)))
                .chain(has_control_timer(scenario, pace).then(service::machine_latency))
                .map(|topic| topic.create(node, Qos::of_latency(1)))
                .collect::<Result<_, _>>()?,
            faults: robots()
                .filter(|_| links_by_hand)
                .map(|(_, robot)| service::faults(&robot.name).create(node, one))
                .collect::<Result<_, _>>()?,
            _goals: takers
                .iter()
                .map(|taker| service::goal(&taker.robot).create(node, Qos::of_robot(pace, 1)))
                .collect::<Result<_, _>>()?,
            goal_counts: (!takers.is_empty())
                .then(|| service::goal_counts().create(node, Qos::of_robot(pace, 1)))
                .transpose()?,
        })
    }
}
