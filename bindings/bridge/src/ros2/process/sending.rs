//! How goals get from ROS 2 to robots: each robot's newest is said again with every turn of the process, so that
//! a replacement of the robot hears it too.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use formation::Vec2;
use iceoryx2::port::SendError;
use protocol::clock;
use protocol::message::{Goal, GoalCounts};
use protocol::ros2::Ros2Brief;
use protocol::service::{self, Node, Publisher, ServiceError};

use crate::ros2::goals::{Arena, Inbox};

/// The robots that take goals, and what came for them.
pub struct Sending {
    arena: Arc<Arena>,
    inbox: Arc<Mutex<Inbox>>,
    takers: Vec<Taker>,
    counts: Option<Publisher<GoalCounts>>,
    /// What was told of that last.
    told: GoalCounts,
}

struct Taker {
    robot: String,
    start: Vec2,
    to: Publisher<Goal>,
}

impl Sending {
    /// To all robots of the brief that take goals.
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

    /// What takes the messages for a robot, if that takes goals.
    pub fn taker(&self, robot: &str) -> Option<impl Fn(&[u8]) + Send + Sync + 'static> {
        let place = self.takers.iter().position(|taker| taker.robot == robot)?;
        let (arena, inbox) = (self.arena.clone(), self.inbox.clone());
        let start = self.takers[place].start;
        Some(move |message: &[u8]| {
            let to = arena.place(message, start);
            lock(&inbox).put(place, to, clock::now_ns());
        })
    }

    /// Says to each robot where it is to go, if it was sent anywhere, and to the supervisor what became of goals.
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
    // Whoever panicked left nothing half-done.
    inbox.lock().unwrap_or_else(PoisonError::into_inner)
}
