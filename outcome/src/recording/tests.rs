//! Tests with synthetic recordings: cut at any byte, damaged, recovered, exported.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mcap::records::{MessageHeader, Record, op};
use proptest::prelude::*;
use tempfile::TempDir;

use formation::pose::{Pose, Twist};
use protocol::law_message::{MessageArray, MessageFormat};

use crate::recording::chunk::CHUNK_BYTES_MAX;
use crate::recording::export::{ExportError, ExportResult, export};
use crate::recording::record_reader::RecordReader;
use crate::recording::recorder::{FLUSH_INTERVAL, LawTopic, Recorder, RunDescription};
use crate::recording::recover::{RecoverError, RecoverOutcome, RecoverySummary, recover};
use crate::results::tables::{EventLine, MessageLine, RecordedMessage, SampleLine, SignalLine};

const STARTED_UNIX_NS: u64 = 1_795_233_599_000_000_000;
const STEP_NS: u64 = 10_000_000;
const COMPLETE_OUTCOME: RecoverOutcome = RecoverOutcome::Complete { is_checked: true };
const SCENARIO: &str = "name = \"made up\"\n";

fn begin_recording(path: &Path, is_reproducible: bool) -> Recorder {
    let run = RunDescription {
        started_unix_ns: STARTED_UNIX_NS,
        is_reproducible,
        robots: &["r-1".to_owned(), "r2".to_owned()],
        law_topics: LawTopic::ALL.map(|topic| (topic, vec![false; 2])),
        walls: &[],
        metadata: BTreeMap::from([("scenario".to_owned(), "made up".to_owned())]),
        attachments: &[("scenario.toml", "application/toml", SCENARIO)],
    };
    Recorder::create(path, &run).unwrap()
}

/// Returns numbers that do not compress.
fn incompressible_state(k: u64, robot: u64) -> (Pose, Twist) {
    let phase = (k * 7 + robot) as f64;
    let pose = Pose { x_m: phase.sin(), y_m: phase.cos(), heading_rad: (phase * 1.3).sin() };
    let twist = Twist {
        v_m_s: (phase * 1.7).sin(),
        side_m_s: (phase * 2.1).sin(),
        w_rad_s: (phase * 1.9).sin(),
    };
    (pose, twist)
}

fn record_instants(recorder: &mut Recorder, instants: std::ops::Range<u64>) {
    for k in instants {
        let line = |robot: u64, name: &str, error_m, ideal_error_m, alive| {
            let (pose, twist) = incompressible_state(k, robot);
            let line = SampleLine {
                robot: name.to_owned(),
                x_m: pose.x_m,
                y_m: pose.y_m,
                heading_rad: pose.heading_rad,
                v_m_s: twist.v_m_s,
                side_m_s: twist.side_m_s,
                w_rad_s: twist.w_rad_s,
                ..Default::default()
            };
            SampleLine { error_m, ideal_error_m, alive, ..line }
        };
        let (error_x_m, error_y_m) = (Some(-0.3), Some(0.4));
        let first = line(0, "r-1", None, Some(0.25), true);
        let second = line(1, "r2", Some(0.5), None, k < 3);
        let lines = [first, SampleLine { error_x_m, error_y_m, ..second }];
        let nearest_pair = Some((0.25 + k as f64, [0, 1]));
        recorder.record_sample(k * STEP_NS, &lines, nearest_pair).unwrap();
    }
}

/// Writes a complete recording of `instants` instants and two events.
fn write_recording(instants: u64) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut recorder = begin_recording(&path, false);
    record_instants(&mut recorder, 0..instants);
    for (t_ns, kind, robot, detail) in
        [(STEP_NS, "kill", "r2", "SIGKILL, as planned"), (2 * STEP_NS, "load", "", "2 processes")]
    {
        let [kind, robot, detail] = [kind, robot, detail].map(str::to_owned);
        let event = EventLine { kind, robot, detail, ..EventLine::default() };
        recorder.record_event(t_ns, &event).unwrap();
    }
    recorder.finish().unwrap();
    (folder, path)
}

