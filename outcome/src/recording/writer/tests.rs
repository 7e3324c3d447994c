//! What was written is held against another reader, the crate `mcap`.

use std::fs;
use std::io::{Read, Write as _};

use mcap::Summary;
use mcap::read::LinearReader as Plain;
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use proptest::prelude::*;

use super::*;

const SIZE_MAX: u64 = 64 * 1024;

#[derive(Debug, Clone)]
enum Step {
    Message { channel: prop::sample::Index, log_time: u64, size: usize, noise: bool },
    Flush,
    Attachment(Vec<u8>),
    Metadata(String),
}

fn step() -> impl Strategy<Value = Step> {
    let size = prop_oneof![8 => 0..600usize, 2 => 0..20_000usize, 1 => 60_000..140_000usize];
    let message = (any::<prop::sample::Index>(), 0..1_000_000u64, size, any::<bool>());
    prop_oneof![
        20 => message.prop_map(|(channel, log_time, size, noise)| {
            Step::Message { channel, log_time, size, noise }
        }),
        2 => Just(Step::Flush),
        1 => prop::collection::vec(any::<u8>(), 0..2000).prop_map(Step::Attachment),
        1 => "[a-z]{0,9}".prop_map(Step::Metadata),
    ]
}

/// Bytes that do not compress, or do.
fn content(size: usize, noise: bool, seed: u64) -> Vec<u8> {
    let mut word = seed.wrapping_mul(2).wrapping_add(1);
    let mut byte = || {
        word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (word >> 56) as u8
    };
    (0..size).map(|at| if noise || at % 50 == 0 { byte() } else { 0 }).collect()
}

fn schema(id: u16) -> SchemaHeader {
    SchemaHeader { id, name: format!("type {id}"), encoding: "ros2msg".into() }
}

fn channel(id: u16, schema_id: u16) -> Channel {
    Channel {
        id,
        schema_id,
        topic: format!("/{id}"),
        message_encoding: "cdr".into(),
        metadata: BTreeMap::from([("key".into(), "value".into())]),
    }
}

/// On a channel, with the number it has in the file.
fn message(channel_id: u16, sequence: usize, log_time: u64) -> MessageHeader {
    let sequence = sequence as u32;
    MessageHeader { channel_id, sequence, log_time, publish_time: log_time + 1 }
}

/// A file with one channel, 0, of no schema.
fn begun() -> (tempfile::TempDir, std::path::PathBuf, Writer) {
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("out.mcap");
    let mut writer = Writer::create(&path, "ros2").unwrap();
    writer.channel(&channel(0, 0)).unwrap();
    (scratch, path, writer)
}

/// Every record of a file, from its first byte to its last, each checksum checked.
fn records(file: &[u8]) -> Vec<Record<'static>> {
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let (mut rest, mut records) = (file, Vec::new());
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = rest.read(reader.insert(wanted)).unwrap();
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                records.push(mcap::parse_record(opcode, data).unwrap().into_owned());
            }
        }
    }
    records
}

type Messages = Vec<(MessageHeader, Vec<u8>)>;

fn messages(records: &[Record<'_>]) -> Messages {
    let message = |record: &Record<'_>| match record {
        Record::Message { header, data } => Some((*header, data.to_vec())),
        _ => None,
    };
    records.iter().filter_map(message).collect()
}

