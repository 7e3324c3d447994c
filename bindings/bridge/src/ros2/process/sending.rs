//! Forwarding of goals from ROS 2 to robots: the newest goal of each robot is sent again in every iteration of
//! the process, so that a restarted robot receives it too.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use formation::Vec2;
use iceoryx2::port::SendError;
use protocol::clock;
use protocol::message::{Goal, GoalCounts};
use protocol::ros2::Ros2Brief;
use protocol::service::{self, Node, Publisher, ServiceError};

use crate::ros2::goals::{GoalArea, GoalInbox};

/// Robots that accept goals, and the goals received for them.
pub struct GoalForwarder {
    goal_area: Arc<GoalArea>,
    inbox: Arc<Mutex<GoalInbox>>,
    receivers: Vec<GoalReceiver>,
    counts_publisher: Option<Publisher<GoalCounts>>,
    /// Counts that were sent last.
    sent_counts: GoalCounts,
}

struct GoalReceiver {
    robot: String,
    start_position: Vec2,
    publisher: Publisher<Goal>,
}

impl GoalForwarder {
    /// Opens the ports of all robots that accept goals.
    pub fn open(brief: &Ros2Brief, node: &Node) -> Result<GoalForwarder, ServiceError> {
        let receivers = brief.goals.iter().map(|goal| {
            let (robot, start_position) = (goal.robot.clone(), goal.start_m.into());
            Ok(GoalReceiver {
                publisher: service::goal_topic(&robot).open(node)?.publisher()?,
                robot,
                start_position,
            })
        });
        let receivers: Vec<GoalReceiver> = receivers.collect::<Result<_, ServiceError>>()?;
        let counts_publisher = || service::goal_counts_topic().open(node)?.publisher();
        Ok(GoalForwarder {
            goal_area: Arc::new(GoalArea::from_brief(brief)),
            inbox: Arc::new(Mutex::new(GoalInbox::new(receivers.len(), clock::now_ns()))),
            counts_publisher: (!receivers.is_empty()).then(counts_publisher).transpose()?,
            receivers,
            sent_counts: GoalCounts::default(),
        })
    }

    /// Returns the handler of goal messages for a robot; `None` if it accepts no goals.
    pub fn goal_handler(&self, robot: &str) -> Option<impl Fn(&[u8]) + Send + Sync + 'static> {
        let receiver_index = self.receivers.iter().position(|receiver| receiver.robot == robot)?;
        let (goal_area, inbox) = (self.goal_area.clone(), self.inbox.clone());
        let start_position = self.receivers[receiver_index].start_position;
        Some(move |message: &[u8]| {
            let goal = goal_area.parse_goal_position(message, start_position);
            lock_inbox(&inbox).store_goal(receiver_index, goal, clock::now_ns());
        })
    }

    /// Sends its newest goal to each robot that has one, and the counts of goals to the supervisor.
    pub fn forward_goals(&mut self) -> Result<(), SendError> {
        let Some(counts_publisher) = &self.counts_publisher else { return Ok(()) };
        let (goals, new_counts): (Vec<_>, _) = {
            let inbox = lock_inbox(&self.inbox);
            (
                (0..self.receivers.len()).map(|robot| inbox.newest_goal(robot)).collect(),
                inbox.counts(),
            )
        };
        for (receiver, goal) in self.receivers.iter().zip(goals) {
            if let Some(goal) = goal {
                receiver.publisher.send_copy(goal)?;
            }
        }
        if new_counts != self.sent_counts {
            counts_publisher.send_copy(new_counts)?;
            self.sent_counts = new_counts;
        }
        Ok(())
    }
}

fn lock_inbox(inbox: &Mutex<GoalInbox>) -> MutexGuard<'_, GoalInbox> {
    // After a panic in another thread the state is still consistent.
    inbox.lock().unwrap_or_else(PoisonError::into_inner)
}
