//! Damaged recordings: losses are reported with exit code 1, and lengths in records are validated.

use std::path::Path;

use crate::harness::{
    ExitsWith as _, FinishedRun, command_with_ulimit, map_in_parallel, phalanx, run,
};

// Opcodes of records.
const HEADER: u8 = 0x01;
const CHUNK: u8 = 0x06;
const ATTACHMENT: u8 = 0x09;
const METADATA: u8 = 0x0c;

/// Field types of a record with a length prefix: text or list (4 bytes), map of texts (4 bytes), and bytes (8 bytes).
const TEXT_FIELD: usize = 1000;
const TEXT_MAP_FIELD: usize = 1001;
const DATA: usize = 1002;
/// Records with length fields in the MCAP specification: opcode, name and field types.
const RECORDS: [(u8, &str, &[usize]); 11] = [
    (HEADER, "header", &[TEXT_FIELD, TEXT_FIELD]),
    (0x03, "schema", &[2, TEXT_FIELD, TEXT_FIELD, TEXT_FIELD]),
    (0x04, "channel", &[4, TEXT_FIELD, TEXT_FIELD, TEXT_MAP_FIELD]),
    (CHUNK, "chunk", &[28, TEXT_FIELD, DATA]),
    (0x07, "message index", &[2, TEXT_FIELD]),
    (0x08, "chunk index", &[32, TEXT_FIELD, 8, TEXT_FIELD]),
    (ATTACHMENT, "attachment", &[16, TEXT_FIELD, TEXT_FIELD, DATA]),
    (0x0a, "attachment index", &[40, TEXT_FIELD, TEXT_FIELD]),
    (0x0b, "statistics", &[42, TEXT_FIELD]),
    (METADATA, "metadata", &[TEXT_FIELD, TEXT_MAP_FIELD]),
    (0x0d, "metadata index", &[16, TEXT_FIELD]),
];

/// Returns the offsets of the records of a recording, with their opcodes and lengths.
fn layout(bytes: &[u8]) -> Vec<(u8, usize, usize)> {
    let (mut offset, mut found) = (8, Vec::new());
    while offset < bytes.len() - 8 {
        let length = u64::from_le_bytes(bytes[offset + 1..offset + 9].try_into().unwrap()) as usize;
        found.push((bytes[offset], offset, length));
        offset += 9 + length;
    }
    found
}

/// Function that damages a recording. `offset` and `length` are the offset and length of a record.
type Change = fn(bytes: &mut [u8], offset: usize, length: usize);

fn put(bytes: &mut [u8], offset: usize, number: u64, size: usize) {
    bytes[offset..offset + size].copy_from_slice(&number.to_le_bytes()[..size]);
}

/// Kinds of damage, with the opcode of the record that is changed.
const DAMAGE_KINDS: [(&str, u8, Change); 5] = [
    // After a change of one bit, the messages may be equal: compressed data refer to one of several equal sequences.
    ("bytes of a chunk", CHUNK, |bytes, offset, length| {
        bytes[offset + length / 2..][..8].fill(0xa5)
    }),
    ("the length of a chunk", CHUNK, |bytes, offset, _| put(bytes, offset + 1, 1 << 40, 8)),
    ("how large a chunk is", CHUNK, |bytes, offset, _| put(bytes, offset + 25, 1 << 40, 8)),
    ("a chunk up to the end", CHUNK, chunk_to_the_end),
    ("chunks of 3 GB", CHUNK, chunks_of_3_gb),
];