/// Returns the stamp, channel and bytes of every message.
fn read_messages(path: &Path) -> Vec<(u64, u16, Vec<u8>)> {
    let records = RecordReader::open(path).unwrap().map(Result::unwrap);
    let messages = records.filter_map(|record| match record {
        Record::Message { header, data } => {
            Some((header.log_time, header.channel_id, data.into_owned()))
        }
        _ => None,
    });
    messages.collect()
}

fn recover_file(from: &Path, to: &Path) -> RecoverySummary {
    match recover(from, to).unwrap() {
        RecoverOutcome::Recovered(summary) => summary,
        RecoverOutcome::Complete { .. } => panic!("{} is complete", from.display()),
    }
}

#[test]
fn complete_recording_opens_in_mcap_and_stays_unchanged() {
    let (folder, path) = write_recording(2000);
    let bytes = fs::read(&path).unwrap();
    assert_eq!(recover(&path, &folder.path().join("out.mcap")).unwrap(), COMPLETE_OUTCOME);
    assert_eq!(fs::read(&path).unwrap(), bytes);
    assert!(!folder.path().join("out.mcap").exists());
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a summary");
    let statistics = summary.stats.as_ref().expect("statistics");
    // Two messages per instant and three per robot, and two events.
    assert_eq!(statistics.message_count, 2000 * (2 + 2 * 3) + 2);
    assert_eq!((statistics.channel_count, statistics.schema_count), (3 + 2 * 3, 6));
    assert_eq!((statistics.attachment_count, statistics.metadata_count), (1, 1));
    assert!(summary.chunk_indexes.len() > 4);
    for chunk in &summary.chunk_indexes {
        assert_eq!(chunk.compression, "lz4");
        assert!(chunk.uncompressed_size <= CHUNK_BYTES_MAX as u64, "{}", chunk.uncompressed_size);
    }
    for channel in summary.channels.values() {
        let schema = channel.schema.as_ref().expect("a schema");
        assert_eq!((&*channel.message_encoding, &*schema.encoding), ("cdr", "ros2msg"));
        assert_eq!(channel.metadata["offered_qos_profiles"], "");
    }
    let read: Result<Vec<_>, _> = mcap::MessageStream::new(&bytes).unwrap().collect();
    assert_eq!(read.unwrap().len() as u64, statistics.message_count);
}

#[test]
fn recording_cut_at_any_byte_recovers_every_complete_record() {
    let (folder, path) = write_recording(400);
    let (bytes, all_messages) = (fs::read(&path).unwrap(), read_messages(&path));
    let (truncated_path, recovered_path) =
        (folder.path().join("cut.mcap"), folder.path().join("out.mcap"));
    let mut previous_count = 0;
    // The last length lacks only the last byte of the closing magic.
    for length in (0..bytes.len()).step_by(797).chain([bytes.len() - 1]) {
        fs::write(&truncated_path, &bytes[..length]).unwrap();
        let _ = fs::remove_file(&recovered_path);
        match recover(&truncated_path, &recovered_path) {
            Err(RecoverError::NoValidRecord(_)) => assert_eq!(previous_count, 0),
            Err(error) => panic!("{length}: {error}"),
            Ok(RecoverOutcome::Complete { .. }) => {
                panic!("{length} of {} bytes are not complete", bytes.len())
            }
            Ok(RecoverOutcome::Recovered(found)) => {
                let recovered_messages = read_messages(&recovered_path);
                assert_eq!(recovered_messages.len() as u64, found.message_count);
                assert_eq!(recovered_messages, all_messages[..recovered_messages.len()]);
                assert!(recovered_messages.len() >= previous_count, "more bytes, fewer messages");
                previous_count = recovered_messages.len();
                assert_eq!(found.integrity.damaged_records, 0);
                let extra_record_counts = (found.attachment_count, found.metadata_count);
                assert!(
                    recovered_messages.is_empty() || extra_record_counts == (1, 1),
                    "{extra_record_counts:?}"
                );
                assert!(found.integrity.truncated_bytes > 0);
                assert_eq!(
                    recover(&recovered_path, &folder.path().join("again.mcap")).unwrap(),
                    COMPLETE_OUTCOME
                );
            }
        }
    }
    assert_eq!(previous_count, all_messages.len());
    let recovered_bytes = fs::read(&recovered_path).unwrap();
    let summary = mcap::Summary::read(&recovered_bytes).unwrap().expect("a summary");
    let attachment =
        mcap::read::attachment(&recovered_bytes, &summary.attachment_indexes[0]).unwrap();
    assert_eq!((&*attachment.data, &*attachment.name), (SCENARIO.as_bytes(), "scenario.toml"));
    assert_eq!(summary.metadata_indexes[0].name, "phalanx");
}

