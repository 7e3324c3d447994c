//! Interface to ROS 2 through the wire format of rmw_zenoh, without ROS on this side.
//!
//! Topics: `/<robot>/odom` and `/tf` out, `/<robot>/goal_pose` in, as in [`protocol::ros2::messages`]. The
//! formats are those of ROS 2 Iron to Lyrical; Humble has no type hashes and receives nothing.
//!
//! Must not: be part of a path that a robot depends on. The process receives odometry as an additional receiver,
//! and without it a robot keeps its last goal.
//!
//! | file | content |
//! |---|---|
//! | `names` | keys and liveliness tokens of nodes and topics, and attachments of messages |
//! | `goals` | acceptance of goals |
//! | `process` | the ROS 2 process |

pub mod goals;
pub mod names;
#[cfg(feature = "zenoh")]
pub mod process;
