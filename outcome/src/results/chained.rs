//! Lines of a file that is read again, each with a checksum over itself and all lines before it: a line that was changed, deleted,
//! doubled or moved does not fit.
//!
//! The checksum is the last field of a line: the first 16 hexadecimal digits of SHA-256 over the checksum before and the line. Only
//! lines missing at the end go unnoticed: a file cut there is the same as one that was written less far.

use experiment::campaign::cells::sha256;

/// Digits of a checksum.
const DIGITS: usize = 16;

/// The checksum of the last line so far.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain(String);

/// Lines that fit their checksums.
#[derive(Debug)]
pub struct Opened<'t> {
    /// Each without checksum and line end.
    pub lines: Vec<&'t str>,
    /// Length in the text of these lines, bytes.
    pub bytes: usize,
    /// Number of the first line that does not fit, from 1; `None` if all fit. A last line without its line end is no
    /// line: its writer was killed.
    pub damaged: Option<usize>,
    /// The checksum of the last line that fits.
    pub chain: Chain,
}

impl Chain {
    /// Returns the chain of a file that begins with `head`.
    pub fn new(head: &str) -> Chain {
        Chain(digest(head))
    }

    /// Returns a line with its checksum, without line end, and goes on from it.
    pub fn seal(&mut self, line: &str) -> String {
        self.0 = digest(&format!("{}\n{line}", self.0));
        format!("{line},{}", self.0)
    }

    /// Reads the lines of a text up to the first that does not fit.
    pub fn open(mut self, text: &str) -> Opened<'_> {
        let (mut lines, mut bytes, mut damaged) = (Vec::new(), 0, None);
        for sealed in text.split_inclusive('\n') {
            let Some(whole) = sealed.strip_suffix('\n') else { break };
            let line = whole.rsplit_once(',').map(|(line, _)| line);
            let mut next = self.clone();
            match line.filter(|line| next.seal(line) == whole) {
                None => {
                    damaged = Some(lines.len() + 1);
                    break;
                }
                Some(line) => lines.push(line),
            }
            bytes += sealed.len();
            self = next;
        }
        Opened { lines, bytes, damaged, chain: self }
    }
}

fn digest(text: &str) -> String {
    let mut hash = sha256(text.as_bytes()).expect("memory is always read");
    hash.truncate(DIGITS);
    hash
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sealed(lines: &[String]) -> Vec<String> {
        let mut chain = Chain::new("head");
        lines.iter().map(|line| chain.seal(line) + "\n").collect()
    }

    proptest! {
        #[test]
        fn altered_lines_are_damaged_from_the_alteration_on(
            lines in prop::collection::vec("[a-c,0-9.]{0,8}", 2..9),
            at in any::<prop::sample::Index>(),
            other in any::<prop::sample::Index>(),
            digit in "[0-9a-z,]",
        ) {
            let whole = sealed(&lines);
            let found = |text: &[String], expected: usize| {
                let text = text.concat();
                let opened = Chain::new("head").open(&text);
                assert_eq!(opened.lines, lines[..expected].iter().collect::<Vec<_>>());
                assert_eq!(opened.bytes, whole[..expected].concat().len());
                opened.damaged
            };
            prop_assert_eq!(found(&whole, lines.len()), None);
            let at = at.index(lines.len());
            let mut changed = whole.clone();
            let place = other.index(changed[at].len() - 1);
            changed[at].replace_range(place..place + 1, &digit);
            if changed != whole {
                prop_assert_eq!(found(&changed, at), Some(at + 1));
            }
            let mut doubled = whole.clone();
            doubled.insert(at, whole[at].clone());
            prop_assert_eq!(found(&doubled, at + 1), Some(at + 2));
            let mut deleted = whole.clone();
            deleted.remove(at);
            prop_assert_eq!(found(&deleted, at), (at + 1 < lines.len()).then_some(at + 1));
            let mut torn = whole.clone();
            torn.truncate(at + 1);
            torn[at].truncate(place);
            prop_assert_eq!(found(&torn, at), None);
            if at + 1 < lines.len() {
                let mut moved = whole.clone();
                moved.swap(at, at + 1);
                prop_assert_eq!(found(&moved, at), Some(at + 1));
            }
        }
    }

    #[test]
    fn another_head_fits_no_line() {
        let lines = sealed(&["a".to_owned()]).concat();
        assert_eq!(Chain::new("another").open(&lines).damaged, Some(1));
    }
}