/// Returns kind, offset and length of each record of a file.
fn record_layout(bytes: &[u8]) -> Vec<(u8, usize, usize)> {
    let (mut offset, mut layout) = (mcap::MAGIC.len(), Vec::new());
    while offset < bytes.len() - mcap::MAGIC.len() {
        let length = u64::from_le_bytes(bytes[offset + 1..offset + 9].try_into().unwrap()) as usize;
        layout.push((bytes[offset], offset, length));
        offset += 9 + length;
    }
    layout
}

#[test]
fn message_record_outside_of_chunks_is_ignored() {
    let (folder, path) = write_recording(50);
    let (bytes, all_messages) = (fs::read(&path).unwrap(), read_messages(&path));
    let (damaged_path, recovered_path) =
        (folder.path().join("bad.mcap"), folder.path().join("out.mcap"));
    let other_records = record_layout(&bytes).into_iter().filter(|(kind, ..)| *kind != op::CHUNK);
    for (kind, offset, _) in other_records {
        let mut bytes = bytes.clone();
        bytes[offset] = op::MESSAGE;
        fs::write(&damaged_path, &bytes).unwrap();
        let recovered = recover_file(&damaged_path, &recovered_path);
        assert!(recovered.is_damaged(), "{kind}: {recovered:?}");
        assert!(read_messages(&recovered_path) == all_messages, "{kind} at {offset}");
        fs::remove_file(&recovered_path).unwrap();
    }
}

