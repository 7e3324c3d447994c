//! Bounded reads of regular files.
//!
//! A named pipe blocks its reader, a device may have no end, and a symbolic link leads where the author of the
//! folder wants. Paths from outside, and paths in a folder that another program may write to, are therefore read
//! only by these functions.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::Path;

/// Policy for a symbolic link as the last part of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SymlinkPolicy {
    /// The link's target is opened.
    Followed,
    /// A link is an error.
    Refused,
}

/// Opens a regular file for reading.
///
/// # Errors
///
/// The file is missing, is a directory, named pipe, socket or device, or is a symbolic link and these are refused.
pub fn open(path: &Path, links: SymlinkPolicy) -> io::Result<File> {
    let metadata = match links {
        SymlinkPolicy::Followed => fs::metadata(path),
        SymlinkPolicy::Refused => fs::symlink_metadata(path),
    }?;
    check_is_regular(&metadata)?;
    let file = File::open(path)?;
    // The path may refer to another file by now.
    check_is_regular(&file.metadata()?)?;
    Ok(file)
}

/// Checks that a file is a regular one.
///
/// # Errors
///
/// The error says which kind of file it is instead.
pub fn check_is_regular(metadata: &fs::Metadata) -> io::Result<()> {
    match (metadata.is_file(), metadata.is_symlink(), metadata.is_dir()) {
        (true, ..) => Ok(()),
        (_, true, _) => Err(io::Error::other("it is a symbolic link, expected a regular file")),
        (.., true) => Err(io::Error::other("it is no regular file but a directory")),
        _ => Err(io::Error::other("it is no regular file but a pipe, socket or device")),
    }
}

/// Reads a complete regular file.
///
/// # Errors
///
/// Errors of [`open`], and a file of more than `bytes_max` bytes.
pub fn read(path: &Path, links: SymlinkPolicy, bytes_max: u64) -> io::Result<Vec<u8>> {
    read_rest(&open(path, links)?, bytes_max)
}

/// Reads the rest of an open file.
///
/// # Errors
///
/// The rest has more than `bytes_max` bytes, or cannot be read.
pub fn read_rest(file: &File, bytes_max: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // One byte more detects a file that is larger; it may grow while it is read.
    file.take(bytes_max.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > bytes_max {
        let reason = format!("it has more than {bytes_max} bytes, the maximum");
        return Err(io::Error::other(reason));
    }
    Ok(bytes)
}

/// Reads a complete regular file as UTF-8 text.
///
/// # Errors
///
/// Errors of [`read`], and text that is not UTF-8.
pub fn read_to_string(path: &Path, links: SymlinkPolicy, bytes_max: u64) -> io::Result<String> {
    decode_utf8(read(path, links, bytes_max)?)
}

/// Converts bytes to text.
///
/// # Errors
///
/// The bytes are not UTF-8. The error has the offset of the first invalid byte.
pub fn decode_utf8(bytes: Vec<u8>) -> io::Result<String> {
    String::from_utf8(bytes).map_err(|error| {
        let offset = error.utf8_error().valid_up_to();
        io::Error::new(io::ErrorKind::InvalidData, format!("it is not UTF-8 at byte {offset}"))
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;

    use super::*;

    #[test]
    fn only_regular_files_within_the_bound_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "four").unwrap();
        symlink("file", at("link")).unwrap();
        symlink("/dev/zero", at("device")).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        let read = |name: &str, links, bytes_max| {
            let text = read_to_string(&at(name), links, bytes_max);
            text.map_err(|error| error.to_string())
        };
        for links in [SymlinkPolicy::Followed, SymlinkPolicy::Refused] {
            assert_eq!(read("file", links, 4).as_deref(), Ok("four"));
            assert!(read("file", links, 3).unwrap_err().contains("more than 3 bytes"));
            assert!(read("socket", links, 9).unwrap_err().contains("no regular file"));
            assert!(read(".", links, 9).unwrap_err().contains("a directory"));
            assert!(read("none", links, 9).is_err());
        }
        assert_eq!(read("link", SymlinkPolicy::Followed, 4).as_deref(), Ok("four"));
        assert!(read("link", SymlinkPolicy::Refused, 4).unwrap_err().contains("a symbolic link"));
        assert!(
            read("device", SymlinkPolicy::Followed, 9)
                .unwrap_err()
                .contains("a pipe, socket or device")
        );
        assert!(read("device", SymlinkPolicy::Refused, 9).unwrap_err().contains("a symbolic link"));
        fs::write(at("file"), [b'a', 0xff]).unwrap();
        assert!(
            read("file", SymlinkPolicy::Refused, 9).unwrap_err().contains("not UTF-8 at byte 1")
        );
    }
}
