//! Checksums of a run's files, as `sha256sum -c` takes them: the last thing that is written of a run. A run that has
//! them was written to its end; what does not fit them was changed or damaged since. A run of a campaign says there, too,
//! which run it is: its directory is called so, and counts as that run.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

use experiment::campaign::cells::sha256;
use experiment::scenario::file::read_in;
use protocol::regular_file;
use rustix::io::Errno;

use crate::results::host_dir::SCENARIO;
use crate::results::run_dir::{EVENTS, MANIFEST, PAIRS, RECORDING, SAMPLES, SUMMARY};

/// Where they are, in a run's directory.
pub const CHECKSUMS: &str = "checksums.sha256";
/// What they are of, as far as a run has it.
const FILES: [&str; 10] = [
    SCENARIO,
    MANIFEST,
    SUMMARY,
    SAMPLES,
    PAIRS,
    EVENTS,
    "latency.csv",
    "latency_over_time.csv",
    "latency.hlog",
    RECORDING,
];

/// Maximum size of the list, bytes. A larger file is no list of checksums.
const LIST_BYTES_MAX: u64 = 1 << 20;

/// Why a run's directory is not as the run wrote it.
#[derive(Debug, thiserror::Error)]
pub enum Damage {
    /// Its end was never written, or by a version that knew no checksums.
    #[error("it has no {CHECKSUMS}, which is written last")]
    NoChecksums,
    /// A file is gone.
    #[error("{0} is missing")]
    Missing(String),
    /// A file is another one.
    #[error("{0} is not as the run wrote it")]
    Changed(String),
    /// It is the run of another directory.
    #[error("it is not the run that its directory is called after, but {0}")]
    Another(String),
    /// Nobody knows.
    #[error("cannot read {0}: {1}")]
    Unreadable(String, io::Error),
}

/// In front of the identity of a run of a campaign; to `sha256sum -c` it is a comment.
const IDENTITY: &str = "# run ";

/// The identity that a directory is called after.
fn identity(run_dir: &Path) -> Option<String> {
    let path = std::path::absolute(run_dir).ok()?;
    let name = path.file_name()?.to_str()?;
    (name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit())).then(|| name.to_owned())
}

/// Writes them for a run whose directory is called `named` in the end, and returns once they are on the disk.
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

/// The checksum of a file, as it is listed.
pub(crate) fn listed(run_dir: &Path, name: &str) -> Option<String> {
    let text = read_in(run_dir, CHECKSUMS, LIST_BYTES_MAX).ok()?;
    let text = regular_file::text(text).ok()?;
    let sum = |line: &str| Some(line.strip_suffix(name)?.strip_suffix("  ")?.to_owned());
    text.lines().find_map(sum)
}

/// Returns the checksum that the list in a file's folder has for it: the run of that folder was written to its end.
pub(crate) fn listed_beside(file: &Path) -> Option<String> {
    let name = file.file_name()?.to_str()?;
    // Of a path that is a name alone it is empty.
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    listed(folder.unwrap_or(Path::new(".")), name)
}

/// Holds a run's files against them, but for the recording: no figure is made of it, it is large, and it has checksums of
/// its own. `phalanx export` holds it against them, and `phalanx verify` that of another version.
pub fn check(run_dir: &Path) -> Result<(), Damage> {
    let changed = |name: &str| Damage::Changed(name.to_owned());
    let open = |name: &str| match fs::metadata(run_dir.join(name)) {
        // Whoever opens a pipe may wait for ever, and a device may have no end.
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

/// Writes a file at once: whoever reads it sees the old one or the new one. A link of that name is replaced, not
/// followed. `synced`: the content is on the disk before the file has its name.
pub(crate) fn replace(path: &Path, content: impl AsRef<[u8]>, synced: bool) -> io::Result<()> {
    let mut new = path.as_os_str().to_owned();
    new.push(".new");
    let new = Path::new(&new);
    // What was left when somebody was killed, or a link.
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

/// Returns once what a folder has is on the disk: the names, not what is in the files.
pub(crate) fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
