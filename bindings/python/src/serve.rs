//! How a Python process becomes a robot: the agent's own loop, with the law as one of its parts.

use std::path::PathBuf;

use agent::program;
use pyo3::prelude::*;

use crate::law::PythonLaw;
use crate::situation::Names;

/// What must be of one version with the program that starts it.
pub const PACKAGE: &str = "its Python package";

/// Moves the robot of this brief by the law until told to stop; the exit code.
#[pyfunction]
pub fn serve(
    law: &Bound<'_, PyAny>,
    brief: PathBuf,
    incarnation: u64,
    realtime_priority: bool,
) -> u8 {
    program::main(&brief, incarnation, realtime_priority, PACKAGE, |brief| {
        PythonLaw::new(law, &brief.gains, Names::of_those_heard(brief))
    })
}
