//! Restart policy after an unexpected exit of a process.

use serde::Deserialize;

/// Restart policy of a robot's process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestartPolicy {
    /// Exits that lead to a restart.
    pub condition: RestartCondition,
    /// Backoff: delay before the first restart, ns. It doubles after each restart.
    pub delay_ns: u64,
    /// Maximum delay before a restart, ns.
    pub delay_ns_max: u64,
    /// Maximum number of restarts within the window.
    pub restarts_max: u32,
    /// Time window over which restarts are counted, ns.
    pub window_ns: u64,
}

/// Exits that lead to a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RestartCondition {
    /// No exit leads to a restart.
    Never,
    /// Exits by a signal or with an exit code other than 0.
    OnFailure,
    /// All exits lead to a restart.
    Always,
}

impl RestartCondition {
    /// Returns the value of `restart_policy` in scenarios.
    pub fn keyword(self) -> &'static str {
        match self {
            RestartCondition::Never => "never",
            RestartCondition::OnFailure => "on-failure",
            RestartCondition::Always => "always",
        }
    }
}

/// Reaction to an unexpected exit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the field is named in the variant's comment")]
pub enum DeathReaction {
    /// A replacement process starts `delay_ns` after the exit.
    Restart { delay_ns: u64 },
    /// No replacement, because the policy does not provide for one.
    StayDead,
    /// No replacement, because `restarts_max` is reached within the window.
    RestartLimitReached,
}

impl RestartPolicy {
    /// Returns the reaction to an exit. `success`: exit code 0. `recent`: number of restarts within the window.
    pub fn action_after_death(&self, success: bool, recent: u32) -> DeathReaction {
        let is_requested = match self.condition {
            RestartCondition::Never => false,
            RestartCondition::OnFailure => !success,
            RestartCondition::Always => true,
        };
        if !is_requested {
            DeathReaction::StayDead
        } else if recent >= self.restarts_max {
            DeathReaction::RestartLimitReached
        } else {
            let backoff_ns = self.delay_ns.saturating_mul(1 << recent.min(32));
            DeathReaction::Restart { delay_ns: backoff_ns.min(self.delay_ns_max) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn policy(condition: RestartCondition) -> RestartPolicy {
        RestartPolicy {
            condition,
            delay_ns: 100,
            delay_ns_max: 350,
            restarts_max: 3,
            window_ns: 1000,
        }
    }

    #[test]
    fn restart_delay_doubles_up_to_its_maximum() {
        let after = |recent| policy(RestartCondition::OnFailure).action_after_death(false, recent);
        let waits = [0, 1, 2, 3].map(after);
        let wait = |delay_ns| DeathReaction::Restart { delay_ns };
        assert_eq!(waits, [wait(100), wait(200), wait(350), DeathReaction::RestartLimitReached]);
    }

    #[test]
    fn successful_exit_restarts_only_with_policy_always() {
        for (condition, success, is_restarted) in [
            (RestartCondition::Never, false, false),
            (RestartCondition::OnFailure, true, false),
            (RestartCondition::OnFailure, false, true),
            (RestartCondition::Always, true, true),
        ] {
            let found = policy(condition).action_after_death(success, 0);
            assert_eq!(
                matches!(found, DeathReaction::Restart { .. }),
                is_restarted,
                "{condition:?} {success}"
            );
        }
    }
}