#[test]
fn recording_cut_before_the_first_message_reports_total_loss() {
    let ended = run("triangle").lockstep().set("duration_s=1").set("expect={}").finish();
    ended.exits_with(0);
    let file = ended.run_dir().join("run.mcap");
    let bytes = std::fs::read(&file).unwrap();
    let records = layout(&bytes);
    let first_chunk = records.iter().position(|found| found.0 == CHUNK).unwrap();
    assert!(first_chunk > 2, "a header, facts and the scenario are in front of it");
    for (_, offset, _) in &records[1..=first_chunk] {
        std::fs::write(&file, &bytes[..*offset]).unwrap();
        let out = ended.run_dir().join(format!("{offset}.mcap"));
        let arguments = ["recover".as_ref(), file.as_os_str(), "--out".as_ref(), out.as_ref()];
        let output = phalanx(arguments).exits_with(1).stdout;
        assert!(output.contains("every message: none is valid"), "{offset}: {output}");
        let output = phalanx(["recover".as_ref(), out.as_os_str()]).exits_with(0).stdout;
        assert!(output.contains("is complete"), "{offset}: {output}");
    }
}

#[test]
fn recording_cut_between_chunks_is_a_loss_if_run_wrote_more() {
    let ended = run("triangle").lockstep().set("duration_s=2").set("expect={}").finish();
    ended.exits_with(0);
    let scratch = tempfile::tempdir().unwrap();
    let [file, alone] =
        [ended.run_dir(), scratch.path().to_owned()].map(|folder| folder.join("run.mcap"));
    let bytes = std::fs::read(&file).unwrap();
    let last_chunk = layout(&bytes).into_iter().rfind(|found| found.0 == CHUNK).unwrap().1;
    for (file, code, expected) in [
        (file, 1, "its end is lost: the run had written more"),
        // A supervisor that is killed leaves such a recording.
        (alone, 0, "it has no end; whether the run wrote more is not known"),
    ] {
        std::fs::write(&file, &bytes[..last_chunk]).unwrap();
        let output = phalanx([Path::new("recover"), &file]).exits_with(code).stdout;
        assert!(output.contains(expected), "{output}");
        let output = phalanx([Path::new("export"), &file]).exits_with(1).stderr;
        assert!(output.contains(expected), "{output}");
    }
}

#[test]
fn recording_of_another_run_is_exported_only_if_asked() {
    let run_to =
        |duration: &str| run("triangle").lockstep().set(duration).set("expect={}").finish();
    let (ended, other) = (run_to("duration_s=2"), run_to("duration_s=1"));
    let file = |ended: &FinishedRun| ended.run_dir().join("run.mcap");
    std::fs::copy(file(&other), file(&ended)).unwrap();
    for path in [ended.run_dir(), file(&ended)] {
        let out = ended.run_dir().join("tables");
        let arguments = ["export".as_ref(), path.as_os_str(), "--out".as_ref(), out.as_ref()];
        let output = phalanx(arguments).exits_with(1).stderr;
        assert!(output.contains("run.mcap is not the recording that its run wrote"), "{output}");
        assert!(output.contains("checksums.sha256") && !out.exists(), "{output}");
        phalanx(arguments).arg("--allow-damage").exits_with(0);
        std::fs::remove_dir_all(out).unwrap();
    }
    phalanx([Path::new("export"), &other.run_dir()]).exits_with(0);
}

/// Writes headers of chunks of 3 GB over a record and 100 bytes behind its start.
fn chunks_of_3_gb(bytes: &mut [u8], offset: usize, _: usize) {
    for offset in [offset, offset + 100] {
        bytes[offset] = CHUNK;
        put(bytes, offset + 1, 3 << 30, 8);
    }
}

/// Sets the length of a chunk to the rest of the file, and its uncompressed size to 250 times that.
fn chunk_to_the_end(bytes: &mut [u8], offset: usize, _: usize) {
    let rest = (bytes.len() - offset - 9) as u64;
    put(bytes, offset + 1, rest, 8);
    put(bytes, offset + 25, 250 * rest, 8);
}

