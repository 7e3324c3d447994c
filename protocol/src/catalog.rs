//! What the agents of a build can do, for those that may not link them.

use crate::avoidance::AvoidanceDescription;
use crate::law::LawDescription;

/// Every law and every avoidance method that a scenario may name.
#[derive(Debug, Clone, PartialEq)]
pub struct Catalog {
    /// The laws.
    pub laws: Vec<LawDescription>,
    /// The methods; the first one is the default.
    pub methods: Vec<AvoidanceDescription>,
}
