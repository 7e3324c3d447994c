"""Shared code of the programs here: zenoh-ros2-sdk with the message definitions of rosbags, which it would otherwise
fetch from the network, and an immediate exit on errors."""

import os
import sys
import traceback

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zenoh_ros2_sdk.session import ZenohSession

STORES = ["ROS2_IRON", "ROS2_JAZZY", "ROS2_KILTED", "ROS2_LYRICAL"]
store = get_typestore(Stores.ROS2_JAZZY)


def fail(*error):
    # Threads of zenoh would keep the process alive.
    traceback.print_exception(*error)
    sys.stderr.flush()
    os._exit(1)


sys.excepthook = fail


def hash_of(name):
    """Returns the hash of a message type. It is the same from Iron to Lyrical."""
    known = {get_typestore(Stores[release]).hash_rihs01(name) for release in STORES}
    assert len(known) == 1, f"{name} is the same from Iron to Lyrical"
    return known.pop()


def session(port, names):
    """Opens a session at the router on this port, with these message types."""
    opened = ZenohSession.get_instance("127.0.0.1", port)
    opened.store.register({
        name: fields
        for dependency in names
        for name, fields in get_types_from_msg(
            store.generate_msgdef(dependency)[0], dependency
        ).items()
    })
    for name in names:
        opened._registered_types[name] = name
    return opened
