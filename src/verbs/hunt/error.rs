//! Errors of a hunt, and reasons why a run has no result.

use outcome::campaign::folder::{FolderError, LockError};
use outcome::campaign::hunt_journal::JournalError;

/// Error that ends a hunt. Runs already tried stay in the journal.
#[derive(Debug, thiserror::Error)]
pub(super) enum HuntError {
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Locked(#[from] LockError),
    #[error(transparent)]
    Journal(#[from] JournalError),
    #[error("cannot write the journal: {0}")]
    Write(std::io::Error),
    #[error("cannot handle signals: {0}")]
    Signals(std::io::Error),
    #[error("cannot read the executable: {0}")]
    Executable(std::io::Error),
    #[error("none of the first {0} runs is valid: {1}")]
    NoValidRun(usize, String),
    #[error("cannot write the page of what was found: {0}")]
    Page(String),
    #[error("a run panicked: {0}")]
    Panicked(String),
    #[error("{0}")]
    NoMargin(String),
    #[error("a run failed: {0}")]
    Failed(String),
    #[error("{0}")]
    Programs(String),
    #[error("interrupted: run the same command to continue")]
    Interrupted,
}

impl From<RunEvaluationError> for HuntError {
    fn from(error: RunEvaluationError) -> HuntError {
        match error {
            RunEvaluationError::InvalidScenario(error) => HuntError::NoValidRun(1, error),
            RunEvaluationError::Panicked(error) => HuntError::Panicked(error),
            RunEvaluationError::NoMargin(error) => HuntError::NoMargin(error),
            RunEvaluationError::Failed(error) => HuntError::Failed(error),
            RunEvaluationError::Stopped => HuntError::Interrupted,
        }
    }
}

/// Reason why a run has no result.
pub(super) enum RunEvaluationError {
    /// The scenario was rejected.
    InvalidScenario(String),
    Panicked(String),
    /// The calling program gave no margin.
    NoMargin(String),
    /// Infrastructure failure of a run by processes.
    Failed(String),
    /// A signal ended the run.
    Stopped,
}
