//! How a control law describes itself to those that may not link it.
//!
//! The laws live in the crate `agent`; the supervisor must name them and their gains in its
//! diagnostics without knowing any of them. The binary hands it this list.

/// A law's name in scenario files and the gains it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LawDescription {
    /// Value of the key `law`.
    pub name: &'static str,
    /// Which of the chapter's equations it is.
    pub source: &'static str,
    /// Keys of its gains, with unit suffixes. All must be given, and positive.
    pub gains: &'static [&'static str],
}
