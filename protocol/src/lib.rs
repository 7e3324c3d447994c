//! What the processes of a run must agree on.
//!
//! | file | question it answers |
//! |---|---|
//! | `message` | what is said, with which layout? |
//! | `service` | under which name, to how many, with which queue? |
//! | `run_root` | where do the shared files of one run live, and who removes them? |
//! | `brief` | what is one process told when it starts? |
//! | `fault` | what breaks in it, and when? |
//! | `law` | how does a control law describe itself to the rest? |
//! | `clock` | what time is it, and when is the next tick? |
//! | `barrier` | in lockstep: whose turn is it? |
//! | `latency` | what is measured of delays, and how does it get to the supervisor? |
//! | `process` | how does a child name itself, log, and stop? |
//!
//! Without the feature `ipc` there are only the words: `message`, `brief`, `fault`, `law`; no
//! iceoryx2, no system calls.

#[cfg(feature = "ipc")]
pub mod barrier;
pub mod brief;
#[cfg(feature = "ipc")]
pub mod clock;
pub mod fault;
#[cfg(feature = "ipc")]
pub mod latency;
pub mod law;
pub mod message;
#[cfg(feature = "ipc")]
pub mod process;
#[cfg(feature = "ipc")]
pub mod run_root;
#[cfg(feature = "ipc")]
pub mod service;
