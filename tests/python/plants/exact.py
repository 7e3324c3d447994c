"""The exact arcs of unicycles, with the same operations in the same order as the built-in plant. Under the name
`poses.py` it does not report velocities."""

import math
from pathlib import Path

import phalanx
from phalanx import real


def sinc(a):
    return 1.0 - a * a / 6.0 if abs(a) < 1e-4 else real.sin(a) / a


def wrap(angle):
    if -math.pi < angle <= math.pi:
        return angle
    turn = math.fmod(angle, 2.0 * math.pi)
    turn = turn + 2.0 * math.pi if turn < 0.0 else turn
    return turn - 2.0 * math.pi if turn > math.pi else turn


def arc(pose, twist, dt):
    (x, y, heading), (v, w) = pose, twist
    half_turn = 0.5 * w * dt
    chord = v * dt * sinc(half_turn)
    direction = heading + half_turn
    heading = wrap(heading + 2.0 * half_turn)
    return x + chord * real.cos(direction), y + chord * real.sin(direction), heading


class Exact(phalanx.Plant):
    def __init__(self, robots):
        self.poses = [(robot.start.x_m, robot.start.y_m, robot.start.heading_rad) for robot in robots]

    def step(self, twists, dt):
        self.poses = [arc(pose, twist, dt) for pose, twist in zip(self.poses, twists)]
        if Path(__file__).stem == "poses":
            return self.poses
        return [(*pose, *twist) for pose, twist in zip(self.poses, twists)]


phalanx.serve(Exact)
