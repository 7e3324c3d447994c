"""Subscribes to a run's topics as ROS 2 would, with zenoh-ros2-sdk, and compares the messages with the run's tables.

    hear.py PORT DOMAIN SAMPLES ROUTER ROBOT... < the run directory, once the run is over

ROUTER is `ours`, and the run listens, or `theirs`: then a router of zenoh is started here, and the run
connects to it. Prints `ready` once it listens, `heard` once it has that many samples of each robot, and
`held` at the end; a difference raises an AssertionError.
"""

import csv
import math
import os
import sys
import threading
import time

import zenoh
from zenoh_ros2_sdk import ROS2Subscriber
from zenoh_ros2_sdk import discovery
from zenoh_ros2_sdk.attachment import Attachment

import wire
from wire import store

PATIENCE_S = 60
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"

port, domain, wanted, router, *robots = sys.argv[1:]
port, domain, wanted = int(port), int(domain), int(wanted)

if router == "theirs":
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    theirs = zenoh.open(config)

hashes = {name: wire.hash_of(name) for name in [ODOMETRY, TF]}
session = wire.session(port, [ODOMETRY, TF])

samples = {topic: [] for topic in [*(f"/{robot}/odom" for robot in robots), "/tf"]}
full = threading.Event()


class Listener(ROS2Subscriber):
    """A subscription that also keeps the attachment of each message."""

    def _process_sample(self, sample):
        self.beside = Attachment.from_bytes(sample.attachment.to_bytes())
        self.raw = sample.payload.to_bytes()
        super()._process_sample(sample)


def listen(topic, message_type):
    def take(message):
        # Messages sent while the run ends may be newer than its tables.
        if full.is_set():
            return
        # Another encoder must encode the message to the same bytes.
        again = bytes(store.serialize_cdr(message, message_type))
        samples[topic].append((listener.beside, message, again == listener.raw))
        if all(len(heard) >= wanted for heard in samples.values()):
            full.set()

    known = hashes[message_type]
    listener = Listener(
        topic, message_type, take, domain_id=domain, router_port=port, type_hash=known
    )
    return listener


listeners = [listen(f"/{robot}/odom", ODOMETRY) for robot in robots] + [listen("/tf", TF)]
print("ready", flush=True)
assert full.wait(PATIENCE_S), {topic: len(heard) for topic, heard in samples.items()}

# Nodes and endpoints, as `ros2 node list` and `ros2 topic info -v` would show them.
topics = dict(discovery.get_topic_names_and_types(domain, "127.0.0.1", port, timeout=0.5))
for robot in robots:
    assert topics[f"/{robot}/odom"] == [ODOMETRY], topics
    info = discovery.get_topic_info(f"/{robot}/odom", domain, "127.0.0.1", port, 0.5, True)
    assert [(end.node_namespace, end.node_name) for end in info.publishers] == [("/", robot)], info
    assert [end.type_hash for end in info.publishers] == [hashes[ODOMETRY]], info
assert topics["/tf"] == [TF], topics
nodes = {
    str(reply.ok.key_expr).split("/")[-1]
    for reply in session.liveliness.get(f"@ros2_lv/{domain}/*/*/*/NN/**", timeout=0.5)
    if reply.ok
}
assert {*robots, "phalanx"} <= nodes, nodes
print("heard", flush=True)

run = sys.stdin.readline().strip()
time.sleep(0.5)
for listener in listeners:
    listener.close()

# Each message is a row; while the robot moves, exactly one row, at a constant time offset from the message.
rows = {robot: {} for robot in robots}
with open(f"{run}/samples.csv") as table:
    for row in csv.DictReader(table):
        values = {key: float(row[key]) for key in ["t_s", "heading_rad", "v_m_s", "w_rad_s"]}
        rows[row["robot"]].setdefault((float(row["x_m"]), float(row["y_m"])), []).append(values)


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def turn(orientation):
    assert orientation.x == orientation.y == 0
    return 2 * math.atan2(orientation.z, orientation.w)


def near(a, b):
    return abs(math.remainder(a - b, 2 * math.pi)) < 1e-9


offsets = []
for robot in robots:
    heard = samples[f"/{robot}/odom"]
    first = heard[0][0].sequence_id
    assert len(heard) >= wanted
    assert [beside.sequence_id for beside, _, _ in heard] == [*range(first, first + len(heard))]
    assert len({beside.gid for beside, _, _ in heard}) == 1
    for beside, message, same in heard:
        assert same, "rosbags encodes it otherwise"
        assert (message.header.frame_id, message.child_frame_id) == ("map", f"{robot}/base_link")
        assert beside.timestamp_ns == stamp_ns(message)
        pose, twist = message.pose.pose, message.twist.twist
        there = rows[robot][pose.position.x, pose.position.y]
        assert pose.position.z == 0
        assert any(near(turn(pose.orientation), row["heading_rad"]) for row in there)
        assert (twist.linear.x, twist.angular.z) in {(row["v_m_s"], row["w_rad_s"]) for row in there}
        assert twist.linear.y == twist.linear.z == twist.angular.x == twist.angular.y == 0
        if len(there) == 1:
            offsets.append(stamp_ns(message) / 1e9 - there[0]["t_s"])
assert len(offsets) >= wanted, "too few while robots moved"
spread_s = max(offsets) - min(offsets)
assert spread_s < 1e-5, f"stamps and run time drift apart by {spread_s} s"
assert abs(time.time() - max(offsets)) < 3_600, "stamps are not of the wall clock"

transforms = 0
for beside, message, same in samples["/tf"]:
    assert same, "rosbags encodes it otherwise"
    for transform in message.transforms:
        robot, link = transform.child_frame_id.split("/")
        assert (transform.header.frame_id, link) == ("map", "base_link")
        place = transform.transform.translation
        there = rows[robot][place.x, place.y]
        heading_rad = turn(transform.transform.rotation)
        assert place.z == 0 and any(near(heading_rad, row["heading_rad"]) for row in there)
        transforms += 1
odometry = sum(len(samples[f"/{robot}/odom"]) for robot in robots)
print(f"held: {odometry} messages of odometry, {transforms} transforms", flush=True)
os._exit(0)
