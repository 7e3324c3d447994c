//! Recording of a run that other tools open: MCAP with the profile `ros2`, CDR messages, and their definitions.
//!
//! | file | question it answers |
//! |---|---|
//! | `recorder` | how is a run written to the file? |
//! | `topics` | how are topics named? |
//! | `messages` | how are metrics and events encoded? |
//! | `walls` | how are walls encoded? |
//! | `schemas` | what are the ROS 2 definitions of the messages? |
//! | `writer` | what does an MCAP file contain, from the first byte to the last? |
//! | `chunk` | how do messages become a chunk and its indexes? |
//! | `records` | how is one record encoded? |
//! | `record_reader` | how are the valid records of a possibly damaged file read? |
//! | `recover` | how does a file get the index that a killed supervisor never wrote? |
//! | `export` | how is a recording converted to tables? |
//!
//! Does not depend on processes, scenarios or iceoryx2. Reads the clock only to flush in time; a reproducible
//! recording is flushed by run time.
//!
//! # What is recorded
//!
//! All stamps, of messages and inside of them, are the start of the run plus run time: the wall clock in real time,
//! and a constant start in lockstep. World frame `map`, SI units, x forward, y left.
//!
//! | topic | type | content |
//! |---|---|---|
//! | `/tf` | `tf2_msgs/TFMessage` | `map` to `<robot>/base_link`, all robots in one message |
//! | `/<robot>/odom` | `nav_msgs/Odometry` | true pose, and twist in the robot's frame; covariances are 0 |
//! | `/<robot>/pose` | `geometry_msgs/PoseStamped` | true pose of the axle midpoint |
//! | `/<robot>/cmd_vel` | `geometry_msgs/Twist` | twist that drove the robot over the arc that ends here: its command after limits, faults and the command timeout |
//! | `/metrics` | `phalanx_msgs/Metrics` | smallest distance and its pair, errors, living robots |
//! | `/walls` | `visualization_msgs/MarkerArray` | walls and obstacles, once and latched; only if there are any |
//! | `/rosout` | `rcl_interfaces/Log` | events, with the robot as `name`, the kind as `function` |
//!
//! Frames and messages contain the robot's name unchanged. ROS allows no dash in topics, so topics are
//! [spelled](topics::topic_names) with underscores. The scenario and the manifest are attachments; the facts of the
//! run are metadata with the name `phalanx`.

mod chunk;
pub mod export;
mod messages;
mod record_reader;
pub mod recorder;
mod records;
pub mod recover;
mod schemas;
pub mod topics;
mod walls;
mod writer;

#[cfg(test)]
mod tests;
