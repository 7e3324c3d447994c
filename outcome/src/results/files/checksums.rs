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

use crate::results::files::host_dir::SCENARIO;
use crate::results::run_dir::{EVENTS, MANIFEST, PAIRS, RECORDING, SAMPLES, SIGNALS, SUMMARY};

/// Name of the list in a run's directory.
pub const CHECKSUMS: &str = "checksums.sha256";
/// Files in the list, as far as the run has them.
const FILES: [&str; 11] = [
    SCENARIO,
    MANIFEST,
    SUMMARY,
    SAMPLES,
    PAIRS,
    EVENTS,
    SIGNALS,
    "latency.csv",
    "latency_over_time.csv",
    "latency.hlog",
    RECORDING,
];

/// Maximum size of the list, bytes. A larger file counts as changed.
const LIST_BYTES_MAX: u64 = 1 << 20;

/// Difference between a run's directory and what the run wrote.
#[derive(Debug, thiserror::Error)]
pub enum Damage {
    /// The run was not completed, or by a version without checksums.
    #[error("it has no {CHECKSUMS}, which is written last")]
    NoChecksums,
    /// A file is missing.
    #[error("{0} is missing")]
    Missing(String),
    /// A file was changed.
    #[error("{0} is not as the run wrote it")]
    Changed(String),
    /// The directory has the name of another run.
    #[error("it is not the run that its directory is named after, but {0}")]
    Another(String),
    /// A file cannot be read.
    #[error("cannot read {0}: {1}")]
    Unreadable(String, io::Error),
}

/// Prefix of the line with the identifier of a campaign's run. `sha256sum -c` ignores it as a comment.
const IDENTITY: &str = "# run ";

/// Returns the run identifier that a directory is named after; `None` if the name is not an identifier.
fn identity(run_dir: &Path) -> Option<String> {
    let path = std::path::absolute(run_dir).ok()?;
    let name = path.file_name()?.to_str()?;
    (name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit())).then(|| name.to_owned())
}

/// Writes the list for a run whose directory will be named `named`. Returns after the list is synced to disk.
pub fn write(run_dir: &Path, named: &Path) -> io::Result<()> {
    let mut text = identity(named).map_or(String::new(), |id| format!("{IDENTITY}{id}\n"));
    for name in FILES {
        match File::open(run_dir.join(name)) {
            Ok(file) => text += &format!("{}  {name}\n", sha256(file)?),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    replace(&run_dir.join(CHECKSUMS), text, true)?;
    sync(run_dir)
}

/// Returns the checksum of a file in the list of a run; `None` if it is not listed.
pub(crate) fn listed_checksum(run_dir: &Path, name: &str) -> Option<String> {
    let text = read_inside_folder(run_dir, CHECKSUMS, LIST_BYTES_MAX).ok()?;
    let text = regular_file::text(text).ok()?;
    let sum = |line: &str| Some(line.strip_suffix(name)?.strip_suffix("  ")?.to_owned());
    text.lines().find_map(sum)
}

/// Returns the checksum of a file in the list next to it. If there is one, the run was completed.
pub(crate) fn listed_checksum_next_to(file: &Path) -> Option<String> {
    let name = file.file_name()?.to_str()?;
    // The parent of a path that is only a name is empty.
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    listed_checksum(folder.unwrap_or(Path::new(".")), name)
}

/// Compares a run's files with their checksums, except the recording: it is large, no figure uses it, and it has
/// checksums of its own. `phalanx export` compares it, and `phalanx verify` does for a recording of another
/// version.
pub fn check(run_dir: &Path) -> Result<(), Damage> {
    let changed = |name: &str| Damage::Changed(name.to_owned());
    let open = |name: &str| match fs::metadata(run_dir.join(name)) {
        // Opening a pipe may block, and a device may have no end.
        Ok(found) if !found.is_file() => Err(changed(name)),
        Ok(_) => File::open(run_dir.join(name))
            .map(Some)
            .map_err(|error| Damage::Unreadable(name.to_owned(), error)),
        Err(error) => match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Ok(None),
            _ if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => Err(changed(name)),
            _ => Err(Damage::Unreadable(name.to_owned(), error)),
        },
    };
    let listed = open(CHECKSUMS)?.ok_or(Damage::NoChecksums)?;
    let listed = regular_file::read_open(&listed, LIST_BYTES_MAX).and_then(regular_file::text);
    let listed = listed.map_err(|_| changed(CHECKSUMS))?;
    let (mut lines, found) = (listed.lines().peekable(), identity(run_dir));
    let said = lines.next_if(|line| line.starts_with(IDENTITY));
    let said = said.map(|line| &line[IDENTITY.len()..]);
    if found.is_some() && found.as_deref() != said {
        return Err(Damage::Another(said.unwrap_or("none of a campaign").to_owned()));
    }
    let line = |line| str::split_once(line, "  ").map(|(sum, name)| (name, sum));
    let listed: Option<BTreeMap<&str, &str>> = lines.map(line).collect();
    let mut listed = listed.ok_or_else(|| changed(CHECKSUMS))?;
    listed.remove(RECORDING);
    for name in FILES.into_iter().filter(|&name| name != RECORDING) {
        match (listed.remove(name), open(name)?) {
            (None, None) => {}
            (Some(_), None) => return Err(Damage::Missing(name.to_owned())),
            (None, Some(_)) => return Err(changed(CHECKSUMS)),
            (Some(sum), Some(file)) => {
                let found = sha256(file).map_err(|e| Damage::Unreadable(name.to_owned(), e))?;
                if found != sum {
                    return Err(changed(name));
                }
            }
        }
    }
    if listed.is_empty() { Ok(()) } else { Err(changed(CHECKSUMS)) }
}

/// Replaces a file atomically: readers see the old content or the new content. A symbolic link of this name is
/// replaced, not followed. With `synced`, the content is on disk before the file gets its name.
pub(crate) fn replace(path: &Path, content: impl AsRef<[u8]>, synced: bool) -> io::Result<()> {
    let mut new = path.as_os_str().to_owned();
    new.push(".new");
    let new = Path::new(&new);
    // Left by a killed process, or a link.
    if let Err(error) = fs::remove_file(new)
        && error.kind() != io::ErrorKind::NotFound
    {
        return Err(error);
    }
    let mut file = File::create_new(new)?;
    file.write_all(content.as_ref())?;
    if synced {
        file.sync_all()?;
    }
    fs::rename(new, path)
}

/// Syncs the entries of a folder to disk, but not the content of its files.
pub(crate) fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
