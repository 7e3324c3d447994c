//! Journal of a hunt (search-based testing): one record per evaluated run. An interrupted hunt resumes from the
//! journal and reaches the same result.
//!
//! `journal.csv` has one line per run: the strategy that proposed the run, the margin of each expectation, the
//! events of the run as numbers (or `not sound` for an invalid run), and a checksum over the line and all lines
//! before it. The first line with a wrong checksum and all lines after it are computed again.

use std::fs::File;
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use protocol::regular_file;

use crate::results::files::chained::{ChecksumChain, VerifiedLines};
use crate::results::files::checksums::replace_file;
use crate::results::files::own_file;

/// Name of the journal file.
pub const JOURNAL_FILE: &str = "journal.csv";

/// Number of header lines before the line of the first run.
const HEADER_LINE_COUNT: usize = 2;

/// Result of one evaluated run of a hunt.
#[derive(Debug, Clone, PartialEq)]
pub struct JournalEntry {
    /// Margin of each expectation, below 0 for a miss.
    pub margins: Vec<f64>,
    /// Events that occurred in the run, encoded as numbers.
    pub observed_events: Vec<u16>,
}

/// Maximum size of a journal, bytes: about ten million runs. A larger one is refused.
const JOURNAL_BYTES_MAX: u64 = 1 << 30;

/// An open journal. New lines are appended.
pub struct Journal {
    file: File,
    chain: ChecksumChain,
    /// Runs of earlier invocations, in order; `None` for an invalid run.
    pub known_entries: Vec<Option<JournalEntry>>,
    /// Warning about lines that were changed, deleted, duplicated or moved since they were written.
    pub damage: Option<String>,
}

/// Reason why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The journal cannot be read or written.
    #[error("cannot use {0}: {1}")]
    Io(String, io::Error),
    /// The journal belongs to another scenario, seed, search space or program.
    #[error(
        "{0} belongs to another hunt: the scenario, the seed, the search space, the expectations or this program differ; \
         choose another directory with --out"
    )]
    OtherHunt(String),
}

impl Journal {
    /// Opens the journal of a folder, or creates it. `identity` is a hash of all that its runs depend on;
    /// `expectations` are the names of the margin columns.
    ///
    /// # Errors
    ///
    /// The file cannot be used, or it belongs to another hunt. Lines behind a wrong checksum are no error: they are
    /// dropped and reported in `damage`.
    pub fn open(
        folder: &Path,
        identity: &str,
        expectations: &[String],
    ) -> Result<Journal, JournalError> {
        let path = folder.join(JOURNAL_FILE);
        let failed = |error| JournalError::Io(path.display().to_string(), error);
        let head = format!("# {identity}\nby,{},traits,checksum\n", expectations.join(","));
        let mut file = own_file::open_regular_file(&path).map_err(failed)?;
        let bytes = regular_file::read_rest(&file, JOURNAL_BYTES_MAX).map_err(failed)?;
        // A damaged journal may hold any bytes; text that is not UTF-8 matches no checksum.
        let text = String::from_utf8_lossy(&bytes);
        let lines = match text.strip_prefix(&head) {
            Some(lines) => lines,
            // The process was killed while it wrote the header.
            None if head.starts_with(&*text) => "",
            None => return Err(JournalError::OtherHunt(path.display().to_string())),
        };
        let VerifiedLines { lines, length_bytes, first_damaged_line, chain } =
            ChecksumChain::new(&head).verify(lines);
        let known: Option<Vec<Option<JournalEntry>>> =
            lines.iter().map(|line| parse_line(line, expectations.len())).collect();
        let known =
            known.ok_or_else(|| failed(io::Error::other("its lines have another format")))?;
        let damage = first_damaged_line.map(|line| -> io::Result<String> {
            let mut damaged_path = path.clone().into_os_string();
            damaged_path.push(".damaged");
            replace_file(Path::new(&damaged_path), &bytes, true)?;
            let (path, damaged_path, line) = (path.display(), damaged_path.display(), HEADER_LINE_COUNT + line);
            Ok(format!(
                "{path}: line {line} does not match its checksum: it was changed, or a line before it was deleted, duplicated or \
                 moved; the runs from that line on are computed again, and the old journal is kept as {damaged_path}"
            ))
        });
        let damage = damage.transpose().map_err(failed)?;
        let truncate_and_write_header = |file: &mut File| -> io::Result<()> {
            let has_header = text.len() >= head.len();
            file.set_len(if has_header { head.len() + length_bytes } else { 0 } as u64)?;
            file.seek(SeekFrom::End(0))?;
            if has_header { Ok(()) } else { file.write_all(head.as_bytes()) }
        };
        truncate_and_write_header(&mut file).map_err(failed)?;
        Ok(Journal { file, chain, known_entries: known, damage })
    }

    /// Appends one line per run, each with the strategy that proposed the run.
    pub fn append<'m>(
        &mut self,
        entries: impl Iterator<Item = (&'static str, &'m Option<JournalEntry>)>,
    ) -> io::Result<()> {
        let chain = &mut self.chain;
        let line = |(strategy, entry): (&str, &Option<JournalEntry>)| match entry {
            Some(JournalEntry { margins, observed_events }) => {
                let margins: String = margins.iter().map(|margin| format!(",{margin:?}")).collect();
                let events: Vec<String> = observed_events.iter().map(ToString::to_string).collect();
                chain.append_checksum(&format!("{strategy}{margins},{}", events.join(" "))) + "\n"
            }
            None => chain.append_checksum(&format!("{strategy},not sound")) + "\n",
        };
        self.file.write_all(entries.map(line).collect::<String>().as_bytes())
    }
}

