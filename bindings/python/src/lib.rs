//! Native half of the Python package `phalanx`: the built-in agent with a law or controller in Python, and the
//! built-in plant with robot motion in Python. Must not: contain a second agent or plant.
//!
//! | file | content |
//! |---|---|
//! | `situation` | input of a law |
//! | `law` | calls of a law, and checks of its results |
//! | `outbox` | messages that a law sends, and beacons that it withholds |
//! | `own_robot` | what a law knows of its own robot |
//! | `serve` | a Python process as a robot |
//! | `plant` | a Python process as the plant |
//! | `real` | elementary functions of the built-in laws |
//! | `resilient` | the W-MSR filter of the built-in laws |
//! | `env` | stepping of a scenario from Python, for training |

// Macros generate the undocumented items.
#![allow(missing_docs)]

mod env;
mod law;
mod outbox;
mod own_robot;
mod plant;
mod real;
mod resilient;
mod serve;
mod situation;

use pyo3::prelude::*;

#[pymodule]
mod _phalanx {
    use super::*;

    #[pymodule_export]
    use super::env::Episode;
    #[pymodule_export]
    use super::outbox::Outbox;
    #[pymodule_export]
    use super::own_robot::{InNeighbor, OwnRobot};
    #[pymodule_export]
    use super::plant::serve_plant;
    #[pymodule_export]
    use super::real::real;
    #[pymodule_export]
    use super::resilient::resilient_mean;
    #[pymodule_export]
    use super::serve::serve;
    #[pymodule_export]
    use super::situation::{Neighbor, Odometry, Pose, Situation, Twist};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", protocol::brief::VERSION)
    }
}
