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
        let (mut lines, mut length_bytes, mut first_damaged_line) = (Vec::new(), 0, None);
        for full_line in text.split_inclusive('\n') {
            let Some(content) = full_line.strip_suffix('\n') else { break };
            let line = content.rsplit_once(',').map(|(line, _)| line);
            let mut next = self.clone();
            match line.filter(|line| next.append_checksum(line) == content) {
                None => {
                    first_damaged_line = Some(lines.len() + 1);
                    break;
                }
                Some(line) => lines.push(line),
            }
            length_bytes += full_line.len();
            self = next;
        }
        VerifiedLines { lines, length_bytes, first_damaged_line, chain: self }
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

    fn append_checksums(lines: &[String]) -> Vec<String> {
        let mut chain = ChecksumChain::new("head");
        lines.iter().map(|line| chain.append_checksum(line) + "\n").collect()
    }

    proptest! {
        #[test]
        fn altered_lines_are_damaged_from_the_alteration_on(
            lines in prop::collection::vec("[a-c,0-9.]{0,8}", 2..9),
            line_index in any::<prop::sample::Index>(),
            byte_index in any::<prop::sample::Index>(),
            digit in "[0-9a-z,]",
        ) {
            let lines_with_checksums = append_checksums(&lines);
            let first_damaged = |text: &[String], expected: usize| {
                let text = text.concat();
                let verified = ChecksumChain::new("head").verify(&text);
                assert_eq!(verified.lines, lines[..expected].iter().collect::<Vec<_>>());
                assert_eq!(verified.length_bytes, lines_with_checksums[..expected].concat().len());
                verified.first_damaged_line
            };
            prop_assert_eq!(first_damaged(&lines_with_checksums, lines.len()), None);
            let line_index = line_index.index(lines.len());
            let mut changed = lines_with_checksums.clone();
            let offset = byte_index.index(changed[line_index].len() - 1);
            changed[line_index].replace_range(offset..offset + 1, &digit);
            if changed != lines_with_checksums {
                prop_assert_eq!(first_damaged(&changed, line_index), Some(line_index + 1));
            }
            let mut duplicated = lines_with_checksums.clone();
            duplicated.insert(line_index, lines_with_checksums[line_index].clone());
            prop_assert_eq!(first_damaged(&duplicated, line_index + 1), Some(line_index + 2));
            let mut deleted = lines_with_checksums.clone();
            deleted.remove(line_index);
            prop_assert_eq!(first_damaged(&deleted, line_index), (line_index + 1 < lines.len()).then_some(line_index + 1));
            let mut truncated = lines_with_checksums.clone();
            truncated.truncate(line_index + 1);
            truncated[line_index].truncate(offset);
            prop_assert_eq!(first_damaged(&truncated, line_index), None);
            if line_index + 1 < lines.len() {
                let mut moved = lines_with_checksums.clone();
                moved.swap(line_index, line_index + 1);
                prop_assert_eq!(first_damaged(&moved, line_index), Some(line_index + 1));
            }
        }
    }

    #[test]
    fn another_head_matches_no_line() {
        let lines = append_checksums(&["a".to_owned()]).concat();
        assert_eq!(ChecksumChain::new("another").verify(&lines).first_damaged_line, Some(1));
    }
}
