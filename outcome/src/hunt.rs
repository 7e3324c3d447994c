//! What a hunt has tried, written down as it goes on: whoever was killed goes on from there, and comes to the same.
//!
//! `journal.csv` has a line for each run: who asked for it, the margin of each expectation, and what happened in it, as
//! numbers; none of a run that is not sound.

use std::fs::{self, File};
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::path::Path;

/// The name of the file.
pub const JOURNAL: &str = "journal.csv";

/// What came of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// Of each expectation.
    pub margins: Vec<f64>,
    /// What happened in it, as numbers.
    pub traits: Vec<u16>,
}

/// A journal that is open.
pub struct Journal {
    file: File,
    /// What was tried before, in order.
    pub known: Vec<Option<Tried>>,
}

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// It cannot be read or written.
    #[error("cannot use {0}: {1}")]
    Io(String, io::Error),
    /// It is of another scenario, seed, space, or program.
    #[error(
        "{0} is of another hunt: the scenario, the seed, what varies, what is expected or this program is another one; \
         give --out another directory"
    )]
    Other(String),
}

impl Journal {
    /// Opens that of a folder, or begins it. `identity`: what all runs of it depend on; `expectations`: the names of
    /// those that have a margin in it.
    pub fn open(
        folder: &Path,
        identity: &str,
        expectations: &[String],
    ) -> Result<Journal, JournalError> {
        let path = folder.join(JOURNAL);
        let failed = |error| JournalError::Io(path.display().to_string(), error);
        let head = format!("# {identity}\nby,{},traits\n", expectations.join(","));
        let text = match fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            text => text.map_err(failed)?,
        };
        // A line that a kill cut short was never written; nor was one after it.
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let lines = match whole.strip_prefix(&head) {
            // Killed while the head was written.
            None if !head.starts_with(&text) => {
                return Err(JournalError::Other(path.display().to_string()));
            }
            lines => lines,
        };
        let rows = lines.unwrap_or_default();
        let read: Vec<Option<Tried>> =
            rows.lines().map_while(|line| tried(line, expectations.len())).collect();
        let kept: usize = rows.split_inclusive('\n').take(read.len()).map(str::len).sum();
        let open = File::options().create(true).read(true).write(true).truncate(false).open(&path);
        let mut file = open.map_err(failed)?;
        let cut_and_begin = |file: &mut File| -> io::Result<()> {
            file.set_len(lines.map_or(0, |_| head.len() + kept) as u64)?;
            file.seek(SeekFrom::End(0))?;
            lines.map_or_else(|| file.write_all(head.as_bytes()), |_| Ok(()))
        };
        cut_and_begin(&mut file).map_err(failed)?;
        Ok(Journal { file, known: read })
    }

    /// Writes down what came of the next runs, each with who asked for it.
    pub fn append<'m>(
        &mut self,
        tried: impl Iterator<Item = (&'static str, &'m Option<Tried>)>,
    ) -> io::Result<()> {
        let line = |(by, margins): (&str, &Option<Tried>)| match margins {
            Some(Tried { margins, traits }) => {
                let margins: String = margins.iter().map(|margin| format!(",{margin:?}")).collect();
                let traits: Vec<String> = traits.iter().map(ToString::to_string).collect();
                format!("{by}{margins},{}\n", traits.join(" "))
            }
            None => format!("{by},not sound\n"),
        };
        self.file.write_all(tried.map(line).collect::<String>().as_bytes())
    }
}

/// What a line says; `None` if it is none.
fn tried(line: &str, count: usize) -> Option<Option<Tried>> {
    let (_, rest) = line.split_once(',')?;
    if rest == "not sound" {
        return Some(None);
    }
    let (margins, traits) = rest.rsplit_once(',')?;
    let margins: Vec<f64> =
        margins.split(',').map(|margin| margin.parse().ok()).collect::<Option<_>>()?;
    let traits =
        traits.split_whitespace().map(|number| number.parse().ok()).collect::<Option<_>>()?;
    (margins.len() == count).then_some(Some(Tried { margins, traits }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wherever_a_journal_is_cut_it_goes_on_after_its_last_whole_line() {
        let names = ["a".to_owned(), "b".to_owned()];
        let of = |margins: [f64; 2], traits: &[u16]| {
            Some(Tried { margins: margins.into(), traits: traits.into() })
        };
        let tried = [of([0.1, -2.5e-7], &[3, 40]), None, of([1.0, f64::INFINITY], &[])];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(JOURNAL);
        let mut journal = Journal::open(folder.path(), "id", &names).unwrap();
        journal.append(["x", "y", "z"].into_iter().zip(&tried)).unwrap();
        let whole = fs::read_to_string(&path).unwrap();
        assert_eq!(whole, "# id\nby,a,b,traits\nx,0.1,-2.5e-7,3 40\ny,not sound\nz,1.0,inf,\n");
        for cut in 0..=whole.len() {
            fs::write(&path, &whole[..cut]).unwrap();
            let mut journal = Journal::open(folder.path(), "id", &names).unwrap();
            let known = journal.known.len();
            assert_eq!(journal.known, tried[..known], "cut at {cut}");
            assert_eq!(known, whole[..cut].matches('\n').count().saturating_sub(2));
            journal.append(["x", "y", "z"].into_iter().zip(&tried).skip(known)).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), whole, "cut at {cut}");
        }
        let other = Journal::open(folder.path(), "another", &names).err().unwrap();
        assert!(other.to_string().contains("another hunt"), "{other}");
    }
}
