"""Reads a recording with mcap and mcap-ros2-support. `by_mcap.py RUN_DIR [RECORDING]`"""

import json
import sys
import tomllib
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from against_tables import check

run_dir = Path(sys.argv[1])
path = Path(sys.argv[2]) if len(sys.argv) > 2 else run_dir / "run.mcap"

with open(path, "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    assert reader.get_header().profile == "ros2"
    summary = reader.get_summary()
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 0
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}

    attachments = {attachment.name: attachment for attachment in reader.iter_attachments()}
    text = attachments["scenario.toml"].data.decode()
    assert text == (run_dir / "scenario.toml").read_text()
    scenario = tomllib.loads(text)
    manifest = json.loads((run_dir / "manifest.json").read_text())
    # In lockstep the recording is a function of the run only, without its place and time.
    attached = attachments.get("manifest.json")
    assert (attached is None) == (manifest["pace"] == "lockstep")
    assert attached is None or json.loads(attached.data) == manifest
    facts = {record.name: record.metadata for record in reader.iter_metadata()}["phalanx"]
    assert facts["robots"] == ",".join(robot["name"] for robot in scenario["robot"])
    assert int(facts["started_unix_ns"]) == manifest["epoch_unix_ns"]

    # Messages are in the file's order: an event may be recorded after its instant.
    messages = reader.iter_decoded_messages(log_time_order=False)
    told = ((channel.topic, message.log_time, decoded) for _, channel, message, decoded in messages)
    check(run_dir, told, partial=len(sys.argv) > 2)
