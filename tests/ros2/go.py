"""Sends robots to goals as ROS 2 would, with zenoh-ros2-sdk.

    go.py PORT DOMAIN ROBOT X_M Y_M   sends one robot to one goal, in the frame `map`
    go.py PORT DOMAIN < LINES         each line `ROBOT X_M Y_M [FRAME]`, or `ROBOT bytes HEX` for an invalid message

Waits until the robot listens, and prints `sent` for each.
"""

import os
import sys
import time

from zenoh_ros2_sdk import ROS2Publisher, discovery

from wire import hash_of, session

PATIENCE_S = 60
POSE = "geometry_msgs/msg/PoseStamped"

port, domain, *one = sys.argv[1:]
port, domain = int(port), int(domain)
kinds = session(port, [POSE]).store.types
publishers = {}


def publisher(robot):
    """Returns a publisher of the robot's goals, once the robot has subscribed."""
    if robot not in publishers:
        topic, known = f"/{robot}/goal_pose", hash_of(POSE)
        publishers[robot] = ROS2Publisher(topic, POSE, domain_id=domain, router_port=port, type_hash=known)
        deadline = time.monotonic() + PATIENCE_S
        while True:
            info = discovery.get_topic_info(topic, domain, "127.0.0.1", port, 0.5, True)
            listeners = info.subscribers if info else []
            if listeners:
                break
            assert time.monotonic() < deadline, f"{topic} has no subscriber"
        who = [(end.node_namespace, end.node_name, end.topic_type, end.type_hash) for end in listeners]
        assert who == [("/", robot, POSE, known)], who
    return publishers[robot]


def send(robot, x, y, frame="map"):
    to = publisher(robot)
    if x == "bytes":
        to.pub.put(bytes.fromhex(y), attachment=to._create_attachment(0, time.time_ns()))
        return
    time_of = kinds["builtin_interfaces/msg/Time"]
    header = kinds["std_msgs/msg/Header"](stamp=time_of(sec=0, nanosec=0), frame_id=frame)
    position = kinds["geometry_msgs/msg/Point"](x=float(x), y=float(y), z=0.0)
    orientation = kinds["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    pose = kinds["geometry_msgs/msg/Pose"](position=position, orientation=orientation)
    to.publish(header=header, pose=pose)


for line in [" ".join(one)] if one else sys.stdin:
    send(*line.split())
    print("sent", flush=True)
# Time for the last message to be sent.
time.sleep(0.5)
os._exit(0)
