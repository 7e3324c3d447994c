//! Defects that are planted on purpose, so that `tests/planted/run` sees whether `phalanx hunt` finds them. Without the
//! feature `planted` there are none, at no cost.

/// Whether the defect of this name is planted: the variable `PHALANX_PLANTED` of the environment names it.
#[cfg(feature = "planted")]
pub fn is(name: &str) -> bool {
    static PLANTED: std::sync::OnceLock<Option<String>> = std::sync::OnceLock::new();
    PLANTED.get_or_init(|| std::env::var("PHALANX_PLANTED").ok()).as_deref() == Some(name)
}

/// Never: built without the feature `planted`.
#[cfg(not(feature = "planted"))]
#[inline(always)]
pub const fn is(_name: &str) -> bool {
    false
}
