//! Forwarding of goals from ROS 2 to robots: the newest goal of each robot is sent again in every iteration of
//! the process, so that a restarted robot receives it too.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use formation::Vec2;
use iceoryx2::port::SendError;
use protocol::clock;
use protocol::message::{Goal, GoalCounts};
use protocol::ros2::Ros2Brief;
use protocol::service::{self, Node, Publisher, ServiceError};

use crate::ros2::goals::{Arena, Inbox};

/// Robots that accept goals, and the goals received for them.
pub struct Sending {
    arena: Arc<Arena>,
    inbox: Arc<Mutex<Inbox>>,
    takers: Vec<Taker>,
    counts: Option<Publisher<GoalCounts>>,
    /// Counts that were sent last.
    told: GoalCounts,
}

struct Taker {
    robot: String,
    start: Vec2,
    to: Publisher<Goal>,
}

impl Sending {
    /// Opens the ports of all robots that accept goals.
    pub fn open(brief: &Ros2Brief, node: &Node) -> Result<Sending, ServiceError> {
        let takers = brief.goals.iter().map(|goal| {
            let (robot, start) = (goal.robot.clone(), goal.start_m.into());
            Ok(Taker { to: service::goal(&robot).open(node)?.publisher()?, robot, start })
        });
        let takers: Vec<Taker> = takers.collect::<Result<_, ServiceError>>()?;
        let counts = || service::goal_counts().open(node)?.publisher();
        Ok(Sending {
            arena: Arc::new(Arena::of(brief)),
            inbox: Arc::new(Mutex::new(Inbox::new(takers.len(), clock::now_ns()))),
            counts: (!takers.is_empty()).then(counts).transpose()?,
            takers,
            told: GoalCounts::default(),
        })
    }

    /// Returns the handler of goal messages for a robot; `None` if it accepts no goals.
    pub fn taker(&self, robot: &str) -> Option<impl Fn(&[u8]) + Send + Sync + 'static> {
        let place = self.takers.iter().position(|taker| taker.robot == robot)?;
        let (arena, inbox) = (self.arena.clone(), self.inbox.clone());
        let start = self.takers[place].start;
        Some(move |message: &[u8]| {
            let to = arena.place(message, start);
            lock(&inbox).put(place, to, clock::now_ns());
        })
    }

    /// Sends its newest goal to each robot that has one, and the counts of goals to the supervisor.
    pub fn hand_on(&mut self) -> Result<(), SendError> {
        let Some(counts) = &self.counts else { return Ok(()) };
        let (goals, now): (Vec<_>, _) = {
            let inbox = lock(&self.inbox);
            ((0..self.takers.len()).map(|robot| inbox.newest(robot)).collect(), inbox.counts())
        };
        for (taker, goal) in self.takers.iter().zip(goals) {
            if let Some(goal) = goal {
                taker.to.send_copy(goal)?;
            }
        }
        if now != self.told {
            counts.send_copy(now)?;
            self.told = now;
        }
        Ok(())
    }
}

fn lock(inbox: &Mutex<Inbox>) -> MutexGuard<'_, Inbox> {
    // After a panic in another thread the state is still consistent.
    inbox.lock().unwrap_or_else(PoisonError::into_inner)
}
