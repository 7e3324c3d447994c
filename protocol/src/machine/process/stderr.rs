//! Standard error that never fails the process: a write always succeeds and, in a process that must not wait,
//! never blocks.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Maximum number of bytes queued for a reader. Writes beyond it are dropped and counted.
const WAITING_BYTES_MAX: usize = 256 << 10;
/// Number of bytes written at once: a writable pipe or terminal takes as many without blocking.
const CHUNK_BYTES: usize = 512;

/// Writer to standard error. If its reader is gone or its disk is full, the text is lost without an error.
#[derive(Debug, Clone, Copy)]
pub struct Stderr;

/// Whether writes wait in [`WAITING_TEXT`] instead of blocking.
static NEVER_BLOCKS: AtomicBool = AtomicBool::new(false);
/// Text that the reader of stderr has not read yet.
static WAITING_TEXT: Mutex<TextQueue> =
    Mutex::new(TextQueue { bytes: VecDeque::new(), dropped_writes: 0 });

/// A bounded queue of text.
#[derive(Debug)]
struct TextQueue {
    bytes: VecDeque<u8>,
    /// Number of writes dropped since the last queued write.
    dropped_writes: u64,
}

impl TextQueue {
    /// Appends a text if there is room, after a line with the number of texts dropped before it.
    fn push(&mut self, text: &[u8]) {
        if self.bytes.len() + text.len() > WAITING_BYTES_MAX {
            self.dropped_writes += 1;
            return;
        }
        if self.dropped_writes > 0 {
            let line =
                format!("({} messages were dropped: stderr was not read)\n", self.dropped_writes);
            self.bytes.extend(line.as_bytes());
            self.dropped_writes = 0;
        }
        self.bytes.extend(text);
    }

    /// Writes the queued text to `to`, and returns once `to` accepts nothing for `timeout`. Drops all text if
    /// writing fails.
    fn drain(&mut self, to: &impl AsFd, timeout: Duration) {
        let mut last_progress = Instant::now();
        while !self.bytes.is_empty() {
            let remaining = timeout.saturating_sub(last_progress.elapsed());
            if !is_writable(to, remaining) {
                return;
            }
            let (first, _) = self.bytes.as_slices();
            match rustix::io::write(to.as_fd(), &first[..first.len().min(CHUNK_BYTES)]) {
                Ok(written_count) => drop(self.bytes.drain(..written_count)),
                Err(rustix::io::Errno::INTR | rustix::io::Errno::AGAIN) => {}
                Err(_) => self.bytes.clear(),
            }
            last_progress = Instant::now();
        }
    }
}

/// Returns whether a write to `to` would not block, after waiting at most `timeout`.
fn is_writable(to: &impl AsFd, timeout: Duration) -> bool {
    let time =
        Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: timeout.subsec_nanos().into() };
    // A closed reader makes the descriptor writable too: the write then fails at once.
    poll(&mut [PollFd::new(to, PollFlags::OUT)], Some(&time)).is_ok_and(|ready| ready > 0)
}

fn lock_waiting_text() -> MutexGuard<'static, TextQueue> {
    WAITING_TEXT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes [`Stderr`] never block this process from now on: text that a full pipe or a paused terminal (Ctrl-S)
/// does not accept is queued for [`drain_stderr`].
pub fn never_block_on_stderr() {
    NEVER_BLOCKS.store(true, Ordering::Relaxed);
}

/// Writes the queued text, and returns once the reader has read nothing for `timeout`.
pub fn drain_stderr(timeout: Duration) {
    if NEVER_BLOCKS.load(Ordering::Relaxed) {
        lock_waiting_text().drain(&io::stderr(), timeout);
    }
}

impl Stderr {
    /// Returns whether stderr accepts more text now: no text is queued, and a write does not block. Always `true`
    /// in a process that may block.
    pub fn is_ready(self) -> bool {
        !NEVER_BLOCKS.load(Ordering::Relaxed)
            || lock_waiting_text().bytes.is_empty() && is_writable(&io::stderr(), Duration::ZERO)
    }
}

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if NEVER_BLOCKS.load(Ordering::Relaxed) {
            let mut waiting = lock_waiting_text();
            waiting.push(bytes);
            waiting.drain(&io::stderr(), Duration::ZERO);
        } else {
            let _ = io::stderr().write_all(bytes);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;

    #[test]
    fn unread_text_is_queued_and_lost_messages_are_counted() {
        let (mut reader, writer) = io::pipe().unwrap();
        let mut waiting = TextQueue { bytes: VecDeque::new(), dropped_writes: 0 };
        let line = [b"x".repeat(1023), b"\n".to_vec()].concat();
        for _ in 0..400 {
            waiting.push(&line);
            // The pipe holds 64 KiB, and nothing reads it.
            waiting.drain(&writer, Duration::ZERO);
        }
        assert!(waiting.bytes.len() <= WAITING_BYTES_MAX && waiting.dropped_writes > 0);
        let dropped = waiting.dropped_writes;
        let mut read = Vec::new();
        while !waiting.bytes.is_empty() {
            let mut chunk = [0; 4096];
            let read_count = reader.read(&mut chunk).unwrap();
            read.extend(&chunk[..read_count]);
            waiting.drain(&writer, Duration::ZERO);
        }
        waiting.push(b"last\n");
        waiting.drain(&writer, Duration::ZERO);
        drop(writer);
        reader.read_to_end(&mut read).unwrap();
        let text = String::from_utf8(read).unwrap();
        let notice = format!("({dropped} messages were dropped: stderr was not read)\nlast\n");
        assert!(text.ends_with(&notice), "{}", &text[text.len() - 80..]);
        assert_eq!(text.lines().filter(|line| line.starts_with('x')).count() as u64, 400 - dropped);
    }
}
