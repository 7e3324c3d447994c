//! A Python process as a robot: the built-in agent, with the user's law.

use std::path::PathBuf;

use agent::program;
use pyo3::prelude::*;

use crate::law::PythonLaw;

/// Component whose version must equal that of the program that starts it, as error messages name it.
pub const PACKAGE: &str = "its Python package";

/// Controls the robot of this brief with the law until it is asked to stop. Returns the exit code.
#[pyfunction]
pub fn serve(
    law: &Bound<'_, PyAny>,
    brief: PathBuf,
    incarnation: u64,
    realtime_priority: bool,
) -> u8 {
    program::main(&brief, incarnation, realtime_priority, PACKAGE, |brief| {
        PythonLaw::new(law, brief, incarnation)
    })
}
