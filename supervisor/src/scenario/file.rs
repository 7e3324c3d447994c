//! A file's text, as far as it can be had: small, regular, UTF-8.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::diagnostic::Diagnostic;

/// Largest scenario file, bytes. 256 robots that all hear each other fit.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// The file's text.
pub(super) fn load(path: &Path) -> Result<String, Diagnostic> {
    let expected = "expected a scenario file, such as scenarios/triangle.toml";
    let cannot = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => about(path, "does not exist", expected),
        std::io::ErrorKind::PermissionDenied => {
            about(path, "may not be read by this user", expected)
        }
        _ => about(path, &format!("cannot be read: {error}"), expected),
    };
    let metadata = std::fs::metadata(path).map_err(cannot)?;
    if metadata.is_dir() {
        return Err(about(path, "is a directory", expected));
    }
    if !metadata.is_file() {
        return Err(about(path, "is not a regular file", expected));
    }
    let too_large = |bytes: u64| {
        about(path, &format!("has {bytes} bytes"), "expected a scenario of at most 1 MiB")
    };
    if metadata.len() > FILE_BYTES_MAX {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    // It may have grown since.
    File::open(path)
        .and_then(|file| file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes))
        .map_err(cannot)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(too_large(bytes.len() as u64));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
        let byte = error.as_bytes()[at];
        about(
            path,
            &format!("is not UTF-8: byte 0x{byte:02x} at offset {at}, on line {line}"),
            "expected a scenario in TOML, which is UTF-8 text",
        )
    })
}

/// A diagnostic about the file as a whole.
pub(super) fn about(path: &Path, message: &str, expected: &str) -> Diagnostic {
    Diagnostic::plain(format!("`{}` {message}", path.display()), expected)
}
