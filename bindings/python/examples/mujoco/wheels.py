"""Differential-drive robots on a floor, in MuJoCo: two wheels with velocity servos and a caster at either end.

Wheels roll by friction, and may slip; bodies have mass, and collide. The servos follow a ramp: v and w
change together, within the scenario's ``limits`` of the robot, as docs/explanation/inertia.md requires of
a driver. Needs ``pip install mujoco``; nothing is drawn.
"""

import numpy as np
import phalanx
from floor import Floor, approach

CLASSES = """
<default class="wheel"><geom type="ellipsoid" friction="1.5 0 0" condim="3" density="1200"/></default>
<default class="caster"><geom type="sphere" condim="1" priority="1" density="100"/></default>
"""
# All lengths are fractions of the track width, which thus determines the size of a robot.
BODY = """
<body name="{n}" pos="{x} {y} {radius}" euler="0 0 {heading}">
  <freejoint/>
  <geom type="box" size="{half} {half} {flat}" density="400"/>
  <geom class="caster" pos="{reach} 0 {low}" size="{ball}"/>
  <geom class="caster" pos="-{reach} 0 {low}" size="{ball}"/>
  <body pos="0 {side} 0">
    <joint name="{n}-left" axis="0 1 0"/><geom class="wheel" size="{radius} {thin} {radius}"/>
  </body>
  <body pos="0 -{side} 0">
    <joint name="{n}-right" axis="0 1 0"/><geom class="wheel" size="{radius} {thin} {radius}"/>
  </body>
</body>
"""
SERVO = '<velocity joint="{n}-{side}" kv="{gain}"/>'


def track_m(robot):
    """Returns the distance between the wheels, m; without ``wheels``, the distance that Phalanx assumes."""
    return robot.wheels.track_m if robot.wheels else 2.0 * robot.front_point_m


def body(robot):
    track = track_m(robot)
    ball = 0.05 * track
    return BODY.format(
        n=robot.name, x=robot.start.x_m, y=robot.start.y_m, heading=robot.start.heading_rad,
        radius=0.25 * track, thin=0.05 * track, side=0.5 * track, half=0.4 * track, flat=0.08 * track,
        reach=0.35 * track, ball=ball, low=ball - 0.246 * track,
    )  # fmt: skip


class Wheels(Floor):
    def __init__(self, robots):
        tracks = np.array([track_m(robot) for robot in robots])
        self.half_track, self.radius = 0.5 * tracks, 0.25 * tracks
        self.ramp = np.zeros((len(robots), 2))  # v and w that the servos follow
        # Mass grows with the cube of the size, so inertia and gain grow with its fifth power.
        servos = [
            SERVO.format(n=robot.name, side=side, gain=600.0 * track**5)
            for robot, track in zip(robots, tracks)
            for side in ("left", "right")
        ]
        super().__init__(robots, classes=CLASSES, bodies="".join(map(body, robots)), servos="".join(servos))

    def controls(self, twists, dt):
        # Both arrive at the same time, on a straight segment.
        needed = np.max(np.abs(twists - self.ramp) / self.rates, axis=1, keepdims=True)
        approach(self.ramp, twists, needed, dt)
        v, turn = self.ramp[:, 0], self.half_track * self.ramp[:, 1]
        return np.column_stack([v - turn, v + turn]).ravel() / np.repeat(self.radius, 2)


if __name__ == "__main__":
    phalanx.serve(Wheels)
