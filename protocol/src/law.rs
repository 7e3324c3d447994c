//! How a control law describes itself to those that may not link it.
//!
//! The laws live in the crate `agent`; the supervisor must name them and their gains in its
//! diagnostics without knowing any of them. The binary hands it this list.

/// What a law makes of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Follows the trajectory m(t), which it alone knows, and hears nobody.
    Leader,
    /// Keeps its place in the formation, as seen from those it hears. (13) (24) (45)
    Formation,
    /// Goes to the middle of those it hears, and so into the leaders' hull. (46)
    Contained,
}

/// A law's name in scenario files and the gains it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LawDescription {
    /// Value of the key `law`.
    pub name: &'static str,
    /// What it makes of a robot.
    pub role: Role,
    /// Which of the chapter's equations it is.
    pub source: &'static str,
    /// Keys of its gains, with unit suffixes. All must be given, and positive.
    pub gains: &'static [&'static str],
    /// Whether it uses alpha*', which a robot knows by the published velocities of those it hears.
    pub feed_forward: bool,
    /// Key of the gain, in m/s, that bounds each component of what it adds to alpha*' (or to 0,
    /// without feed-forward): k in Lemma 1, mu in Proposition 2. `None`: no gain bounds it.
    pub correction_max: Option<&'static str>,
}