#[test]
fn lost_seconds_are_the_gaps_between_valid_records() {
    let (folder, path) = write_recording(2000);
    let (bytes, all_messages) = (fs::read(&path).unwrap(), read_messages(&path));
    let chunks: Vec<_> =
        record_layout(&bytes).into_iter().filter(|(kind, ..)| *kind == op::CHUNK).collect();
    assert!(chunks.len() > 4);
    let (damaged_path, recovered_path) =
        (folder.path().join("bad.mcap"), folder.path().join("out.mcap"));
    let stamp_ns = |(stamp_ns, ..): &(u64, u16, Vec<u8>)| *stamp_ns;
    for damaged_chunk in [0, 2, chunks.len() - 1] {
        let (_, offset, length) = chunks[damaged_chunk];
        // One byte of the content, and two of the length.
        for byte_offset in [offset + 9 + length / 2, offset + 2, offset + 8] {
            let mut bytes = bytes.clone();
            bytes[byte_offset] ^= 0x55;
            fs::write(&damaged_path, &bytes).unwrap();
            let recovered = recover_file(&damaged_path, &recovered_path);
            let recovered_messages = read_messages(&recovered_path);
            fs::remove_file(&recovered_path).unwrap();
            assert_eq!(recovered.integrity.damaged_records, 1);
            let tables = folder.path().join("tables");
            let error = export(&damaged_path, &tables, false).unwrap_err().to_string();
            assert!(
                damaged_chunk == 0 || error.contains("damaged chunks or other records: 1"),
                "{error}"
            );
            if damaged_chunk > 0 {
                assert!(export(&damaged_path, &tables, true).is_ok());
                fs::remove_dir_all(&tables).unwrap();
            }
            assert!(
                recovered.is_damaged() && recovered.integrity.truncated_bytes == 0,
                "{recovered:?}"
            );
            // The channels are defined in the first chunk.
            if damaged_chunk > 0 {
                // Events are written last, with early stamps.
                let is_lost = |message: &&(u64, u16, Vec<u8>)| {
                    stamp_ns(message) > STARTED_UNIX_NS + 2 * STEP_NS
                        && !recovered_messages.contains(message)
                };
                let lost: Vec<_> = all_messages.iter().filter(is_lost).collect();
                if lost.is_empty() {
                    assert_eq!(
                        (recovered.integrity.lost_time_ns, recovered_messages.len()),
                        (0, all_messages.len())
                    );
                    continue;
                }
                let previous_ns = recovered_messages
                    .iter()
                    .map(stamp_ns)
                    .filter(|&ns| ns < stamp_ns(lost[0]))
                    .max();
                let last_ns = stamp_ns(lost.last().unwrap());
                let next_ns = recovered_messages
                    .iter()
                    .map(stamp_ns)
                    .find(|&ns| ns > last_ns)
                    .unwrap_or(last_ns);
                let gap_ns = next_ns - previous_ns.unwrap();
                let lost_ns = recovered.integrity.lost_time_ns;
                assert!(lost_ns > 0 && lost_ns <= gap_ns, "{damaged_chunk}: {lost_ns} of {gap_ns}");
                assert!(lost_ns + 2 * STEP_NS >= gap_ns, "{damaged_chunk}: {lost_ns} of {gap_ns}");
            }
        }
    }
}

#[test]
fn noise_and_empty_files_are_not_recovered_nor_overwritten() {
    let (folder, path) = write_recording(20);
    let path_of = |name: &str| folder.path().join(name);
    for (name, content) in [("empty", &b""[..]), ("noise", b"noise, and no recording at all")] {
        fs::write(path_of(name), content).unwrap();
        let error = recover(&path_of(name), &path_of("out")).unwrap_err();
        assert!(matches!(error, RecoverError::NoValidRecord(_)), "{name}: {error}");
        assert!(error.to_string().contains(name), "{error}");
    }
    let error = recover(&path_of("missing"), &path_of("out")).unwrap_err().to_string();
    assert!(error.contains("missing") && error.contains("No such file"), "{error}");
    let error = recover(folder.path(), &path_of("out")).unwrap_err().to_string();
    assert!(error.contains("directory"), "{error}");
    fs::write(path_of("cut"), &fs::read(&path).unwrap()[..1000]).unwrap();
    fs::write(path_of("precious"), "data").unwrap();
    let error = recover(&path_of("cut"), &path_of("precious")).unwrap_err();
    assert!(matches!(error, RecoverError::Exists(_)), "{error}");
    assert_eq!(fs::read(path_of("precious")).unwrap(), b"data");
    assert!(!path_of("out").exists());
}

