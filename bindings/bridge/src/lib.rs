//! Runs on several hosts: the fleet, the messages between hosts, and the bridge process that carries them; and
//! the interface to ROS 2.
//!
//! A bridge is never between two robots of one host. Only the folders `process/` open connections, and only with
//! the feature `zenoh`.
//!
//! | file | content |
//! |---|---|
//! | `fleet` | hosts and their robots |
//! | `keys` | keys of a fleet file |
//! | `certificates` | TLS certificates of hosts |
//! | `topics` | messages between hosts, and their zenoh keys |
//! | `frame` | header of every sample on the wire |
//! | `gate` | acceptance of frames |
//! | `clock` | estimation of the time of the plant's host |
//! | `unacked_queue` | at-least-once delivery of status and latencies to the plant's host |
//! | `process/` | the bridge process |
//! | `wire` | opening and closing of zenoh sessions |
//! | `examples` | briefs for tests |
//! | `ros2/` | interface to ROS 2 |

#[cfg(feature = "zenoh")]
pub mod certificates;
pub mod clock;
pub mod examples;
pub mod fleet;
pub mod frame;
pub mod gate;
pub mod keys;
#[cfg(feature = "zenoh")]
pub mod process;
pub mod ros2;
pub mod topics;
pub mod unacked_queue;
#[cfg(feature = "zenoh")]
pub mod wire;
