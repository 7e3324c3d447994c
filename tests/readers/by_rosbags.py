"""Reads a recording with rosbags. `by_rosbags.py RUN_DIR [RECORDING]`"""

import sys
from pathlib import Path

from rosbags.highlevel import AnyReader

from against_tables import check


def messages(path: Path):
    # Without a type store, every definition must be in the file.
    with AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            yield connection.topic, stamp_ns, reader.deserialize(data, connection.msgtype)


run_dir = Path(sys.argv[1])
path = Path(sys.argv[2]) if len(sys.argv) > 2 else run_dir / "run.mcap"
check(run_dir, messages(path), partial=len(sys.argv) > 2)
