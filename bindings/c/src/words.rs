//! The command line that a robot's program is started with.

use std::path::PathBuf;

/// What is said to whoever starts a program by hand.
pub const STARTED_BY: &str = "`phalanx run SCENARIO` starts it, where the scenario names it: \
                              [laws.NAME] program = [\"./my_law\"].";

/// What `phalanx run` says to a program.
#[derive(Debug, clap::Parser)]
pub struct Words {
    /// The robot's brief.
    pub brief: PathBuf,
    /// How often this robot's process was started before.
    #[arg(long, default_value_t = 0)]
    pub incarnation: u64,
    /// Run before every ordinary process.
    #[arg(long)]
    pub realtime_priority: bool,
}
