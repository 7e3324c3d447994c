//! How a Python process becomes a robot: the agent's own loop, with the law as one of its parts.

use std::path::{Path, PathBuf};

use agent::brain::Parts;
use agent::{avoidance, control_loop, roles};
use protocol::brief::{self, AgentBrief, VERSION};
use protocol::process::{self, exit};
use pyo3::prelude::*;

use crate::law::PythonLaw;
use crate::situation::Names;

/// Moves the robot of this brief by the law until told to stop; the exit code.
#[pyfunction]
pub fn serve(
    law: &Bound<'_, PyAny>,
    brief: PathBuf,
    incarnation: u64,
    realtime_priority: bool,
) -> u8 {
    if is_of_another_version(&brief) {
        return exit::INFRASTRUCTURE;
    }
    control_loop::main_with(&brief, incarnation, realtime_priority, |brief| parts(law, brief))
}

/// Whether another version of phalanx wrote the brief, which is told.
pub fn is_of_another_version(brief: &Path) -> bool {
    let Some(writer) = brief::writer(brief).filter(|writer| writer != VERSION) else {
        return false;
    };
    process::log_to_stderr();
    tracing::error!(
        "phalanx {writer} starts this program, and its Python package is phalanx {VERSION}: \
         install both from the same release"
    );
    true
}

fn parts(law: &Bound<'_, PyAny>, brief: &AgentBrief) -> Result<Parts, String> {
    let Some(program) = &brief.program else {
        return Err(format!(
            "the brief of {} names the law {:?}, which is built into phalanx: it is for `phalanx agent`",
            brief.name, brief.law
        ));
    };
    let names = brief.neighbors.iter().map(|neighbor| (neighbor.index, neighbor.name.clone()));
    let role = roles::row(&program.role).and_then(|row| row.make(brief));
    Ok(Parts {
        role: role.map_err(|error| error.to_string())?,
        law: Box::new(PythonLaw::new(law, &brief.gains, Names::new(names))?),
        avoidance: avoidance::build(brief).map_err(|error| error.to_string())?,
    })
}