/// Returns the offsets of the length fields of a record, with the size of each in bytes.
fn lengths(mut rest: &[u8], fields: &[usize]) -> Vec<(usize, usize)> {
    let total = rest.len();
    let mut found = Vec::new();
    for &field in fields {
        let offset = total - rest.len();
        let size = if field == DATA { 8 } else { 4 };
        let length = match field {
            TEXT_FIELD | TEXT_MAP_FIELD | DATA => {
                found.push((offset, size));
                let number =
                    rest[..size].iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte));
                size + number as usize
            }
            bytes => bytes,
        };
        if field == TEXT_MAP_FIELD && length > 4 {
            // Lengths of the first name and its value.
            let pair = lengths(&rest[4..length], &[TEXT_FIELD, TEXT_FIELD]);
            found
                .extend(pair.iter().map(|(field_offset, size)| (offset + 4 + field_offset, *size)));
        }
        rest = &rest[length..];
    }
    found
}

#[test]
fn record_length_never_causes_an_allocation() {
    let ended = run("triangle").lockstep().set("duration_s=2").set("expect={}").finish();
    ended.exits_with(0);
    let bytes = std::fs::read(ended.run_dir().join("run.mcap")).unwrap();
    let records = layout(&bytes);
    let mut cases = Vec::new();
    for (kind, name, fields) in RECORDS {
        let &(_, offset, length) = records.iter().find(|found| found.0 == kind).expect(name);
        let body = &bytes[offset + 9..][..length];
        let found = lengths(body, fields);
        cases.extend(
            found.into_iter().map(|(field_offset, size)| (name, offset + 9 + field_offset, size)),
        );
    }
    assert!(cases.len() > 20, "{cases:?}");
    map_in_parallel(&cases, |&(name, position, size)| {
        let scratch = tempfile::tempdir().unwrap();
        let [file, out] = ["run.mcap", "out.mcap"].map(|name| scratch.path().join(name));
        let mut changed = bytes.clone();
        put(&mut changed, position, if size == 4 { 0xffff_fff0 } else { 1 << 40 }, size);
        std::fs::write(&file, changed).unwrap();
        for (verb, arguments) in
            [("recover", &["--out".as_ref(), out.as_path()][..]), ("export", &[])]
        {
            // Without its metadata, the run of the recording is unknown.
            let code = if verb == "export" && name == "metadata" { 2 } else { 1 };
            println!("{name} at {position}");
            command_with_ulimit("-v 500000").arg(verb).arg(&file).args(arguments).exits_with(code);
        }
    });
}

#[test]
fn recording_lengths_are_checked_and_every_loss_is_reported() {
    let builder = run("triangle").lockstep().set("duration_s=20").set("expect={}");
    let ended = builder.set("record_hz=200").finish();
    ended.exits_with(0);
    let bytes = std::fs::read(ended.run_dir().join("run.mcap")).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let path_of = |name: &str| scratch.path().join(name);
    for (what, kind, change) in DAMAGE_KINDS {
        let records: Vec<_> = layout(&bytes).into_iter().filter(|found| found.0 == kind).collect();
        let (_, position, length) = records[records.len() / 2];
        let mut changed = bytes.clone();
        change(&mut changed, position, length);
        std::fs::write(path_of("run.mcap"), changed).unwrap();
        if what == "chunks of 3 GB" {
            let file = std::fs::File::options().write(true).open(path_of("run.mcap")).unwrap();
            file.set_len(4 << 30).unwrap();
        }
        let verb = |verb: &str, arguments: &[&Path], code: i32| {
            // Sufficient for the program, and far less than any of these lengths.
            let mut command = command_with_ulimit("-v 500000");
            command
                .arg(verb)
                .arg(path_of("run.mcap"))
                .args(arguments)
                .exits_with(code)
                .stdout_and_stderr()
        };
        let output = verb("recover", &["--out".as_ref(), &path_of("out.mcap")], 1);
        let exported = verb("export", &[], 1);
        for output in [&output, &exported] {
            assert!(output.contains("seconds lost: "), "{what}: {output}");
        }
        let _ = std::fs::remove_file(path_of("out.mcap"));
    }
}
