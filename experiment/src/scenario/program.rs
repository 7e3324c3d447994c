//! Programs of the scenario's own, which take the place of a part of phalanx, and the files that they are
//! made of. All of these lie in the scenario's folder; a run has copies in its directory.
//!
//! Must not: start one.

#[cfg(unix)]
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Component, Path, PathBuf};

use super::diagnostic::Diagnostic;
use super::file::stays_in;
use super::table::{Table, Value};

/// Where a run's directory has its copies.
pub const PROGRAMS: &str = "programs";

/// A program of the scenario's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Program {
    /// Its name and arguments, as the scenario has them.
    pub words: Vec<String>,
    /// Files that it needs beside those among its words.
    pub files: Vec<String>,
    /// It may have no more memory than this, MB.
    pub memory_max_mb: Option<u64>,
}

impl Program {
    /// That of a table with the keys `program`, `files` and `memory_max_mb`.
    pub(super) fn read(table: &Table<'_>) -> Result<Program, Diagnostic> {
        let program = table.need("program")?;
        let words = program.texts(WORDS)?;
        if words.first().is_none_or(|word| word.is_empty()) {
            return Err(program.wrong("names no program", WORDS));
        }
        let files = table.get("files");
        let memory = table.get("memory_max_mb").map(|memory| memory.whole());
        Ok(Program {
            words,
            files: files.map_or(Ok(Vec::new()), |files| files.texts("expected a list of files"))?,
            memory_max_mb: memory.transpose()?,
        })
    }

    /// The same, and it and all its files must be there, seen from the scenario's folder.
    pub(super) fn must_be_there(table: &Table<'_>, folder: &Path) -> Result<(), Diagnostic> {
        let words = table.need("program")?.elements(WORDS)?;
        let mut option = false;
        for (at, value) in words.iter().enumerate() {
            let word = value.text(WORDS)?;
            let by_name = at == 0 && !word.contains('/');
            if by_name && !on_path(word) {
                let expected =
                    "expected a program in a folder of PATH, or a file as in \"./my_law\"";
                return Err(value.wrong(format!("is \"{word}\", which is not there"), expected));
            }
            if !by_name && (at == 0 || word.contains('/') || !option && like_a_file(word)) {
                file_must_be_there(value, word, folder)?;
            }
            option = word.starts_with('-');
        }
        let files = table.get("files").map(|files| files.elements("expected a list of files"));
        for value in files.transpose()?.into_iter().flatten() {
            file_must_be_there(&value, value.text("expected a file")?, folder)?;
        }
        Ok(())
    }

    /// Its files, as the scenario names them, with where they are, seen from the scenario's folder.
    pub fn files(&self, folder: &Path) -> Vec<(&str, PathBuf)> {
        let mut found: Vec<(&str, PathBuf)> = Vec::new();
        for name in self.words.iter().chain(&self.files) {
            let by_name = std::ptr::eq(name, &self.words[0]) && !name.contains('/');
            let is_new = !found.iter().any(|(known, _)| known == name);
            if let Some(path) = find(folder, name).filter(|_| is_new && !by_name) {
                found.push((name, path));
            }
        }
        found
    }
}

const WORDS: &str = "expected a program and its arguments, as in [\"python3\", \"my_law.py\"]";

/// Where the file of that name is: in the scenario's folder or, where that is a run's directory, among
/// the copies.
fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let places = [folder.join(name), folder.join(PROGRAMS).join(name)];
    let inside = stays_inside(name);
    places.into_iter().find(|path| inside && path.is_file() && stays_in(folder, path).is_ok())
}

/// Whether a name leads nowhere but into the folder.
fn stays_inside(name: &str) -> bool {
    let parts = Path::new(name).components();
    parts.clone().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
        && parts.clone().next().is_some()
}

/// `NAME.ENDING`, as people write files.
fn like_a_file(word: &str) -> bool {
    let ending = word.rsplit_once('.').filter(|(stem, _)| !stem.is_empty());
    let letters = |ending: &str| {
        (1..=5).contains(&ending.len())
            && ending.starts_with(|c: char| c.is_ascii_alphabetic())
            && ending.chars().all(|c| c.is_ascii_alphanumeric())
    };
    !word.starts_with('-') && ending.is_some_and(|(_, ending)| letters(ending))
}

fn file_must_be_there(value: &Value<'_>, name: &str, folder: &Path) -> Result<(), Diagnostic> {
    if Path::new(name).is_absolute() && runs(Path::new(name)) {
        return Ok(());
    }
    let is_link_out = || {
        let path = folder.join(name);
        path.is_file() && stays_in(folder, &path).is_err()
    };
    if !stays_inside(name) || is_link_out() {
        let expected =
            "expected a file in the scenario's folder: it is copied into the run's directory";
        return Err(value
            .wrong(format!("is \"{name}\", which leads out of the scenario's folder"), expected));
    }
    match find(folder, name) {
        Some(_) => Ok(()),
        None => Err(value.wrong(
            format!("is \"{name}\", which is not there"),
            "expected a file in the scenario's folder",
        )),
    }
}

/// Whether a folder of PATH has a program of that name.
fn on_path(name: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| runs(&folder.join(name)))
}

fn runs(path: &Path) -> bool {
    #[cfg(unix)]
    let executable = |meta: std::fs::Metadata| meta.permissions().mode() & 0o111 != 0;
    // In a browser there are no files.
    #[cfg(not(unix))]
    let executable = |_| false;
    path.metadata().is_ok_and(|meta| meta.is_file() && executable(meta))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_with_an_ending_of_letters_look_like_files() {
        for (word, does) in [
            ("my_law.py", true),
            ("law.onnx", true),
            ("0.5", false),
            ("--rate=0.5s", false),
            ("serve", false),
            (".py", false),
            ("a.b c", false),
            ("the.end of a sentence", false),
        ] {
            assert_eq!(like_a_file(word), does, "{word}");
        }
    }

    #[test]
    fn files_are_those_of_the_folder_that_are_there_and_each_once() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["law.py", "python3", "programs/kept.py"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        // A link may lead to another file of the folder, and not out of it.
        for (name, target) in [("same.py", "law.py"), ("out.py", "/etc/hostname")] {
            std::os::unix::fs::symlink(target, folder.path().join(name)).unwrap();
        }
        let words =
            ["python3", "law.py", "fast", "kept.py", "../law.py", "law.py", "same.py", "out.py"];
        let words = words.map(str::to_owned).to_vec();
        let program = Program { words, files: vec!["law.py".into()], memory_max_mb: None };
        let found = program.files(folder.path());
        let names: Vec<&str> = found.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["law.py", "kept.py", "same.py"]);
        assert_eq!(found[1].1, folder.path().join("programs/kept.py"));
    }
}
