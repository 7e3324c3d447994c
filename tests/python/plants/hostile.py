"""Moves robots by one Euler step per tick until 1 s; then it fails in the way that the file's name states."""

import ctypes
import math
import os
import time
from pathlib import Path

import phalanx


class Hostile(phalanx.Plant):
    def __init__(self, robots):
        if Path(__file__).stem == "refuses":
            raise ValueError("the physics engine has no licence")
        self.poses = [[robot.start.x_m, robot.start.y_m, robot.start.heading_rad] for robot in robots]
        self.t = 0.0

    def step(self, twists, dt):
        self.t += dt
        for pose, (v, w) in zip(self.poses, twists):
            pose[0] += v * dt * math.cos(pose[2])
            pose[1] += v * dt * math.sin(pose[2])
            pose[2] += w * dt
        if self.t > 1.001:
            return getattr(self, Path(__file__).stem)()
        return self.poses

    def raises(self):
        raise ValueError("my physics are at their end")

    def returns_nan(self):
        self.poses[1][1] = math.nan
        return self.poses

    def returns_nothing(self):
        return None

    def returns_a_string(self):
        return "north"

    def returns_bytes(self):
        return [b"abc"] * len(self.poses)

    def returns_two_robots(self):
        return self.poses[:2]

    def returns_points(self):
        return [pose[:2] for pose in self.poses]

    def sleeps(self):
        time.sleep(0.1)
        return self.poses

    def eats(self):
        held = []
        while True:
            held.append(bytearray(1_000_000))

    def leaves(self):
        os._exit(0)

    def crashes(self):
        ctypes.string_at(0)

    def loops(self):
        while True:
            pass


phalanx.serve(Hostile)