/// Asserts that a recording in progress with newest instant `k` is complete except for the last half second.
fn assert_complete_to_half_a_second(path: &Path, k: u64) {
    let out = path.with_extension("out");
    let last_ns = recover_file(path, &out).stamps_ns.map_or(0, |(_, last_ns)| last_ns);
    fs::remove_file(&out).unwrap();
    let age_ns = (STARTED_UNIX_NS + k * STEP_NS).saturating_sub(last_ns);
    let flush_ns = FLUSH_INTERVAL.as_nanos();
    let is_recent = u128::from(k * STEP_NS) < flush_ns || u128::from(age_ns) <= flush_ns;
    assert!(is_recent, "{age_ns} ns are missing after {k} instants");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    /// Flush requests at any instant and with any clock value.
    #[test]
    fn reproducible_recording_is_equal_and_lags_at_most_500_ms(
        flush_requests in prop::collection::vec((0..200u64, 0..10_000u64), 0..40),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path_of = |name: &str| folder.path().join(name);
        let start = Instant::now();
        let mut recorders = ["undisturbed", "looked at"].map(|name| begin_recording(&path_of(name), true));
        for k in 0..200 {
            for recorder in &mut recorders {
                record_instants(recorder, k..k + 1);
            }
            for (_, ms) in flush_requests.iter().filter(|(instant, _)| *instant == k) {
                recorders[1].flush_if_due(start + Duration::from_millis(*ms)).unwrap();
            }
            if k % 40 == 39 {
                assert_complete_to_half_a_second(&path_of("undisturbed"), k);
            }
        }
        recorders.into_iter().for_each(|recorder| recorder.finish().unwrap());
        prop_assert!(fs::read(path_of("undisturbed")).unwrap() == fs::read(path_of("looked at")).unwrap());
    }
}

#[test]
fn records_older_than_half_a_second_are_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let start = Instant::now();
    let mut recorder = begin_recording(&path, false);
    recorder.flush_if_due(start + FLUSH_INTERVAL).unwrap();
    // One sample each 10 ms, followed by a flush request.
    for k in 0..200 {
        record_instants(&mut recorder, k..k + 1);
        let now = start + FLUSH_INTERVAL + Duration::from_nanos((k + 1) * STEP_NS);
        recorder.flush_if_due(now).unwrap();
        if k % 10 == 9 {
            assert_complete_to_half_a_second(&path, k);
        }
    }
}

