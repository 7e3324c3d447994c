"""Loads a recording with Rerun's own loader, without its window. `by_rerun.py RUN_DIR`

Transforms, poses and log lines must become Rerun's own components, which its viewer draws; the other
messages must become rows of their types. Every message must have a row.
"""

import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from against_tables import Tables

CHUNK = re.compile(r"^Chunk\(\w+\) with (\d+) rows? .* - (/\S+) - data columns: \[(.*)\]$")

run_dir = Path(sys.argv[1])
tables = Tables(run_dir)
rerun = Path(sys.executable).with_name("rerun")
with tempfile.TemporaryDirectory() as scratch:
    rrd = Path(scratch) / "run.rrd"
    convert = [rerun, "mcap", "convert", run_dir / "run.mcap", "--output", rrd]
    subprocess.run(convert, check=True, capture_output=True)
    subprocess.run([rerun, "rrd", "verify", rrd], check=True, capture_output=True)
    printed = subprocess.run(
        [rerun, "rrd", "print", rrd], check=True, capture_output=True, text=True
    ).stdout

rows = Counter()
for line in printed.splitlines():
    if found := CHUNK.match(line):
        count, entity, columns = int(found[1]), found[2], found[3]
        rows.update({(entity, column): count for column in columns.split()})

instants = len(tables.samples) // len(tables.robots)
expected = {
    ("/tf", "Transform3D:translation"): instants * len(tables.robots),
    ("/rosout", "TextLog:text"): len(tables.events),
    ("/metrics", "phalanx_msgs.msg.Metrics:message"): instants,
}
if tables.walls:
    expected["/walls", "visualization_msgs.msg.MarkerArray:message"] = 1
for robot in tables.robots:
    expected[f"/{robot}/pose", "InstancePoses3D:translations"] = instants
    expected[f"/{robot}/odom", "nav_msgs.msg.Odometry:message"] = instants
    expected[f"/{robot}/cmd_vel", "geometry_msgs.msg.Twist:message"] = instants
for key, count in expected.items():
    assert rows[key] == count, f"{key[1]} of {key[0]}: {rows[key]} rows, expected {count}"
print(f"{sum(expected.values())} rows of {len(expected)} entities are in Rerun's recording")
