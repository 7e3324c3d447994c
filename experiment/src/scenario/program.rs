//! External programs that replace a part of Phalanx, and their files. The files are in the scenario's folder; a run has
//! copies in its directory.
//!
//! Must not: start one.

#[cfg(unix)]
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Component, Path, PathBuf};

use super::diagnostic::Diagnostic;
use super::fields::{HasGroup, kinds};
use super::file::check_inside_folder;
use super::keys;
use super::table::{TableReader, TypedValue};

/// Folder of the copies in the directory of a run.
pub const PROGRAMS_FOLDER: &str = "programs";

/// External program of a scenario.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExternalProgram {
    /// Program and arguments, as in the scenario.
    pub command_line: Vec<String>,
    /// Files and folders that the program needs in addition to those among `command_line`.
    pub files: Vec<String>,
    /// Memory limit, MB. `None`: unlimited.
    pub memory_max_mb: Option<u64>,
}

impl ExternalProgram {
    /// Parses the keys `program`, `files` and `memory_max_mb` of a table.
    pub(super) fn read<S: HasGroup<keys::Program> + HasGroup<keys::ProgramFiles>>(
        table: &TableReader<'_, S>,
    ) -> Result<ExternalProgram, Diagnostic> {
        ExternalProgram::read_with_program(&table.required_value(keys::Program::program)?, table)
    }

    /// Parses the value of `program`, and the keys `files` and `memory_max_mb` of its table.
    pub(super) fn read_with_program<S: HasGroup<keys::ProgramFiles>>(
        program: &TypedValue<'_, kinds::Texts>,
        table: &TableReader<'_, S>,
    ) -> Result<ExternalProgram, Diagnostic> {
        let command_line = program.texts(PROGRAM_REMEDY)?;
        if command_line.first().is_none_or(|word| word.is_empty()) {
            return Err(program.error_about_key("names no program", PROGRAM_REMEDY));
        }
        let files = table.get(keys::ProgramFiles::files);
        let memory = table.get(keys::ProgramFiles::memory_max_mb).map(|memory| memory.integer());
        Ok(ExternalProgram {
            command_line,
            files: files.map_or(Ok(Vec::new()), |files| files.texts("expected a list of files"))?,
            memory_max_mb: memory.transpose()?,
        })
    }

    /// Checks that the program and all its files exist, relative to the scenario's folder.
    pub(super) fn check_files_exist<S: HasGroup<keys::Program> + HasGroup<keys::ProgramFiles>>(
        table: &TableReader<'_, S>,
        folder: &Path,
    ) -> Result<(), Diagnostic> {
        ExternalProgram::check_files_with_program(
            &table.required_value(keys::Program::program)?,
            table,
            folder,
        )
    }

    /// Checks as [`Program::check_files_exist`], given the value of `program`.
    pub(super) fn check_files_with_program<S: HasGroup<keys::ProgramFiles>>(
        program: &TypedValue<'_, kinds::Texts>,
        table: &TableReader<'_, S>,
        folder: &Path,
    ) -> Result<(), Diagnostic> {
        let arguments = program.elements(PROGRAM_REMEDY)?;
        let mut is_after_option = false;
        for (index, value) in arguments.iter().enumerate() {
            let argument = value.text(PROGRAM_REMEDY)?;
            let by_name = index == 0 && !argument.contains('/');
            if by_name && !is_on_path(argument) {
                let expected =
                    "expected a program in a folder of PATH, or a file as in \"./my_law\"";
                return Err(value.error_about_key(
                    format!("is \"{argument}\", which does not exist"),
                    expected,
                ));
            }
            if !by_name
                && (index == 0
                    || argument.contains('/')
                    || !is_after_option && looks_like_file(argument))
            {
                check_file_exists(value, argument, folder)?;
            }
            is_after_option = argument.starts_with('-');
        }
        let files = table
            .get(keys::ProgramFiles::files)
            .map(|files| files.elements("expected a list of files"));
        for value in files.transpose()?.into_iter().flatten() {
            check_file_exists(&value, value.text("expected a file or a folder")?, folder)?;
        }
        Ok(())
    }

    /// Returns the files of the program: their names in the scenario, and their paths relative to the scenario's
    /// folder. A folder is expanded to all its files.
    pub fn files(&self, folder: &Path) -> Vec<(String, PathBuf)> {
        let mut found: Vec<(String, PathBuf)> = Vec::new();
        for name in self.command_line.iter().chain(&self.files) {
            let is_on_search_path =
                std::ptr::eq(name, &self.command_line[0]) && !name.contains('/');
            let Some(path) = find_file(folder, name).filter(|_| !is_on_search_path) else {
                continue;
            };
            let files = match path.is_dir() {
                true => list_folder_files(folder, name, &path).unwrap_or_default(),
                false => vec![(name.clone(), path)],
            };
            for (name, path) in files {
                if !found.iter().any(|(known, _)| *known == name) {
                    found.push((name, path));
                }
            }
        }
        found
    }

