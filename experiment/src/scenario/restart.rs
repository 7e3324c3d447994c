//! What follows on a death that nobody planned.

use serde::Deserialize;

/// What happens when a process dies unasked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestartPolicy {
    /// Whether it is started again.
    pub when: RestartWhen,
    /// Wait before the first restart, ns. It doubles from one restart to the next.
    pub delay_ns: u64,
    /// The wait grows no longer than this, ns.
    pub delay_ns_max: u64,
    /// No more than this many restarts within the window.
    pub restarts_max: u32,
    /// The window, ns.
    pub window_ns: u64,
}

/// Which deaths lead to a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RestartWhen {
    /// None.
    Never,
    /// Deaths by a signal or with an exit code other than 0.
    OnFailure,
    /// All.
    Always,
}

impl RestartWhen {
    /// As a scenario has it.
    pub fn word(self) -> &'static str {
        match self {
            RestartWhen::Never => "never",
            RestartWhen::OnFailure => "on-failure",
            RestartWhen::Always => "always",
        }
    }
}

/// What follows on a death that nobody planned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the field is named in the variant's comment")]
pub enum AfterDeath {
    /// A replacement, this long after the death, ns.
    Return { delay_ns: u64 },
    /// No replacement, by policy.
    StayDead,
    /// No replacement: there were too many within the window.
    Ceiling,
}

impl RestartPolicy {
    /// What follows on a death with or without `success`, after `recent` restarts in the window.
    pub fn after_death(&self, success: bool, recent: u32) -> AfterDeath {
        let wanted = match self.when {
            RestartWhen::Never => false,
            RestartWhen::OnFailure => !success,
            RestartWhen::Always => true,
        };
        if !wanted {
            AfterDeath::StayDead
        } else if recent >= self.restarts_max {
            AfterDeath::Ceiling
        } else {
            let grown_ns = self.delay_ns.saturating_mul(1 << recent.min(32));
            AfterDeath::Return { delay_ns: grown_ns.min(self.delay_ns_max) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn policy(when: RestartWhen) -> RestartPolicy {
        RestartPolicy { when, delay_ns: 100, delay_ns_max: 350, restarts_max: 3, window_ns: 1000 }
    }

    #[test]
    fn the_wait_doubles_up_to_its_limit_and_ends_at_the_ceiling() {
        let after = |recent| policy(RestartWhen::OnFailure).after_death(false, recent);
        let waits = [0, 1, 2, 3].map(after);
        let wait = |delay_ns| AfterDeath::Return { delay_ns };
        assert_eq!(waits, [wait(100), wait(200), wait(350), AfterDeath::Ceiling]);
    }

    #[test]
    fn who_ends_well_returns_only_if_it_always_does() {
        for (when, success, returns) in [
            (RestartWhen::Never, false, false),
            (RestartWhen::OnFailure, true, false),
            (RestartWhen::OnFailure, false, true),
            (RestartWhen::Always, true, true),
        ] {
            let found = policy(when).after_death(success, 0);
            assert_eq!(matches!(found, AfterDeath::Return { .. }), returns, "{when:?} {success}");
        }
    }
}
