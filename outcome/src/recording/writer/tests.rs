//! Tests that the crate `mcap` reads what the writer wrote.

use std::fs;
use std::io::{Read, Write as _};

use mcap::Summary;
use mcap::read::LinearReader as Plain;
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use proptest::prelude::*;

use super::*;
use crate::recording::chunk::CHUNK_BYTES_MAX;

#[derive(Debug, Clone)]
enum WriterStep {
    Message { channel: prop::sample::Index, stamp_ns: u64, size: usize, is_random: bool },
    Flush,
    Attachment(Vec<u8>),
    Metadata(String),
}

fn arbitrary_step() -> impl Strategy<Value = WriterStep> {
    let size = prop_oneof![8 => 0..600usize, 2 => 0..20_000usize, 1 => 60_000..300_000usize];
    let message = (any::<prop::sample::Index>(), 1..1_000_000u64, size, any::<bool>());
    prop_oneof![
        20 => message.prop_map(|(channel, stamp_ns, size, is_random)| {
            WriterStep::Message { channel, stamp_ns, size, is_random }
        }),
        2 => Just(WriterStep::Flush),
        1 => prop::collection::vec(any::<u8>(), 0..2000).prop_map(WriterStep::Attachment),
        1 => "[a-z]{0,9}".prop_map(WriterStep::Metadata),
    ]
}

/// Returns bytes that compress well, or do not compress with `is_random`.
fn generate_content(size: usize, is_random: bool, seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    let mut byte = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 56) as u8
    };
    (0..size).map(|at| if is_random || at % 50 == 0 { byte() } else { 0 }).collect()
}

/// Creates a file with this number of channels, alternating between three types.
fn create_with_channels(
    channels: usize,
) -> (tempfile::TempDir, std::path::PathBuf, RecordingWriter) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.mcap");
    let mut writer = RecordingWriter::create(&path, "ros2").unwrap();
    let schemas =
        [(); 3].map(|()| writer.register_schema("a type", "ros2msg", b"float64 x\n").unwrap());
    for (id, schema) in (0..channels).zip(schemas.into_iter().cycle()) {
        let metadata = BTreeMap::from([("key".into(), "value".into())]);
        assert_eq!(
            usize::from(writer.register_channel(schema, &format!("/{id}"), metadata).unwrap()),
            id
        );
    }
    (folder, path, writer)
}

/// Reads every record of a file and checks all checksums.
fn read_records(file: &[u8]) -> Vec<Record<'static>> {
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let (mut rest, mut records) = (file, Vec::new());
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(requested_bytes) => {
                let read = rest.read(reader.insert(requested_bytes)).unwrap();
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                records.push(mcap::parse_record(opcode, data).unwrap().into_owned());
            }
        }
    }
    records
}

/// Channel, sequence number, stamp and data of messages.
type Messages = Vec<(u16, u32, u64, Vec<u8>)>;

fn extract_messages(records: &[Record<'_>]) -> Messages {
    let message = |record: &Record<'_>| match record {
        Record::Message { header, data } => {
            assert_eq!(header.log_time, header.publish_time);
            Some((header.channel_id, header.sequence, header.log_time, data.to_vec()))
        }
        _ => None,
    };
    records.iter().filter_map(message).collect()
}

