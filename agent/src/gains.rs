//! Validation of the gains that a brief gives to a control law or an avoidance method.

use std::collections::{BTreeMap, BTreeSet};

use crate::UnfitBrief;

/// Validated gains by key.
pub struct Gains<'a>(&'a BTreeMap<String, f64>);

impl Gains<'_> {
    /// Checks `gains` against the `keys` of the component named `owner`.
    /// Returns an error if a gain is missing, a key is unknown, or a value is not finite and positive.
    pub(crate) fn check<'a>(
        gains: &'a BTreeMap<String, f64>,
        owner: &str,
        keys: impl Iterator<Item = &'static str>,
    ) -> Result<Gains<'a>, UnfitBrief> {
        let expected: BTreeSet<&str> = keys.collect();
        let found: BTreeSet<&str> = gains.keys().map(String::as_str).collect();
        if found != expected {
            let [expected, found] = [expected, found].map(Vec::from_iter);
            let why = format!("{owner} takes exactly the gains {expected:?}, got {found:?}");
            return Err(UnfitBrief(why));
        }
        if let Some((key, &value)) = gains.iter().find(|(_, v)| !(v.is_finite() && **v > 0.0)) {
            return Err(UnfitBrief(format!("gain {key} = {value} of {owner} must be positive")));
        }
        Ok(Gains(gains))
    }

    /// Returns the gain `key`. Panics if it is missing.
    pub fn get(&self, key: &str) -> f64 {
        self.0[key]
    }
}
