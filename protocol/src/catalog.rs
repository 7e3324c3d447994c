//! Laws and avoidance methods of a build, for crates that may not depend on the crate `agent`.

use crate::avoidance::AvoidanceDescription;
use crate::law::LawDescription;

/// All laws and avoidance methods that a scenario may name.
#[derive(Debug, Clone, PartialEq)]
pub struct Catalog {
    /// Control laws.
    pub laws: Vec<LawDescription>,
    /// Avoidance methods. The first one is the default.
    pub methods: Vec<AvoidanceDescription>,
}
