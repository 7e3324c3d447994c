//! The native half of the Python package `phalanx`: the agent of every robot, with a law or a controller in
//! Python, and the plant, with what moves the robots in Python. Never a second agent or plant.
//!
//! | file | question it answers |
//! |---|---|
//! | `situation` | what does a law see? |
//! | `law` | how is it asked, and what if its answer is none? |
//! | `serve` | how does a Python process become a robot? |
//! | `plant` | how does it become what moves the robots? |
//! | `real` | what are its sine and exponential? |
//! | `env` | and how is a scenario stepped from Python, for training? |

// What `pymodule` and `pymethods` write is not ours to document.
#![allow(missing_docs)]

mod env;
mod law;
mod plant;
mod real;
mod serve;
mod situation;

use pyo3::prelude::*;

#[pymodule]
mod _phalanx {
    use super::*;

    #[pymodule_export]
    use super::env::Episode;
    #[pymodule_export]
    use super::plant::serve_plant;
    #[pymodule_export]
    use super::real::real;
    #[pymodule_export]
    use super::serve::serve;
    #[pymodule_export]
    use super::situation::{Neighbor, Odometry, Pose, Situation, Twist};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", protocol::brief::VERSION)
    }
}
