//! A run as a recording that other people's tools open: MCAP with the profile `ros2`, messages in
//! CDR, their definitions beside them.
//!
//! | file | question it answers |
//! |---|---|
//! | `recorder` | how does a run get into the file? |
//! | `topics` | under which names? |
//! | `messages` | how do metrics and events look in it? |
//! | `walls` | how do walls look in it? |
//! | `schemas` | how is each message defined, in ROS 2's own words? |
//! | `writer` | what is in a file of MCAP, from its first byte to its last? |
//! | `chunk` | how do messages become a chunk and its indexes? |
//! | `records` | how is one record written? |
//! | `pieces` | what is in a file, as far as it is whole? |
//! | `recover` | how does a file get its end back that a killed supervisor never wrote? |
//! | `export` | how does a recording become tables? |
//!
//! Knows nothing of processes, scenarios or iceoryx2, and reads no clock but to flush in time, which
//! a reproducible recording does by run time.
//!
//! # What is recorded
//!
//! All stamps, of messages and in them, are the start of the run plus run time: by the wall clock in
//! real time, and always the same in lockstep. World frame `map`, SI units, x forward, y left.
//!
//! | topic | type | content |
//! |---|---|---|
//! | `/tf` | `tf2_msgs/TFMessage` | `map` to `<robot>/base_link`, all robots in one message |
//! | `/<robot>/odom` | `nav_msgs/Odometry` | the true pose, and the twist in the robot's own frame; covariances are 0 |
//! | `/<robot>/pose` | `geometry_msgs/PoseStamped` | the true pose of the middle of the axle |
//! | `/<robot>/cmd_vel` | `geometry_msgs/Twist` | the twist that drove the robot over the arc that ends here: its command, as far as limits, faults and the dead man's switch let it through |
//! | `/metrics` | `phalanx_msgs/Metrics` | the smallest distance and its pair, errors, who lives |
//! | `/walls` | `visualization_msgs/MarkerArray` | walls and obstacles, once and latched; only where there are some |
//! | `/rosout` | `rcl_interfaces/Log` | events, with the robot as `name`, the kind as `function` |
//!
//! A robot's name is as it is in frames and messages; in topics, where ROS allows no dash, it is
//! [spelled](topics) with underscores. The scenario and the manifest are attachments, the facts of
//! the run metadata under the name `phalanx`.

mod chunk;
pub mod export;
mod messages;
mod pieces;
pub mod recorder;
mod records;
pub mod recover;
mod schemas;
pub mod topics;
mod walls;
mod writer;

#[cfg(test)]
mod tests;
