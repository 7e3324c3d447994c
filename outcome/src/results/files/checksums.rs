//! Checksums of a run's files in the format of `sha256sum -c`. The list is written last: a run that has it is
//! complete, and a file that does not match was changed later. In a campaign the list also names the run, after
//! which the directory is named.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

use experiment::campaign::cells::sha256;
use experiment::scenario::file::read_inside_folder;
use protocol::regular_file;
use rustix::io::Errno;

use crate::results::files::host_dir::SCENARIO_FILE;
use crate::results::run_dir::{
    EVENTS_FILE, MANIFEST_FILE, MESSAGES_FILE, PAIRS_FILE, RECORDING_FILE, SAMPLES_FILE,
    SIGNALS_FILE, SUMMARY_FILE,
};

/// Name of the list in a run's directory.
pub const CHECKSUMS_FILE: &str = "checksums.sha256";
/// Files in the list, as far as the run has them.
const CHECKED_FILES: [&str; 12] = [
    SCENARIO_FILE,
    MANIFEST_FILE,
    SUMMARY_FILE,
    SAMPLES_FILE,
    PAIRS_FILE,
    EVENTS_FILE,
    SIGNALS_FILE,
    MESSAGES_FILE,
    "latency.csv",
    "latency_over_time.csv",
    "latency.hlog",
    RECORDING_FILE,
];

/// Maximum size of the list, bytes. A larger file counts as changed.
const LIST_BYTES_MAX: u64 = 1 << 20;

/// Difference between a run's directory and what the run wrote.
#[derive(Debug, thiserror::Error)]
pub enum Damage {
    /// The run was not completed, or by a version without checksums.
    #[error("it has no {CHECKSUMS_FILE}, which is written last")]
    NoChecksums,
    /// A file is missing.
    #[error("{0} is missing")]
    MissingFile(String),
    /// A file was changed.
    #[error("{0} is not as the run wrote it")]
    ChangedFile(String),
    /// The directory has the name of another run.
    #[error("it is not the run that its directory is named after, but {0}")]
    OtherRun(String),
    /// A file cannot be read.
    #[error("cannot read {0}: {1}")]
    UnreadableFile(String, io::Error),
}

/// Prefix of the line with the identifier of a campaign's run. `sha256sum -c` ignores it as a comment.
const RUN_ID_PREFIX: &str = "# run ";

/// Returns the run identifier that a directory is named after; `None` if the name is not an identifier.
fn run_id(run_dir: &Path) -> Option<String> {
    let path = std::path::absolute(run_dir).ok()?;
    let name = path.file_name()?.to_str()?;
    (name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit())).then(|| name.to_owned())
}

