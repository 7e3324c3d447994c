//! Damaged recordings: what is lost is said, with exit code 1, and no length in them is trusted.

use std::path::Path;
use std::process::Output;

use crate::harness::{limited, run};

// Kinds of records.
const HEADER: u8 = 0x01;
const CHUNK: u8 = 0x06;
const ATTACHMENT: u8 = 0x09;
const METADATA: u8 = 0x0c;

/// Where the records of a recording begin, with their kinds and lengths.
fn layout(bytes: &[u8]) -> Vec<(u8, usize, usize)> {
    let (mut at, mut found) = (8, Vec::new());
    while at < bytes.len() - 8 {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        found.push((bytes[at], at, length));
        at += 9 + length;
    }
    found
}

/// Changes a recording; `at`, `length`: those of a record.
type Change = fn(bytes: &mut [u8], at: usize, length: usize);

fn put(bytes: &mut [u8], at: usize, number: u64, size: usize) {
    bytes[at..at + size].copy_from_slice(&number.to_le_bytes()[..size]);
}

/// What is changed, and in which record.
const CHANGES: [(&str, u8, Change); 8] = [
    ("a bit of a chunk", CHUNK, |bytes, at, length| bytes[at + length / 2] ^= 1),
    ("the length of a chunk", CHUNK, |bytes, at, _| put(bytes, at + 1, 1 << 40, 8)),
    ("how large a chunk is", CHUNK, |bytes, at, _| put(bytes, at + 25, 1 << 40, 8)),
    ("a chunk up to the end", CHUNK, chunk_to_the_end),
    ("a chunk of 3 GB", CHUNK, |bytes, at, _| put(bytes, at + 1, 3 << 30, 8)),
    ("the length of a name", METADATA, |bytes, at, _| put(bytes, at + 9, 0xffff_fff0, 4)),
    ("the length of a value", ATTACHMENT, |bytes, at, _| put(bytes, at + 25, 0xffff_fff0, 4)),
    ("the length of the profile", HEADER, |bytes, at, _| put(bytes, at + 9, 0xffff_fff0, 4)),
];

/// What follows is all of it, and is said to become 250 times as much.
fn chunk_to_the_end(bytes: &mut [u8], at: usize, _: usize) {
    let rest = (bytes.len() - at - 9) as u64;
    put(bytes, at + 1, rest, 8);
    put(bytes, at + 25, 250 * rest, 8);
}

#[test]
fn no_length_of_a_recording_is_trusted_and_every_loss_is_said() {
    let whole = run("triangle").lockstep().set("duration_s=20").set("expect={}");
    let ended = whole.set("record_hz=200").finish();
    ended.exits_with(0);
    let bytes = std::fs::read(ended.run_dir().join("run.mcap")).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    for (what, kind, change) in CHANGES {
        let records: Vec<_> = layout(&bytes).into_iter().filter(|found| found.0 == kind).collect();
        let (_, place, length) = records[records.len() / 2];
        let mut changed = bytes.clone();
        change(&mut changed, place, length);
        std::fs::write(at("run.mcap"), changed).unwrap();
        if what == "a chunk of 3 GB" {
            let file = std::fs::File::options().write(true).open(at("run.mcap")).unwrap();
            file.set_len(4 << 30).unwrap();
        }
        let verb = |verb: &str, words: &[&Path], code: i32| {
            // Enough for the program, and far less than any of these lengths.
            let mut command = limited("-v 500000");
            command.arg(verb).arg(at("run.mcap")).args(words);
            let Output { status, stdout, stderr } = command.output().unwrap();
            let said = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
            assert_eq!(status.code(), Some(code), "{what}: {verb}: {said}");
            said
        };
        let said = verb("recover", &["--out".as_ref(), &at("out.mcap")], 1);
        // Without its facts nobody knows whose recording it is.
        let is_foreign = kind == METADATA;
        let exported = verb("export", &[], if is_foreign { 2 } else { 1 });
        if kind == CHUNK {
            for said in [&said, &exported] {
                assert!(said.contains("seconds lost: "), "{what}: {said}");
            }
        }
        let _ = std::fs::remove_file(at("out.mcap"));
    }
}
