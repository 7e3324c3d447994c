//! Several hosts: who lives where, what crosses between them, and the process that carries it; and what ROS 2 sees of a run.
//!
//! A bridge is never between two robots of one host. Of what is here only the folders `process/` open a
//! connection, and only with the feature `zenoh`.
//!
//! | file | question it answers |
//! |---|---|
//! | `fleet` | which hosts are there, and who lives where? |
//! | `keys` | which keys may a fleet file have? |
//! | `certificates` | how do hosts know each other? |
//! | `topics` | what crosses between hosts, under which key? |
//! | `frame` | what is before every sample on the wire? |
//! | `gate` | which frames of another host are taken over? |
//! | `clock` | what time is it on the plant's host? |
//! | `told` | how does what robots tell the supervisor get to the plant's host? |
//! | `process/` | how does a bridge carry all that? |
//! | `wire` | how does a connection begin and end? |
//! | `examples` | what is tested with? |
//! | `ros2/` | how does ROS 2 hear a run? |

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
pub mod told;
pub mod topics;
#[cfg(feature = "zenoh")]
pub mod wire;
