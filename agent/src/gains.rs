//! Validation of the gains that a brief gives to a control law or an avoidance method.

use std::collections::BTreeMap;

use crate::UnfitBrief;

/// Validated gains by key.
pub struct Gains<'a>(&'a BTreeMap<String, f64>);

impl Gains<'_> {
    /// Checks `gains` against the `keys` of the component named `owner`, each with `true` if it is required.
    /// Returns an error if a required gain is missing, a key is unknown, or a value is not finite and positive.
    pub(crate) fn check<'a>(
        gains: &'a BTreeMap<String, f64>,
        owner: &str,
        keys: impl Iterator<Item = (&'static str, bool)>,
    ) -> Result<Gains<'a>, UnfitBrief> {
        let expected: BTreeMap<&str, bool> = keys.collect();
        let lacks = expected.iter().any(|(&key, &needed)| needed && !gains.contains_key(key));
        if lacks || gains.keys().any(|key| !expected.contains_key(key.as_str())) {
            let found: Vec<&String> = gains.keys().collect();
            let expected: Vec<&str> = expected.into_keys().collect();
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
