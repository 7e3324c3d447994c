//! How a recording lies on disk: what the crate `mcap` is told, and what is made of its errors.
//!
//! A chunk and what leads to its messages go into the file as they are closed, and everything that was written at
//! the latest with [`mcap::Writer::flush`]. Nothing that is in the file is changed later, so that it is whole up to a
//! point at every moment.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use mcap::write::NoSeek;
use mcap::{Compression, McapError, WriteOptions};

/// Writes one recording.
pub(crate) type Writer = mcap::Writer<NoSeek<BufWriter<File>>>;

/// How large a chunk becomes before it is closed, bytes; then it is compressed.
pub(crate) const CHUNK_BYTES: u64 = 256 * 1024;

/// Begins a file, which must not exist. Every byte of it is under a checksum: each chunk, each attachment, all data
/// and the summary.
pub(crate) fn create(path: &Path, profile: &str) -> io::Result<Writer> {
    let options = WriteOptions::new()
        .profile(profile)
        .library(concat!("phalanx ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Lz4))
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true);
    let file = BufWriter::new(File::create_new(path)?);
    options.create(NoSeek::new(file)).map_err(io_error)
}

/// What `mcap` says of a file, as everybody else says it.
pub(crate) fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}