/// Every message, found by the summary and the indexes, in the order of their numbers.
fn indexed(file: &[u8], summary: &Summary) -> Messages {
    let mut messages = Vec::new();
    for chunk in summary.chunk_indexes.iter().filter(|c| !c.message_index_offsets.is_empty()) {
        for (channel, entries) in summary.read_message_indexes(file, chunk).unwrap() {
            for entry in entries {
                let found = summary.seek_message(file, chunk, &entry).unwrap();
                assert_eq!((found.channel.id, found.log_time), (channel.id, entry.log_time));
                assert!(entry.log_time >= chunk.message_start_time);
                assert!(entry.log_time <= chunk.message_end_time);
                let header = message(channel.id, found.sequence as usize, found.log_time);
                messages.push((header, found.data.into_owned()));
            }
        }
    }
    messages.sort_by_key(|(header, _)| header.sequence);
    messages
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn whatever_was_written_is_read_back_by_the_crate_mcap_in_order_and_by_index(
        channels in prop::collection::btree_set(0..300u16, 1..40),
        steps in prop::collection::vec(step(), 0..120),
    ) {
        let scratch = tempfile::tempdir().unwrap();
        let path = scratch.path().join("out.mcap");
        let mut writer = Writer::create(&path, "ros2").unwrap();
        for (id, schema_id) in channels.iter().zip((1..=3).cycle()) {
            writer.schema(&schema(schema_id), b"float64 x\n").unwrap();
            writer.channel(&channel(*id, schema_id)).unwrap();
        }
        let ids: Vec<u16> = channels.iter().copied().collect();
        let (mut written, mut attached, mut facts) = (Messages::new(), Vec::new(), Vec::new());
        for step in steps {
            match step {
                Step::Message { channel, log_time, size, noise } => {
                    let header = message(*channel.get(&ids), written.len(), log_time);
                    let data = content(size, noise, log_time);
                    writer.message(&header, &data).unwrap();
                    written.push((header, data));
                }
                Step::Flush => writer.flush().unwrap(),
                Step::Attachment(data) => {
                    let header = AttachmentHeader {
                        log_time: 1,
                        create_time: 2,
                        name: format!("file {}", attached.len()),
                        media_type: "text/plain".into(),
                    };
                    writer.attachment(&header, &data).unwrap();
                    attached.push((header, data));
                }
                Step::Metadata(name) => {
                    let metadata = BTreeMap::from([("key".to_owned(), name.clone())]);
                    let metadata = Metadata { name, metadata };
                    writer.metadata(&metadata).unwrap();
                    facts.push(metadata);
                }
            }
        }
        writer.finish().unwrap();

        let file = fs::read(&path).unwrap();
        let read = records(&file);
        prop_assert_eq!(&messages(&read), &written);
        prop_assert!(mcap::read::footer(&file).unwrap().summary_crc != 0);
        for record in &read {
            let Record::SummaryOffset(group) = record else { continue };
            let end = (group.group_start + group.group_length) as usize;
            for record in Plain::sans_magic(&file[group.group_start as usize..end]) {
                prop_assert_eq!(record.unwrap().opcode(), group.group_opcode);
            }
        }

        let summary = Summary::read(&file).unwrap().expect("a summary");
        prop_assert_eq!(&indexed(&file, &summary), &written);
        prop_assert_eq!(summary.channels.len(), ids.len());
        for (id, found) in &summary.channels {
            prop_assert_eq!(&found.topic, &format!("/{id}"));
            prop_assert!(found.schema.as_ref().is_some_and(|s| &*s.data == b"float64 x\n"));
        }
        for chunk in &summary.chunk_indexes {
            let alone = chunk.message_index_offsets.len() == 1
                && chunk.message_index_length == 9 + 2 + 4 + 16;
            prop_assert!(chunk.uncompressed_size <= SIZE_MAX || alone);
        }
        let found = summary.attachment_indexes.iter().map(|index| {
            let found = mcap::read::attachment(&file, index).unwrap();
            (index.name.clone(), found.data.into_owned())
        });
        let expected = attached.into_iter().map(|(header, data)| (header.name, data));
        prop_assert_eq!(found.collect::<Vec<_>>(), expected.collect::<Vec<_>>());
        let found = summary.metadata_indexes.iter();
        let found = found.map(|index| mcap::read::metadata(&file, index).unwrap());
        prop_assert_eq!(found.collect::<Vec<_>>(), facts);

        let statistics = summary.stats.expect("statistics");
        prop_assert_eq!(statistics.message_count, written.len() as u64);
        prop_assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
        prop_assert_eq!(statistics.attachment_count as usize, summary.attachment_indexes.len());
        prop_assert_eq!(statistics.metadata_count as usize, summary.metadata_indexes.len());
        let stamps = || written.iter().map(|(header, _)| header.log_time);
        prop_assert_eq!(statistics.message_start_time, stamps().min().unwrap_or(0));
        prop_assert_eq!(statistics.message_end_time, stamps().max().unwrap_or(0));
        for (id, count) in statistics.channel_message_counts {
            let on_it = written.iter().filter(|(header, _)| header.channel_id == id);
            prop_assert_eq!(on_it.count() as u64, count);
        }
    }
}

#[test]
fn a_write_that_failed_half_way_leaves_no_trace_once_the_disk_has_room_again() {
    let (_scratch, path, mut writer) = begun();
    writer.message(&message(0, 0, 10), &content(5000, true, 1)).unwrap();
    writer.flush().unwrap();
    writer.message(&message(0, 1, 20), &content(5000, true, 2)).unwrap();
    let good = std::mem::replace(&mut writer.file.file, File::open(&path).unwrap());
    writer.flush().unwrap_err();
    fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(&[6; 100]).unwrap();
    writer.file.file = good;
    writer.message(&message(0, 2, 30), &content(5000, true, 3)).unwrap();
    writer.finish().unwrap();
    let file = fs::read(&path).unwrap();
    let stamps: Vec<u64> =
        messages(&records(&file)).iter().map(|(header, _)| header.log_time).collect();
    assert_eq!(stamps, [10, 20, 30]);
    let summary = Summary::read(&file).unwrap().expect("a summary");
    assert_eq!((summary.chunk_indexes.len(), indexed(&file, &summary).len()), (2, 3));
}

#[test]
fn a_file_that_nobody_finished_gets_its_end_all_the_same() {
    let (_scratch, path, mut writer) = begun();
    writer.message(&message(0, 0, 10), b"data").unwrap();
    drop(writer);
    let file = fs::read(&path).unwrap();
    assert_eq!(messages(&records(&file)), [(message(0, 0, 10), b"data".to_vec())]);
    assert!(Summary::read(&file).unwrap().is_some());
}

#[test]
fn what_contradicts_the_file_is_refused_and_named_and_the_same_again_is_not() {
    let (_scratch, path, mut writer) = begun();
    let refused = |result: Result<(), WriteError>| result.unwrap_err().to_string();
    assert!(refused(writer.message(&message(7, 0, 1), b"")).contains("on channel 7"));
    assert!(refused(writer.channel(&channel(1, 9))).contains("of schema 9"));
    assert!(refused(writer.schema(&schema(0), b"")).contains("\"type 0\""));
    writer.schema(&schema(9), b"bool b\n").unwrap();
    writer.schema(&schema(9), b"bool b\n").unwrap();
    assert!(refused(writer.schema(&schema(9), b"")).contains("schema 9 is in the file"));
    writer.channel(&channel(1, 9)).unwrap();
    writer.channel(&channel(1, 9)).unwrap();
    assert!(refused(writer.channel(&channel(1, 0))).contains("channel 1 is in the file"));
    writer.finish().unwrap();
    let summary = Summary::read(&fs::read(&path).unwrap()).unwrap().expect("a summary");
    assert_eq!((summary.channels.len(), summary.schemas.len()), (2, 1));
}
