//! The process `phalanx-ros2`: takes each robot's newest odometry at its own pace, and sends it on; and hands
//! goals to robots.
//!
//! Must not: wait for a reader, or run before any robot.
//!
//! | file | question it answers |
//! |---|---|
//! | `wire` | how do messages get to ROS 2 and from there? |
//! | `sending` | how do goals get to robots? |

mod sending;
mod wire;

use std::io;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use iceoryx2::port::{ReceiveError, SendError};
use protocol::brief::{self, BriefError};
use protocol::clock::{self, Timer};
use protocol::message::Odometry;
use protocol::process::{self, Stop};
use protocol::ros2::Ros2Brief;
use protocol::run_root::{self, RunRootError};
use protocol::service::{self, Node, ServiceError, Subscriber};

use super::messages::{self, State};
use super::names::{self, ODOMETRY, POSE_STAMPED, TF};
use super::stamp::RosClock;
use crate::wire::WireError;
use sending::Sending;
use wire::{Sender, Wire};

/// Robots go first, wherever time is short. (nice, of 19)
const NICE: i32 = 5;

/// Why it gave up.
#[derive(Debug, thiserror::Error)]
enum Ros2Error {
    #[error(transparent)]
    Brief(#[from] BriefError),
    #[error("cannot handle signals: {0}")]
    Signals(#[from] io::Error),
    #[error(transparent)]
    RunRoot(#[from] RunRootError),
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error("cannot receive odometry: {0}")]
    Receive(#[from] ReceiveError),
    #[error("cannot hand goals on: {0}")]
    Send(#[from] SendError),
}

/// Shows the run of this brief to ROS 2 until told to stop.
pub fn main(brief: &Path) -> u8 {
    process::set_name("phalanx-ros2");
    process::log_to_stderr();
    if let Err(error) = rustix::process::nice(NICE) {
        tracing::warn!(%error, "this process has the priority of robots");
    }
    match run(brief) {
        Ok(()) => process::exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            process::exit::INFRASTRUCTURE
        }
    }
}

fn run(path: &Path) -> Result<(), Ros2Error> {
    let brief: Ros2Brief = brief::read(path)?;
    let stop = Stop::on_signals()?;
    run_root::join(&brief.run_root)?;
    let node = service::node("ros2")?;
    let sources = brief.robots.iter().map(|robot| source(&node, robot));
    let sources: Vec<_> = sources.collect::<Result<_, _>>()?;
    let sending = Sending::open(&brief, &node)?;
    let Some(wire) = Wire::open(&brief, &stop)? else { return Ok(()) };
    let mut face = Face::declare(&wire, &brief, sources, sending)?;
    tracing::info!(address = %brief.address, domain = brief.domain, "ROS 2 can listen");
    let mut timer = Timer::new(brief.period_ns, 0);
    while !stop.requested() {
        if timer.wait().is_some() {
            face.publish()?;
            face.sending.hand_on()?;
        }
    }
    drop(face);
    wire.close();
    Ok(())
}

fn source(node: &Node, robot: &str) -> Result<Subscriber<Odometry>, ServiceError> {
    service::odometry(robot).open(node)?.subscriber()
}

/// As both clocks are now. A wall clock before 1970 counts as 1970.
fn ros_clock() -> RosClock {
    let before_ns = clock::now_ns();
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    RosClock::new(before_ns.midpoint(clock::now_ns()), wall.as_nanos() as u64)
}

/// Everything that ROS 2 sees.
struct Face<'a> {
    ros: RosClock,
    robots: Vec<Robot<'a>>,
    tf: Sender,
    sending: Sending,
    _receivers: Vec<wire::Receiver>,
    /// They are there as long as these are.
    _nodes: Vec<wire::Node>,
}

struct Robot<'a> {
    name: &'a str,
    source: Subscriber<Odometry>,
    odom: Sender,
}

impl<'a> Face<'a> {
    /// One node for each robot, named as the robot, and one for all.
    fn declare(
        wire: &Wire,
        brief: &'a Ros2Brief,
        sources: Vec<Subscriber<Odometry>>,
        sending: Sending,
    ) -> Result<Face<'a>, WireError> {
        let all = wire.node(brief.domain, "phalanx")?;
        let tf = wire.sender(&all, "/tf", TF)?;
        let (mut robots, mut nodes, mut receivers) = (Vec::new(), vec![all], Vec::new());
        for (name, source) in brief.robots.iter().zip(sources) {
            let node = wire.node(brief.domain, name)?;
            let odom = wire.sender(&node, &names::odom(name), ODOMETRY)?;
            if let Some(take) = sending.taker(name) {
                receivers.push(wire.receive(&node, &names::goal_pose(name), POSE_STAMPED, take)?);
            }
            robots.push(Robot { name, source, odom });
            nodes.push(node);
        }
        let (ros, _receivers, _nodes) = (ros_clock(), receivers, nodes);
        Ok(Face { ros, robots, tf, sending, _receivers, _nodes })
    }

    /// What is new of each robot. Of a robot whose pose is not sensed, nothing.
    fn publish(&mut self) -> Result<(), ReceiveError> {
        let mut states = Vec::with_capacity(self.robots.len());
        for robot in &mut self.robots {
            let mut newest: Option<Odometry> = None;
            while let Some(sample) = robot.source.receive()? {
                newest = Some(*sample);
            }
            let Some(sample) = newest.filter(|sample| sample.pose_valid == 1) else { continue };
            let state = State {
                robot: robot.name,
                ros_ns: self.ros.at(sample.stamp_ns),
                pose: sample.pose(),
                twist: sample.twist(),
            };
            robot.odom.send(state.ros_ns, messages::odometry(&state));
            states.push(state);
        }
        if let Some(newest_ns) = states.iter().map(|state| state.ros_ns).max() {
            self.tf.send(newest_ns, messages::transforms(&states));
        }
        Ok(())
    }
}