/// Writes the list for a run whose directory will be `final_dir`. Returns after the list is synced to disk.
pub fn write_checksums(run_dir: &Path, final_dir: &Path) -> io::Result<()> {
    let mut text = run_id(final_dir).map_or(String::new(), |id| format!("{RUN_ID_PREFIX}{id}\n"));
    for name in CHECKED_FILES {
        match File::open(run_dir.join(name)) {
            Ok(file) => text += &format!("{}  {name}\n", sha256(file)?),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    replace_file(&run_dir.join(CHECKSUMS_FILE), text, true)?;
    sync_folder(run_dir)
}

/// Returns the checksum of a file in the list of a run; `None` if it is not listed.
pub(crate) fn read_listed_checksum(run_dir: &Path, name: &str) -> Option<String> {
    let text = read_inside_folder(run_dir, CHECKSUMS_FILE, LIST_BYTES_MAX).ok()?;
    let text = regular_file::decode_utf8(text).ok()?;
    let checksum = |line: &str| Some(line.strip_suffix(name)?.strip_suffix("  ")?.to_owned());
    text.lines().find_map(checksum)
}

/// Returns the checksum of a file in the list next to it. If there is one, the run was completed.
pub(crate) fn read_listed_checksum_next_to(file: &Path) -> Option<String> {
    let name = file.file_name()?.to_str()?;
    // The parent of a path that is only a name is empty.
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    read_listed_checksum(folder.unwrap_or(Path::new(".")), name)
}

/// Compares a run's files with their checksums, except the recording: it is large, no figure uses it, and it has
/// checksums of its own. `phalanx export` compares it, and `phalanx verify` does for a recording of another
/// version.
pub fn check_run_files(run_dir: &Path) -> Result<(), Damage> {
    let changed_file = |name: &str| Damage::ChangedFile(name.to_owned());
    let open = |name: &str| match fs::metadata(run_dir.join(name)) {
        // Opening a pipe may block, and a device may have no end.
        Ok(found) if !found.is_file() => Err(changed_file(name)),
        Ok(_) => File::open(run_dir.join(name))
            .map(Some)
            .map_err(|error| Damage::UnreadableFile(name.to_owned(), error)),
        Err(error) => match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Ok(None),
            _ if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => {
                Err(changed_file(name))
            }
            _ => Err(Damage::UnreadableFile(name.to_owned(), error)),
        },
    };
    let listed = open(CHECKSUMS_FILE)?.ok_or(Damage::NoChecksums)?;
    let listed =
        regular_file::read_rest(&listed, LIST_BYTES_MAX).and_then(regular_file::decode_utf8);
    let listed = listed.map_err(|_| changed_file(CHECKSUMS_FILE))?;
    let (mut lines, dir_id) = (listed.lines().peekable(), run_id(run_dir));
    let listed_id = lines.next_if(|line| line.starts_with(RUN_ID_PREFIX));
    let listed_id = listed_id.map(|line| &line[RUN_ID_PREFIX.len()..]);
    if dir_id.is_some() && dir_id.as_deref() != listed_id {
        return Err(Damage::OtherRun(listed_id.unwrap_or("none of a campaign").to_owned()));
    }
    let line = |line| str::split_once(line, "  ").map(|(expected, name)| (name, expected));
    let listed: Option<BTreeMap<&str, &str>> = lines.map(line).collect();
    let mut listed = listed.ok_or_else(|| changed_file(CHECKSUMS_FILE))?;
    listed.remove(RECORDING_FILE);
    for name in CHECKED_FILES.into_iter().filter(|&name| name != RECORDING_FILE) {
        match (listed.remove(name), open(name)?) {
            (None, None) => {}
            (Some(_), None) => return Err(Damage::MissingFile(name.to_owned())),
            (None, Some(_)) => return Err(changed_file(CHECKSUMS_FILE)),
            (Some(expected), Some(file)) => {
                let found = sha256(file).map_err(|e| Damage::UnreadableFile(name.to_owned(), e))?;
                if found != expected {
                    return Err(changed_file(name));
                }
            }
        }
    }
    if listed.is_empty() { Ok(()) } else { Err(changed_file(CHECKSUMS_FILE)) }
}

/// Replaces a file atomically: readers see the old content or the new content. A symbolic link of this name is
/// replaced, not followed. With `is_synced`, the content is on disk before the file gets its name.
pub(crate) fn replace_file(
    path: &Path,
    content: impl AsRef<[u8]>,
    is_synced: bool,
) -> io::Result<()> {
    let mut temporary_path = path.as_os_str().to_owned();
    temporary_path.push(".new");
    let temporary_path = Path::new(&temporary_path);
    // Left by a killed process, or a link.
    if let Err(error) = fs::remove_file(temporary_path)
        && error.kind() != io::ErrorKind::NotFound
    {
        return Err(error);
    }
    let mut file = File::create_new(temporary_path)?;
    file.write_all(content.as_ref())?;
    if is_synced {
        file.sync_all()?;
    }
    fs::rename(temporary_path, path)
}

/// Syncs the entries of a folder to disk, but not the content of its files.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
