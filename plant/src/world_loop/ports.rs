//! Ports of the plant: odometry to and commands from every robot, and ground truth to the supervisor.

use iceoryx2::port::update_connections::UpdateConnections as _;
use protocol::brief::PlantBrief;
use protocol::clock;
use protocol::incarnations::Incarnations;
use protocol::latency::LatencyRecorder;
use protocol::latency_port::LatencyPort;
use protocol::message::{Command, Odometry, TruthHeader, TruthRow};
use protocol::process::Failure;
use protocol::service::{self, Factory, Node, Publisher, ServiceError, Subscriber, send_slice};

use crate::motion::Motion;
use crate::simulation_step::ReceivedCommand;
use crate::world::World;

/// All ports of the plant, robots in scenario order.
pub struct Ports {
    robots: Vec<RobotPorts>,
    truth: Publisher<[TruthRow], TruthHeader>,
    /// Incarnations whose commands are refused.
    incarnations: Incarnations,
    /// Port for latency measurements.
    pub latency: LatencyPort,
    _node: Node,
}

struct RobotPorts {
    odometry: Publisher<Odometry>,
    command: Subscriber<Command>,
    command_service: Factory<Command>,
}

impl Ports {
    /// Opens the services of all robots of the brief, and one for the `measured` latencies.
    pub fn open(brief: &PlantBrief, measured: &LatencyRecorder) -> Result<Ports, Failure> {
        let node = service::create_node("plant")?;
        let robots = brief
            .robots
            .iter()
            .map(|robot| {
                let command_service = service::command_topic(&robot.name).open(&node)?;
                Ok(RobotPorts {
                    odometry: service::odometry_topic(&robot.name).open(&node)?.publisher()?,
                    command: command_service.subscriber()?,
                    command_service,
                })
            })
            .collect::<Result<_, ServiceError>>()?;
        let truth = service::truth_topic().open(&node)?.publisher(brief.robots.len())?;
        let latency = LatencyPort::new(&service::plant_latency_topic().open(&node)?, measured)?;
        let incarnations = Incarnations::open(&brief.run_root, brief.robots.len());
        let incarnations =
            incarnations.map_err(|cause| port_failure("map the incarnations", cause))?;
        Ok(Ports { robots, truth, incarnations, latency, _node: node })
    }

    /// Returns the robots whose agents have not created all their ports yet.
    pub fn robots_not_ready(&self) -> impl Iterator<Item = usize> {
        let ready = |robot: &RobotPorts| robot.command_service.number_of_publishers() > 0;
        (0..self.robots.len()).filter(move |&i| !ready(&self.robots[i]))
    }

    /// Connects to all ports present. Without this call it happens at the first samples.
    ///
    /// # Errors
    /// This process lacks descriptors or memory for a connection.
    pub fn connect(&self) -> Result<(), Failure> {
        for robot in &self.robots {
            let connected = robot.odometry.update_connections();
            connected
                .and_then(|()| robot.command.update_connections())
                .map_err(|cause| port_failure("connect", cause))?;
        }
        Ok(())
    }

    /// Returns the next command in the queue of `robot`, or `None` if it is empty.
    pub fn receive_command(&self, robot: usize) -> Result<Option<ReceivedCommand>, Failure> {
        let sample = self.robots[robot].command.receive();
        let sample = sample.map_err(|cause| port_failure("receive a command", cause))?;
        Ok(sample.map(|command| ReceivedCommand {
            robot,
            command: *command,
            received_ns: clock::now_ns(),
            is_from_dead_incarnation: !self.incarnations.is_accepted(robot, command.incarnation),
        }))
    }

    /// Returns all received commands. Each one is taken from its queue when the iterator reaches it.
    pub fn receive_commands(&self) -> impl Iterator<Item = Result<ReceivedCommand, Failure>> {
        let queue =
            move |robot| std::iter::from_fn(move || self.receive_command(robot).transpose());
        (0..self.robots.len()).flat_map(queue)
    }

    /// Sends an odometry sample to `robot`. `fill` receives it in shared memory, with default values, and completes it.
    pub fn send_odometry(
        &self,
        robot: usize,
        fill: impl FnOnce(&mut Odometry),
    ) -> Result<(), Failure> {
        let loan = self.robots[robot].odometry.loan_uninit();
        let loan = loan.map_err(|cause| port_failure("send odometry", cause))?;
        let mut sample = loan.write_payload(Odometry::default());
        fill(sample.payload_mut());
        sample.send().map(drop).map_err(|cause| port_failure("send odometry", cause))
    }

    /// Sends the ground truth of all robots to the supervisor.
    pub fn send_truth<M: Motion>(&self, world: &World<M>) -> Result<(), Failure> {
        let header = TruthHeader { sent_ns: clock::now_ns(), ..world.truth_header() };
        let mut rows = world.truth();
        let next_row = |_| rows.next().expect("a row for every robot");
        let sent = send_slice(&self.truth, header, self.robots.len(), next_row);
        sent.map(drop).map_err(|cause| port_failure("send truth", cause))
    }
}

fn port_failure(what: &str, cause: impl std::fmt::Display) -> Failure {
    format!("cannot {what}: {cause}").into()
}
