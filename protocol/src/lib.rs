//! What the processes of a run must agree on.
//!
//! | file | question it answers |
//! |---|---|
//! | `message` | what is said, with which layout? |
//! | `service` | under which name, to how many, with which queue? |
//! | `ipc` | of which parts is its iceoryx2 made? |
//! | `run_root` | where do the shared files of one run live, and who removes them? |
//! | `brief` | what is one process told when it starts? |
//! | `ros2` | what is the process told that shows a run to ROS 2, and how do messages of ROS 2 look? |
//! | `fault` | what breaks in it, and when? |
//! | `goal` | why is a goal from outside refused? |
//! | `dropped` | why does a bridge drop samples? |
//! | `link` | what gets through a failing link, and when? |
//! | `law` `avoidance` | how does a control law, or an avoidance method, describe itself to the rest? |
//! | `catalog` | which laws and methods are there? |
//! | `clock` | what time is it, and when is the next tick? |
//! | `barrier` | in lockstep: whose turn is it? |
//! | `incarnations` | which incarnation of a robot does the plant obey? |
//! | `stage` | what is measured of delays, and why was something late? |
//! | `latency` | how does that get to the supervisor? |
//! | `cgroup` | which limits of processor time hold for this process? |
//! | `lateness` | what does a process read of itself to tell why? |
//! | `age` | how old is what is known over an edge, at every instant? |
//! | `scratch` | which folder outside of a run root goes with it? |
//! | `regular_file` | how is a file read that another program may have put there? |
//! | `number` | how is a number shown to people? |
//! | `numbered` | which value has which number on the wire, and which word in files? |
//! | `watchdog` | is a process that owes an answer hung, or only kept from giving it? |
//! | `planted` | which defect is planted on purpose, to see whether it is found? |
//! | `process` | how does a child name itself, log, and stop? |
//! | `visible` | how is text from anywhere shown on a terminal? |
//! | `wake` | when does a process wake up, and how late was it? |
//!
//! Without the feature `ipc` there are only the words: `message`, `brief`, `ros2`, `goal`, `fault`, `dropped`, `link`,
//! `law`, `avoidance`, `catalog`, `number`, `planted`, `regular_file`, `age`, `latency` but for its port, `process::exit`, `stage`, `visible`, `wake`; no iceoryx2, no system calls.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[macro_use]
mod numbered;

pub mod age;
pub mod avoidance;
#[cfg(feature = "ipc")]
pub mod barrier;
pub mod brief;
pub mod catalog;
#[cfg(feature = "ipc")]
pub mod cgroup;
#[cfg(feature = "ipc")]
pub mod clock;
pub mod dropped;
pub mod fault;
pub mod goal;
#[cfg(feature = "ipc")]
pub mod incarnations;
#[cfg(feature = "ipc")]
mod ipc;
pub mod latency;
#[cfg(feature = "ipc")]
pub mod lateness;
pub mod law;
pub mod link;
#[cfg(all(test, feature = "ipc"))]
mod machine_files;
pub mod message;
pub mod number;
pub mod planted;
#[cfg(feature = "ipc")]
pub mod process;
#[cfg(not(feature = "ipc"))]
pub mod process {
    //! Of processes, what they end with.

    pub mod exit;
}
pub mod regular_file;
#[cfg(feature = "ipc")]
pub mod resources;
pub mod ros2;
#[cfg(feature = "ipc")]
pub mod run_root;
#[cfg(feature = "ipc")]
pub mod scratch;
#[cfg(feature = "ipc")]
pub mod service;
pub mod stage;
pub mod visible;
pub mod wake;
#[cfg(feature = "ipc")]
pub mod watchdog;