/// Returns the rows of an exported table, without its header.
fn read_rows(out: &Path, table: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(out.join(table)).unwrap();
    let rows = text.lines().skip(1);
    rows.map(|row| row.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn export_has_every_value_of_the_run() {
    let (folder, path) = write_recording(5);
    let out = folder.path().join("tables");
    let ExportResult { tables, integrity } = export(&path, &out, false).unwrap();
    assert!(integrity.is_complete() && integrity.has_checksums);
    let counts: Vec<u64> = tables.iter().map(|(_, rows)| *rows).collect();
    assert_eq!(counts, [10, 10, 10, 5, 2]);
    for (i, row) in read_rows(&out, "poses.csv").iter().enumerate() {
        let (k, robot) = (i as u64 / 2, i as u64 % 2);
        let (expected, _) = incompressible_state(k, robot);
        assert_eq!(row[0].parse(), Ok(k as f64 / 100.0));
        assert_eq!(row[1], ["r-1", "r2"][robot as usize]);
        assert_eq!((row[2].parse(), row[3].parse()), (Ok(expected.x_m), Ok(expected.y_m)));
        assert!((row[4].parse::<f64>().unwrap() - expected.heading_rad).abs() < 1e-14);
    }
    let command = &read_rows(&out, "commands.csv")[3];
    let (_, twist) = incompressible_state(1, 1);
    let expected = [twist.v_m_s, twist.w_rad_s, twist.side_m_s];
    assert_eq!([2, 3, 4].map(|column| command[column].parse()), expected.map(Ok));
    assert_eq!(read_rows(&out, "errors.csv")[6], ["0.03", "r-1", "", "1", "0.25", "", ""]);
    assert_eq!(read_rows(&out, "errors.csv")[7], ["0.03", "r2", "0.5", "0", "", "-0.3", "0.4"]);
    assert_eq!(read_rows(&out, "distances.csv")[4], ["0.04", "r-1", "r2", "4.25"]);
    let events = fs::read_to_string(out.join("events.csv")).unwrap();
    assert!(events.contains("0.01,kill,r2,30,\"SIGKILL, as planned\"\n"), "{events}");
    assert!(events.contains("0.02,load,,30,2 processes\n"), "{events}");
}

/// Returns a message of r2 with arrays, and one without a structure.
fn law_messages() -> [RecordedMessage; 2] {
    let array = |name: &'static str, shape: &'static [usize]| MessageArray {
        name: name.into(),
        shape: shape.into(),
    };
    let arrays = MessageFormat::with_arrays(vec![array("bid", &[]), array("plan_m", &[2])]);
    let bytes = arrays.encode(&[("bid", &[0.5]), ("plan_m", &[0.1, -2.5])]).unwrap();
    let message = |t_ns, format: MessageFormat, bytes: &[u8]| RecordedMessage {
        robot: "r2".to_owned(),
        t_ns,
        format: Box::leak(Box::new(format)),
        message: bytes.to_vec(),
    };
    [
        message(12_500_000, arrays, &bytes),
        message(25_000_000, MessageFormat::with_bytes(4), &[0, 255]),
    ]
}

#[test]
fn signals_and_messages_have_topics_and_tables() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let robots = ["r-1".to_owned(), "r2".to_owned()];
    let run = RunDescription {
        started_unix_ns: STARTED_UNIX_NS,
        is_reproducible: true,
        robots: &robots,
        law_topics: LawTopic::ALL.map(|topic| (topic, vec![false, true])),
        walls: &[],
        metadata: BTreeMap::new(),
        attachments: &[],
    };
    let mut recorder = Recorder::create(&path, &run).unwrap();
    record_instants(&mut recorder, 0..1);
    let line = |signal: &str, value| {
        let (t_s, robot, signal) = (0.0125, "r2".to_owned(), signal.to_owned());
        SignalLine { t_s, robot, signal, value }
    };
    recorder.record_signals(STEP_NS, &[line("cost_m2", 0.1), line("gap_m", -2.5)]).unwrap();
    recorder.record_signals(2 * STEP_NS, &[]).unwrap();
    let messages = law_messages();
    recorder.record_law_messages(STEP_NS, &messages).unwrap();
    recorder.finish().unwrap();
    let bytes = fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a summary");
    let topics: Vec<&str> =
        summary.channels.values().map(|channel| channel.topic.as_str()).collect();
    assert!(topics.contains(&"/r2/signals") && !topics.contains(&"/r_1/signals"), "{topics:?}");
    let out = folder.path().join("tables");
    let ExportResult { tables, .. } = export(&path, &out, false).unwrap();
    assert_eq!(tables[tables.len() - 2..], [("signals.csv", 2), ("messages.csv", 4)]);
    let expected = [
        ["0.0125", "r2", "bid", "0", "0.5", ""],
        ["0.0125", "r2", "plan_m", "0", "0.1", ""],
        ["0.0125", "r2", "plan_m", "1", "-2.5", ""],
        ["0.025", "r2", "", "0", "", "00ff"],
    ];
    assert_eq!(read_rows(&out, "messages.csv"), expected);
    let lines: Vec<MessageLine> = messages.iter().flat_map(RecordedMessage::lines).collect();
    assert_eq!(lines.len(), expected.len());
    let expected = [["0.0125", "r2", "cost_m2", "0.1"], ["0.0125", "r2", "gap_m", "-2.5"]];
    assert_eq!(read_rows(&out, "signals.csv"), expected);
}

#[test]
fn export_refuses_existing_output_and_other_files() {
    let (folder, path) = write_recording(5);
    let path_of = |name: &str| folder.path().join(name);
    fs::create_dir(path_of("mine")).unwrap();
    let error = export(&path, &path_of("mine"), false).unwrap_err();
    assert!(matches!(error, ExportError::Exists(_)), "{error}");
    fs::write(path_of("noise"), "noise").unwrap();
    let error = export(&path_of("noise"), &path_of("out"), false).unwrap_err();
    assert!(matches!(error, ExportError::NotARecording(_)), "{error}");
    // A complete recording of a run, except that the message on the event topic is not an event.
    let metadata =
        RecordReader::open(&path).unwrap().map(Result::unwrap).find_map(|record| match record {
            Record::Metadata(metadata) => Some(metadata),
            _ => None,
        });
    let mut writer = mcap::Writer::new(fs::File::create(path_of("odd")).unwrap()).unwrap();
    writer.write_metadata(&metadata.unwrap()).unwrap();
    let channel_id = writer.add_channel(0, "/rosout", "cdr", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, b"?").unwrap();
    writer.finish().unwrap();
    let error = export(&path_of("odd"), &path_of("out"), false).unwrap_err();
    assert!(matches!(error, ExportError::MalformedMessage(..)), "{error}");
    assert!(!path_of("out").exists());
}

/// Flips one bit of every seventh byte: no changed file counts as complete, and no table is exported from it unless
/// damage is allowed.
#[test]
fn single_bit_flip_is_detected_and_not_exported_by_default() {
    let (folder, path) = write_recording(5);
    let bytes = fs::read(&path).unwrap();
    let path_of = |name: &str| folder.path().join(name);
    for byte_offset in (0..bytes.len()).step_by(7) {
        let mut flipped = bytes.clone();
        flipped[byte_offset] ^= 1 << (byte_offset % 8);
        fs::write(path_of("bad.mcap"), &flipped).unwrap();
        match recover(&path_of("bad.mcap"), &path_of("out.mcap")) {
            Err(RecoverError::NoValidRecord(_)) => {}
            Ok(RecoverOutcome::Recovered(found)) => {
                assert!(!found.integrity.is_complete(), "byte {byte_offset}: {found:?}");
                assert_ne!(found.integrity.to_string(), "", "byte {byte_offset}");
                fs::remove_file(path_of("out.mcap")).unwrap();
            }
            other => panic!("byte {byte_offset} of {}: {other:?}", bytes.len()),
        }
        let error = export(&path_of("bad.mcap"), &path_of("tables"), false).unwrap_err();
        let is_refused =
            matches!(error, ExportError::DamagedRecording(..) | ExportError::NotARecording(_));
        assert!(is_refused && !path_of("tables").exists(), "byte {byte_offset}: {error}");
    }
}

/// Recording of an earlier version, in which no checksum covers metadata and indexes.
#[test]
fn recording_without_a_file_checksum_is_valid_by_its_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let options = mcap::WriteOptions::new().calculate_data_section_crc(false);
    let mut writer = options.create(fs::File::create(&path).unwrap()).unwrap();
    writer.add_channel(0, "/tf", "cdr", &BTreeMap::new()).unwrap();
    writer.finish().unwrap();
    let outcome = recover(&path, &folder.path().join("out.mcap")).unwrap();
    assert_eq!(outcome, RecoverOutcome::Complete { is_checked: false });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn recovery_and_export_never_panic_on_damage(
        changed_bytes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
        length in any::<prop::sample::Index>(),
    ) {
        let (folder, path) = write_recording(100);
        let mut bytes = fs::read(&path).unwrap();
        bytes.truncate(length.index(bytes.len()) + 1);
        for (byte_offset, value) in changed_bytes {
            let byte_offset = byte_offset.index(bytes.len());
            bytes[byte_offset] = value;
        }
        let damaged_path = folder.path().join("bad.mcap");
        fs::write(&damaged_path, &bytes).unwrap();
        let recovered_path = folder.path().join("out.mcap");
        if let Ok(RecoverOutcome::Recovered(found)) = recover(&damaged_path, &recovered_path) {
            prop_assert_eq!(read_messages(&recovered_path).len() as u64, found.message_count);
        }
        let _ = export(&damaged_path, &folder.path().join("tables"), true);
    }
}
