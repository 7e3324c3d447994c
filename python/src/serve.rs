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
    if let Some(writer) = other_version(&brief) {
        process::log_to_stderr();
        tracing::error!(
            "phalanx {writer} starts this program, and its Python package is phalanx {VERSION}: \
             install both from the same release"
        );
        return exit::INFRASTRUCTURE;
    }
    control_loop::main_with(&brief, incarnation, realtime_priority, |brief| parts(law, brief))
}

/// The version of whoever wrote the brief, if it is not this one.
fn other_version(brief: &Path) -> Option<String> {
    brief::writer(brief).filter(|writer| writer != VERSION)
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