    /// Returns whether `word` names a file or a folder below `folder`.
    pub fn is_program_file(&self, word: &str, folder: &Path) -> bool {
        let is_on_search_path = word == self.command_line[0] && !word.contains('/');
        !is_on_search_path && find_file(folder, word).is_some()
    }
}

const PROGRAM_REMEDY: &str =
    "expected a program and its arguments, as in [\"python3\", \"my_law.py\"]";

/// Maximum number of files in a folder that a program names.
const FOLDER_FILES_MAX: usize = 10_000;

/// Returns all files in the folder `path`, sorted, with the names by which the program refers to them. Python's cache
/// is omitted. Fails for a link out of the scenario's folder or to a folder, for anything that is neither a file nor a
/// folder, and for too many files.
fn list_folder_files(
    scenario: &Path,
    name: &str,
    path: &Path,
) -> Result<Vec<(String, PathBuf)>, String> {
    let mut found = Vec::new();
    let mut folders = vec![(name.trim_end_matches('/').to_owned(), path.to_owned())];
    while let Some((name, path)) = folders.pop() {
        let entries = std::fs::read_dir(&path);
        let entries =
            entries.map_err(|error| format!("has {name}, which cannot be read: {error}"))?;
        for entry in entries.flatten() {
            let Ok(file_name) = entry.file_name().into_string() else {
                return Err(format!("has a name in {name} that is no UTF-8"));
            };
            let (name, path) = (format!("{name}/{file_name}"), entry.path());
            let is_link = path.symlink_metadata().is_ok_and(|found| found.is_symlink());
            match path.metadata() {
                Ok(kind) if kind.is_dir() && !is_link => {
                    if file_name != "__pycache__" {
                        folders.push((name, path));
                    }
                }
                Ok(kind) if kind.is_dir() => return Err(format!("has {name}, a link to a folder")),
                _ if is_link && check_inside_folder(scenario, &path).is_err() => {
                    return Err(format!(
                        "has {name}, a link to a file outside of the scenario's folder"
                    ));
                }
                Ok(kind) if kind.is_file() => found.push((name, path)),
                _ => return Err(format!("has {name}, which is neither a file nor a folder")),
            }
            if found.len() > FOLDER_FILES_MAX {
                return Err(format!("has more than {FOLDER_FILES_MAX} files"));
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Returns the path of the file or folder `name`: in the scenario's folder or, if that is the directory of a run, among
/// the copies.
fn find_file(folder: &Path, name: &str) -> Option<PathBuf> {
    let candidates = [folder.join(name), folder.join(PROGRAMS_FOLDER).join(name)];
    let is_inside = is_path_inside_folder(name);
    let exists = |path: &PathBuf| path.is_file() || path.is_dir();
    candidates
        .into_iter()
        .find(|path| is_inside && exists(path) && check_inside_folder(folder, path).is_ok())
}

/// Returns whether `name` is a path that stays inside the folder.
fn is_path_inside_folder(name: &str) -> bool {
    let parts = Path::new(name).components();
    parts.clone().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
        && parts.clone().next().is_some()
}

/// Returns whether `word` looks like a file name with an extension.
fn looks_like_file(word: &str) -> bool {
    let extension = word.rsplit_once('.').filter(|(stem, _)| !stem.is_empty());
    let is_extension = |extension: &str| {
        (1..=5).contains(&extension.len())
            && extension.starts_with(|c: char| c.is_ascii_alphabetic())
            && extension.chars().all(|c| c.is_ascii_alphanumeric())
    };
    !word.starts_with('-') && extension.is_some_and(|(_, extension)| is_extension(extension))
}

fn check_file_exists<T>(
    value: &TypedValue<'_, T>,
    name: &str,
    folder: &Path,
) -> Result<(), Diagnostic> {
    if Path::new(name).is_absolute() && is_executable(Path::new(name)) {
        return Ok(());
    }
    let is_link_out = || {
        let path = folder.join(name);
        path.exists() && check_inside_folder(folder, &path).is_err()
    };
    if let Some(interpreter) = interpreter_of_environment(&folder.join(name)) {
        return Err(value.error_about_key(
            format!("is \"{name}\", the interpreter of a virtual environment, which is not copied into a run's directory"),
            format!(
                "expected its absolute path, \"{}\", or \"python3\" where the environment is activated",
                interpreter.display()
            ),
        ));
    }
    if !is_path_inside_folder(name) || is_link_out() {
        let expected =
            "expected a file in the scenario's folder: it is copied into the run's directory";
        return Err(value.error_about_key(
            format!("is \"{name}\", which is outside of the scenario's folder"),
            expected,
        ));
    }
    match find_file(folder, name) {
        Some(path) if path.is_dir() => match list_folder_files(folder, name, &path) {
            Ok(_) => Ok(()),
            Err(what) => {
                let expected =
                    "expected a folder of files: they are copied into the run's directory";
                Err(value.error_about_key(format!("is \"{name}\", and {what}"), expected))
            }
        },
        Some(_) => Ok(()),
        None => Err(value.error_about_key(
            format!("is \"{name}\", which does not exist"),
            "expected a file in the scenario's folder",
        )),
    }
}

/// Returns the absolute path of a program in the folder `bin` of a Python virtual environment, if `path` is one.
/// Links are not followed: the environment is that of the path.
fn interpreter_of_environment(path: &Path) -> Option<PathBuf> {
    let environment = path.parent()?.parent()?;
    let is_interpreter = environment.join("pyvenv.cfg").is_file() && is_executable(path);
    let absolute = |path: &Path| Some(path.parent()?.canonicalize().ok()?.join(path.file_name()?));
    is_interpreter.then(|| absolute(path)).flatten()
}

/// Returns whether a folder of PATH has an executable `name`.
fn is_on_path(name: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| is_executable(&folder.join(name)))
}

fn is_executable(path: &Path) -> bool {
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
    fn word_looks_like_a_file_if_its_extension_has_letters_only() {
        for (word, is_file) in [
            ("my_law.py", true),
            ("law.onnx", true),
            ("0.5", false),
            ("--rate=0.5s", false),
            ("serve", false),
            (".py", false),
            ("a.b c", false),
            ("the.end of a sentence", false),
        ] {
            assert_eq!(looks_like_file(word), is_file, "{word}");
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
        let command_line =
            ["python3", "law.py", "fast", "kept.py", "../law.py", "law.py", "same.py", "out.py"];
        let command_line = command_line.map(str::to_owned).to_vec();
        let program =
            ExternalProgram { command_line, files: vec!["law.py".into()], memory_max_mb: None };
        let found = program.files(folder.path());
        let names: Vec<&str> = found.iter().map(|(name, _)| &**name).collect();
        assert_eq!(names, ["law.py", "kept.py", "same.py"]);
        assert_eq!(found[1].1, folder.path().join("programs/kept.py"));
    }

    #[test]
    fn folder_includes_all_files_and_rejects_links_out() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["mylaws/gains.py", "mylaws/deep/more.py", "mylaws/__pycache__/gains.pyc"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let command_line = vec!["python3".to_owned(), "law.py".to_owned()];
        let program =
            ExternalProgram { command_line, files: vec!["mylaws/".into()], memory_max_mb: None };
        let files = program.files(folder.path());
        let names: Vec<&str> = files.iter().map(|(name, _)| &**name).collect();
        assert_eq!(names, ["mylaws/deep/more.py", "mylaws/gains.py"]);
        let path = folder.path().join("mylaws");
        for (name, target, problem) in [
            ("out.py", "/etc/hostname", "a link to a file outside of the scenario's folder"),
            ("loop", "..", "a link to a folder"),
        ] {
            let link = path.join(name);
            std::os::unix::fs::symlink(target, &link).unwrap();
            let error = list_folder_files(folder.path(), "mylaws", &path).unwrap_err();
            assert_eq!(error, format!("has mylaws/{name}, {problem}"));
            std::fs::remove_file(link).unwrap();
        }
    }

    #[test]
    fn virtual_environment_interpreter_is_found_by_path() {
        let folder = tempfile::tempdir().unwrap();
        let bin = folder.path().join(".venv/bin");
        std::fs::create_dir_all(&bin).unwrap();
        std::os::unix::fs::symlink("/bin/sh", bin.join("python")).unwrap();
        assert_eq!(interpreter_of_environment(&bin.join("python")), None, "no pyvenv.cfg");
        std::fs::write(folder.path().join(".venv/pyvenv.cfg"), "").unwrap();
        let absolute = bin.canonicalize().unwrap().join("python");
        assert_eq!(interpreter_of_environment(&bin.join("python")), Some(absolute));
        assert_eq!(interpreter_of_environment(&bin.join("other")), None);
    }
}
