//! Defects planted on purpose, with which `tests/planted/run` tests `phalanx hunt`. Without the feature `planted`
//! there are none, at no cost.

/// Returns whether the environment variable `PHALANX_PLANTED` names this defect.
#[cfg(feature = "planted")]
pub fn is(name: &str) -> bool {
    static PLANTED: std::sync::OnceLock<Option<String>> = std::sync::OnceLock::new();
    PLANTED.get_or_init(|| std::env::var("PHALANX_PLANTED").ok()).as_deref() == Some(name)
}

/// Returns `false`: this build has no planted defects.
#[cfg(not(feature = "planted"))]
#[inline(always)]
pub const fn is(_name: &str) -> bool {
    false
}
