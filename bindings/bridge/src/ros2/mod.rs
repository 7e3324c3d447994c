//! A run as ROS 2 sees it, on the wire of rmw_zenoh, without ROS on our side.
//!
//! Topics: `/<robot>/odom` and `/tf` out, `/<robot>/goal_pose` in. Frames by REP 103 and 105: everything is in `map`, which stands
//! still, and `<robot>/base_link` lies on the axle's mid-point, x forward. The forms are those of Iron
//! to Lyrical; Humble has no type hashes, and hears nothing.
//!
//! Must not: be between a robot and anybody that it needs. The process reads odometry as one more receiver, and
//! without it a robot goes where it was sent last.
//!
//! | file | question it answers |
//! |---|---|
//! | `names` | under which keys and tokens does ROS 2 know a node and its topics? |
//! | `attachment` | what goes beside each message? |
//! | `cdr` | how are numbers and strings laid out in a message? |
//! | `messages` | what is in the messages? |
//! | `goals` | which goals are taken, and why are others not? |
//! | `stamp` | what time is it in ROS? |
//! | `process` | how does the process carry all that? |

pub mod attachment;
pub mod cdr;
pub mod goals;
pub mod messages;
pub mod names;
#[cfg(feature = "zenoh")]
pub mod process;
pub mod stamp;
