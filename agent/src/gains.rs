//! The gains that a brief gives to a law or to an avoidance method: exactly its own, all positive.

use std::collections::BTreeMap;

/// Gains by key, checked.
pub struct Gains<'a>(&'a BTreeMap<String, f64>);

/// Why gains were refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GainsError {
    /// They are not exactly those that are asked for.
    #[error("{of} takes exactly the gains {expected:?}, got {found:?}")]
    Keys {
        /// Whose gains: `law "x"`.
        of: String,
        /// The keys asked for.
        expected: Vec<String>,
        /// The keys given.
        found: Vec<String>,
    },
    /// One is not a positive number.
    #[error("gain {key} = {value} of {of} must be positive")]
    NotPositive {
        /// Whose gain.
        of: String,
        /// Which gain.
        key: String,
        /// Its value.
        value: f64,
    },
}

impl Gains<'_> {
    /// `gains` if they are `of`'s, with exactly these `keys`.
    pub(crate) fn check<'a>(
        gains: &'a BTreeMap<String, f64>,
        of: &str,
        keys: impl Iterator<Item = &'static str>,
    ) -> Result<Gains<'a>, GainsError> {
        let mut expected: Vec<String> = keys.map(str::to_owned).collect();
        expected.sort();
        if !gains.keys().eq(expected.iter()) {
            let found = gains.keys().cloned().collect();
            return Err(GainsError::Keys { of: of.to_owned(), expected, found });
        }
        if let Some((key, &value)) = gains.iter().find(|(_, v)| !(v.is_finite() && **v > 0.0)) {
            return Err(GainsError::NotPositive { of: of.to_owned(), key: key.clone(), value });
        }
        Ok(Gains(gains))
    }

    /// The gain called `key`. Panics if the row does not list it.
    pub fn get(&self, key: &str) -> f64 {
        self.0[key]
    }
}
