//! Which stamp of the plant's clock a stamp of the clock here stands for.
//!
//! An agent answers a sample by the stamp under which it was delivered here; what crosses back carries
//! the plant's own stamp, exactly, so that a command's lifetime counts on the plant's clock alone.

use std::collections::BTreeMap;

/// Stamps delivered here, and what they were.
#[derive(Debug, Clone, Default)]
pub struct StampMap {
    /// By stamp here, ns: the plant's own, ns.
    known: BTreeMap<u64, u64>,
}

impl StampMap {
    /// A sample of that stamp was delivered under this one.
    pub fn deliver(&mut self, here_ns: u64, plant_ns: u64) {
        self.known.insert(here_ns, plant_ns);
    }

    /// The plant's own stamp of a sample that was delivered under this one.
    pub fn plant_ns(&self, here_ns: u64) -> Option<u64> {
        self.known.get(&here_ns).copied()
    }

    /// Nobody answers what is older than this any more.
    pub fn forget_before(&mut self, here_ns: u64) {
        while let Some(oldest) = self.known.first_entry().filter(|oldest| *oldest.key() < here_ns) {
            oldest.remove();
        }
    }

    /// How many are known.
    pub fn len(&self) -> usize {
        self.known.len()
    }

    /// Whether none is known.
    pub fn is_empty(&self) -> bool {
        self.known.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_delivered_is_known_until_nobody_answers_it() {
        let mut stamps = StampMap::default();
        (0..10).for_each(|n| stamps.deliver(100 + n, 5_000 + 2 * n));
        assert_eq!((stamps.plant_ns(104), stamps.plant_ns(99)), (Some(5_008), None));
        stamps.forget_before(105);
        assert_eq!((stamps.plant_ns(104), stamps.plant_ns(105)), (None, Some(5_010)));
        assert_eq!((stamps.len(), stamps.is_empty()), (5, false));
    }
}
