//! A run as ROS 2 sees it, on the wire of rmw_zenoh, without ROS on our side.
//!
//! Topics: `/<robot>/odom` and `/tf` out, `/<robot>/goal_pose` in, as [`protocol::ros2::messages`] has them. The forms are those of
//! Iron to Lyrical; Humble has no type hashes, and hears nothing.
//!
//! Must not: be between a robot and anybody that it needs. The process reads odometry as one more receiver, and
//! without it a robot goes where it was sent last.
//!
//! | file | question it answers |
//! |---|---|
//! | `names` | under which keys and tokens does ROS 2 know a node and its topics, and what goes beside each message? |
//! | `goals` | which goals are taken, and why are others not? |
//! | `process` | how does the process carry all that? |

pub mod goals;
pub mod names;
#[cfg(feature = "zenoh")]
pub mod process;