/// Parses one journal line without its checksum. Returns `None` if the line is malformed, and `Some(None)` for an
/// invalid run.
fn parse_line(line: &str, count: usize) -> Option<Option<JournalEntry>> {
    let (_, rest) = line.split_once(',')?;
    if rest == "not sound" {
        return Some(None);
    }
    let (margins, events) = rest.rsplit_once(',')?;
    let margins: Vec<f64> =
        margins.split(',').map(|margin| margin.parse().ok()).collect::<Option<_>>()?;
    let observed_events =
        events.split_whitespace().map(|number| number.parse().ok()).collect::<Option<_>>()?;
    (margins.len() == count).then_some(Some(JournalEntry { margins, observed_events }))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    fn names() -> [String; 2] {
        ["a".to_owned(), "b".to_owned()]
    }

    /// Returns three runs, of which the second is invalid.
    fn runs() -> [Option<JournalEntry>; 3] {
        let entry = |margins: [f64; 2], events: &[u16]| {
            Some(JournalEntry { margins: margins.into(), observed_events: events.into() })
        };
        [entry([0.1, -2.5e-7], &[3, 40]), None, entry([1.0, f64::INFINITY], &[])]
    }

    /// Writes a journal of three runs and returns its folder and its text.
    fn write_example_journal() -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path(), "id", &names()).unwrap();
        journal.append(["x", "y", "z"].into_iter().zip(&runs())).unwrap();
        let text = fs::read_to_string(folder.path().join(JOURNAL_FILE)).unwrap();
        (folder, text)
    }

    fn without_checksums(text: &str) -> String {
        let line =
            |line: &str| line.rsplit_once(',').map_or(line, |(line, _)| line).to_owned() + "\n";
        text.lines().map(line).collect()
    }

    #[test]
    fn journal_cut_anywhere_resumes_after_its_last_complete_line() {
        let (folder, text) = write_example_journal();
        let path = folder.path().join(JOURNAL_FILE);
        let expected = "# id\nby,a,b,traits\nx,0.1,-2.5e-7,3 40\ny,not sound\nz,1.0,inf,\n";
        assert_eq!(without_checksums(&text), expected);
        for cut in 0..=text.len() {
            fs::write(&path, &text[..cut]).unwrap();
            let mut journal = Journal::open(folder.path(), "id", &names()).unwrap();
            let known = journal.known_entries.len();
            assert_eq!(journal.known_entries, runs()[..known], "cut at {cut}");
            assert_eq!(journal.damage, None, "cut at {cut}");
            assert_eq!(known, text[..cut].matches('\n').count().saturating_sub(2));
            journal.append(["x", "y", "z"].into_iter().zip(&runs()).skip(known)).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text, "cut at {cut}");
        }
        let other = Journal::open(folder.path(), "another", &names()).err().unwrap();
        assert!(other.to_string().contains("another hunt"), "{other}");
    }

    #[test]
    fn altered_journal_warns_and_keeps_the_lines_before() {
        let (folder, text) = write_example_journal();
        let path = folder.path().join(JOURNAL_FILE);
        let lines: Vec<&str> = text.split_inclusive('\n').collect();
        let [a, b, c, d, e] = lines[..] else { panic!("{text}") };
        let changed = c.replace("0.1", "0.2");
        for (text, line, known) in [
            ([a, b, &changed, d, e].concat(), 3, 0),
            ([a, b, d, e].concat(), 3, 0),
            ([a, b, c, e].concat(), 4, 1),
            ([a, b, c, c, d, e].concat(), 4, 1),
            ([a, b, c, d, d, e].concat(), 5, 2),
            ([a, b, c, e, d].concat(), 4, 1),
        ] {
            fs::write(&path, &text).unwrap();
            let journal = Journal::open(folder.path(), "id", &names()).unwrap();
            assert_eq!(journal.known_entries, runs()[..known], "{text}");
            let damage = journal.damage.unwrap();
            assert!(
                damage.contains(&format!("line {line} does not match its checksum")),
                "{damage}"
            );
            let damaged_path = folder.path().join("journal.csv.damaged");
            assert_eq!(fs::read_to_string(damaged_path).unwrap(), text);
            assert_eq!(fs::read_to_string(&path).unwrap(), lines[..2 + known].concat());
        }
    }

    #[test]
    fn journal_that_is_no_regular_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(JOURNAL_FILE);
        let precious = folder.path().join("precious");
        fs::write(&precious, "precious").unwrap();
        for (target, why) in
            [("/dev/zero", "symbolic link"), ("precious", "symbolic link"), ("", "directory")]
        {
            match target {
                "" => fs::create_dir(&path).unwrap(),
                target => symlink(target, &path).unwrap(),
            }
            let error = Journal::open(folder.path(), "id", &names()).err().unwrap().to_string();
            assert!(error.contains(why), "{error}");
            let _ = fs::remove_file(&path);
        }
        assert_eq!(fs::read_to_string(precious).unwrap(), "precious");
    }
}
