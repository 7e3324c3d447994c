//! Chain of checksums over the lines of a file: a line that was changed, deleted, duplicated or moved does not match.
//!
//! The checksum is the last field of a line: the first 16 hexadecimal digits of the SHA-256 of the previous
//! checksum and the line. Only missing lines at the end are not detected: a truncated file equals one that was
//! written less far.

use experiment::campaign::cells::sha256;

/// Number of hexadecimal digits of a checksum.
const CHECKSUM_DIGITS: usize = 16;

/// Checksum of the last line up to now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChecksumChain(String);

/// Lines that match their checksums.
#[derive(Debug)]
pub struct VerifiedLines<'t> {
    /// Lines without checksum and line end.
    pub lines: Vec<&'t str>,
    /// Length of these lines in the text, bytes.
    pub length_bytes: usize,
    /// Number of the first line that does not match, counted from 1; `None` if all match. A last line without line
    /// end is ignored, because its writer was killed.
    pub first_damaged_line: Option<usize>,
    /// Checksum of the last line that matches.
    pub chain: ChecksumChain,
}

impl ChecksumChain {
    /// Returns the chain of a file that begins with `head`.
    pub fn new(head: &str) -> ChecksumChain {
        ChecksumChain(digest(head))
    }

    /// Returns a line with its checksum, without line end, and advances the chain.
    pub fn append_checksum(&mut self, line: &str) -> String {
        self.0 = digest(&format!("{}\n{line}", self.0));
        format!("{line},{}", self.0)
    }

    /// Verifies the lines of a text up to the first that does not match.
    pub fn verify(mut self, text: &str) -> VerifiedLines<'_> {
        let (mut lines, mut bytes, mut damaged) = (Vec::new(), 0, None);
        for sealed in text.split_inclusive('\n') {
            let Some(whole) = sealed.strip_suffix('\n') else { break };
            let line = whole.rsplit_once(',').map(|(line, _)| line);
            let mut next = self.clone();
            match line.filter(|line| next.append_checksum(line) == whole) {
                None => {
                    damaged = Some(lines.len() + 1);
                    break;
                }
                Some(line) => lines.push(line),
            }
            bytes += sealed.len();
            self = next;
        }
        VerifiedLines { lines, length_bytes: bytes, first_damaged_line: damaged, chain: self }
    }
}

fn digest(text: &str) -> String {
    let mut hash = sha256(text.as_bytes()).expect("memory is always read");
    hash.truncate(CHECKSUM_DIGITS);
    hash
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn seal_lines(lines: &[String]) -> Vec<String> {
        let mut chain = ChecksumChain::new("head");
        lines.iter().map(|line| chain.append_checksum(line) + "\n").collect()
    }

    proptest! {
        #[test]
        fn altered_lines_are_damaged_from_the_alteration_on(
            lines in prop::collection::vec("[a-c,0-9.]{0,8}", 2..9),
            at in any::<prop::sample::Index>(),
            other in any::<prop::sample::Index>(),
            digit in "[0-9a-z,]",
        ) {
            let whole = seal_lines(&lines);
            let found = |text: &[String], expected: usize| {
                let text = text.concat();
                let opened = ChecksumChain::new("head").verify(&text);
                assert_eq!(opened.lines, lines[..expected].iter().collect::<Vec<_>>());
                assert_eq!(opened.length_bytes, whole[..expected].concat().len());
                opened.first_damaged_line
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
        let lines = seal_lines(&["a".to_owned()]).concat();
        assert_eq!(ChecksumChain::new("another").verify(&lines).first_damaged_line, Some(1));
    }
}
