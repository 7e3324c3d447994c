//! The process `phalanx-ros2`: reads each robot's newest odometry at its own rate and sends it to ROS 2, and
//! forwards goals to robots.
//!
//! Must not: wait for a reader, or delay a robot.
//!
//! | file | content |
//! |---|---|
//! | `wire` | connection to ROS 2 |
//! | `sending` | forwarding of goals to robots |

mod sending;
mod wire;

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use iceoryx2::port::ReceiveError;
use protocol::brief;
use protocol::clock::{self, Timer};
use protocol::message::Odometry;
use protocol::process::{self, Failure, StopFlag};
use protocol::ros2::messages::{self, StampedState, base_link};
use protocol::ros2::{Ros2Brief, cdr};
use protocol::run_root;
use protocol::service::{self, Node, ServiceError, Subscriber};

use super::names::{self, ODOMETRY, POSE_STAMPED, TF};
use crate::wire::WireError;
use sending::GoalForwarder;
use wire::{Ros2Session, Sender};

/// Nice value of the process, of at most 19: robots are scheduled first.
const NICE_VALUE: i32 = 5;

/// Publishes the run of this brief to ROS 2 until the process is asked to stop.
pub fn main(brief: &Path) -> u8 {
    process::main("phalanx-ros2", false, || {
        if let Err(error) = rustix::process::nice(NICE_VALUE) {
            tracing::warn!(%error, "cannot lower the priority of this process");
        }
        run(brief)
    })
}

fn run(path: &Path) -> Result<(), Failure> {
    let brief: Ros2Brief = brief::read(path)?;
    let stop = StopFlag::for_termination_signals()?;
    run_root::join(&brief.run_root)?;
    let node = service::create_node("ros2")?;
    let sources = brief.robots.iter().map(|robot| subscribe_odometry(&node, robot));
    let sources: Vec<_> = sources.collect::<Result<_, _>>()?;
    let goal_forwarder = GoalForwarder::open(&brief, &node)?;
    let Some(session) = Ros2Session::open(&brief, &stop)? else { return Ok(()) };
    let mut publisher = RosPublisher::declare(&session, &brief, sources, goal_forwarder)?;
    tracing::info!(address = %brief.address, domain = brief.domain, "ready for ROS 2");
    let mut timer = Timer::new(brief.period_ns, 0);
    while !stop.is_requested() {
        if timer.wait().is_some() {
            publisher.publish().map_err(|error| format!("cannot receive odometry: {error}"))?;
            publisher
                .goal_forwarder
                .forward_goals()
                .map_err(|error| format!("cannot forward goals: {error}"))?;
        }
    }
    drop(publisher);
    session.close();
    Ok(())
}

fn subscribe_odometry(node: &Node, robot: &str) -> Result<Subscriber<Odometry>, ServiceError> {
    service::odometry_topic(robot).open(node)?.subscriber()
}

/// Returns the offset from CLOCK_MONOTONIC to ROS time, which is the wall clock, ns. It is read once: stamps of a
/// run never go back, even if the wall clock is set meanwhile. A wall clock before 1970 counts as 1970.
fn ros_offset_ns() -> u64 {
    let before_ns = clock::now_ns();
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    (wall.as_nanos() as u64).saturating_sub(before_ns.midpoint(clock::now_ns()))
}

/// Everything that ROS 2 receives.
struct RosPublisher {
    ros_offset_ns: u64,
    robots: Vec<OdometryForwarder>,
    tf_sender: Sender,
    message_buffer: cdr::Writer,
    goal_forwarder: GoalForwarder,
    _receivers: Vec<wire::Receiver>,
    /// Tokens of the nodes, which exist while these values live.
    _nodes: Vec<wire::AnnouncedNode>,
}

struct OdometryForwarder {
    frame: String,
    source: Subscriber<Odometry>,
    odometry_sender: Sender,
}

impl RosPublisher {
    /// Declares a node for each robot, with the robot's name, and a node for the run.
    fn declare(
        session: &Ros2Session,
        brief: &Ros2Brief,
        sources: Vec<Subscriber<Odometry>>,
        goal_forwarder: GoalForwarder,
    ) -> Result<RosPublisher, WireError> {
        let run_node = session.announce_node(brief.domain, "phalanx")?;
        let tf_sender = session.declare_sender(&run_node, "/tf", TF)?;
        let (mut robots, mut nodes, mut receivers) = (Vec::new(), vec![run_node], Vec::new());
        for (name, source) in brief.robots.iter().zip(sources) {
            let node = session.announce_node(brief.domain, name)?;
            let odometry_sender =
                session.declare_sender(&node, &names::odometry_topic(name), ODOMETRY)?;
            if let Some(handle_message) = goal_forwarder.goal_handler(name) {
                receivers.push(session.declare_receiver(
                    &node,
                    &names::goal_topic(name),
                    POSE_STAMPED,
                    handle_message,
                )?);
            }
            robots.push(OdometryForwarder { frame: base_link(name), source, odometry_sender });
            nodes.push(node);
        }
        Ok(RosPublisher {
            ros_offset_ns: ros_offset_ns(),
            robots,
            tf_sender,
            message_buffer: cdr::Writer::new(),
            goal_forwarder,
            _receivers: receivers,
            _nodes: nodes,
        })
    }

    /// Publishes new odometry of each robot, unless its pose is not valid.
    fn publish(&mut self) -> Result<(), ReceiveError> {
        let message = &mut self.message_buffer;
        let (mut states, mut newest_ns) = (Vec::with_capacity(self.robots.len()), 0);
        for robot in &mut self.robots {
            let mut newest: Option<Odometry> = None;
            while let Some(sample) = robot.source.receive()? {
                newest = Some(*sample);
            }
            let Some(sample) = newest.filter(|sample| sample.pose_valid == 1) else { continue };
            let stamp_ns = sample.stamp_ns + self.ros_offset_ns;
            let state = StampedState::new(&robot.frame, stamp_ns, sample.pose(), sample.twist());
            messages::write_odometry(message, &state);
            robot.odometry_sender.send(stamp_ns, message.bytes());
            newest_ns = newest_ns.max(stamp_ns);
            states.push(state);
        }
        if !states.is_empty() {
            messages::begin_transforms(message, states.len());
            states.iter().for_each(|state| messages::write_transform(message, state));
            self.tf_sender.send(newest_ns, message.bytes());
        }
        Ok(())
    }
}