/// Reads every message by the summary and the indexes, in the order of sequence numbers.
fn read_indexed_messages(file: &[u8], summary: &Summary) -> Messages {
    let mut messages = Vec::new();
    for chunk in summary.chunk_indexes.iter().filter(|c| !c.message_index_offsets.is_empty()) {
        for (channel, entries) in summary.read_message_indexes(file, chunk).unwrap() {
            for entry in entries {
                let found = summary.seek_message(file, chunk, &entry).unwrap();
                assert_eq!((found.channel.id, found.log_time), (channel.id, entry.log_time));
                assert!(entry.log_time >= chunk.message_start_time);
                assert!(entry.log_time <= chunk.message_end_time);
                messages.push((
                    channel.id,
                    found.sequence,
                    found.log_time,
                    found.data.into_owned(),
                ));
            }
        }
    }
    messages.sort_by_key(|&(_, sequence, ..)| sequence);
    messages
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn crate_mcap_reads_all_records_in_order_and_by_index(
        channels in 1..40usize,
        steps in prop::collection::vec(arbitrary_step(), 0..120),
    ) {
        let (_scratch, path, mut writer) = create_with_channels(channels);
        let (mut messages, mut attachments, mut metadata_records) = (Messages::new(), Vec::new(), Vec::new());
        for step in steps {
            match step {
                WriterStep::Message { channel, stamp_ns, size, is_random } => {
                    let (channel, number) = (channel.index(channels) as u16, messages.len() as u32);
                    let data = generate_content(size, is_random, stamp_ns);
                    writer.add_message(channel, number, stamp_ns, &data).unwrap();
                    messages.push((channel, number, stamp_ns, data));
                }
                WriterStep::Flush => writer.flush().unwrap(),
                WriterStep::Attachment(data) => {
                    let name = format!("file {}", attachments.len());
                    let media_type = "text/plain".to_owned();
                    let header = AttachmentHeader { log_time: 1, create_time: 2, name, media_type };
                    writer.append_attachment(header, &data).unwrap();
                    attachments.push(data);
                }
                WriterStep::Metadata(name) => {
                    let metadata = BTreeMap::from([("key".to_owned(), name.clone())]);
                    metadata_records.push(Metadata { name, metadata });
                    writer.append_metadata(metadata_records.last().unwrap()).unwrap();
                }
            }
        }
        writer.finish().unwrap();

        let file = fs::read(&path).unwrap();
        let read = read_records(&file);
        prop_assert_eq!(&extract_messages(&read), &messages);
        prop_assert!(mcap::read::footer(&file).unwrap().summary_crc != 0);
        for record in &read {
            if let Record::DataEnd(end) = record {
                prop_assert!(end.data_section_crc != 0);
            }
            let Record::SummaryOffset(group) = record else { continue };
            let end = (group.group_start + group.group_length) as usize;
            for record in Plain::sans_magic(&file[group.group_start as usize..end]) {
                prop_assert_eq!(record.unwrap().opcode(), group.group_opcode);
            }
        }

        let summary = Summary::read(&file).unwrap().expect("a summary");
        prop_assert_eq!(&read_indexed_messages(&file, &summary), &messages);
        prop_assert_eq!(summary.channels.len(), channels);
        for (id, found) in &summary.channels {
            prop_assert_eq!(&found.topic, &format!("/{id}"));
            prop_assert!(found.schema.as_ref().is_some_and(|s| &*s.data == b"float64 x\n"));
        }
        for chunk in &summary.chunk_indexes {
            let has_single_message = chunk.message_index_offsets.len() == 1
                && chunk.message_index_length == 9 + 2 + 4 + 16;
            prop_assert!(chunk.uncompressed_size <= CHUNK_BYTES_MAX as u64 || has_single_message);
        }
        for (i, (index, data)) in summary.attachment_indexes.iter().zip(&attachments).enumerate() {
            prop_assert_eq!(&index.name, &format!("file {i}"));
            prop_assert_eq!(&mcap::read::attachment(&file, index).unwrap().data, data);
        }
        let found = summary.metadata_indexes.iter();
        let found = found.map(|index| mcap::read::metadata(&file, index).unwrap());
        prop_assert_eq!(found.collect::<Vec<_>>(), &metadata_records[..]);

        let stamps = || messages.iter().map(|&(_, _, stamp_ns, _)| stamp_ns);
        let mut channel_message_counts = BTreeMap::new();
        for &(channel, ..) in &messages {
            *channel_message_counts.entry(channel).or_insert(0) += 1;
        }
        prop_assert_eq!(summary.stats.expect("statistics"), Statistics {
            message_count: messages.len() as u64,
            schema_count: 3,
            channel_count: channels as u32,
            attachment_count: attachments.len() as u32,
            metadata_count: metadata_records.len() as u32,
            chunk_count: summary.chunk_indexes.len() as u32,
            message_start_time: stamps().min().unwrap_or(0),
            message_end_time: stamps().max().unwrap_or(0),
            channel_message_counts,
        });
    }
}

#[test]
fn partial_write_leaves_no_trace_after_the_disk_has_space() {
    let (_scratch, path, mut writer) = create_with_channels(1);
    writer.add_message(0, 0, 10, &generate_content(5000, true, 1)).unwrap();
    writer.flush().unwrap();
    writer.add_message(0, 1, 20, &generate_content(5000, true, 2)).unwrap();
    let writable_file = std::mem::replace(&mut writer.file.file, File::open(&path).unwrap());
    writer.flush().unwrap_err();
    fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(&[6; 100]).unwrap();
    writer.file.file = writable_file;
    writer.add_message(0, 2, 30, &generate_content(5000, true, 3)).unwrap();
    // A dropped writer completes the file.
    drop(writer);
    let file = fs::read(&path).unwrap();
    let stamps =
        extract_messages(&read_records(&file)).into_iter().map(|(_, _, stamp_ns, _)| stamp_ns);
    assert_eq!(stamps.collect::<Vec<_>>(), [10, 20, 30]);
    let summary = Summary::read(&file).unwrap().expect("a summary");
    assert_eq!((summary.chunk_indexes.len(), read_indexed_messages(&file, &summary).len()), (2, 3));
}
