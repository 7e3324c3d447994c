"""Omnidirectional robots on a floor, in MuJoCo: four mecanum wheels, each with rollers on bearings at 45 degrees.

A roller transmits friction along its axis and rolls across it, so that four wheel speeds produce any velocity in
the plane. Rollers may slip; bodies have mass, and collide. Size and mass are about those of a RoboMaster EP.
Motors have a maximum torque. Their servos follow ramps: the velocity moves on a straight line to its target, and
the turn rate independently of it, within the scenario's ``limits`` of the robot, as docs/explanation/inertia.md
requires of a driver. Not modeled: suspension, flexible rollers, and friction in gears. Needs ``pip install
mujoco``; nothing is drawn.
"""

import math

import numpy as np
import phalanx
from floor import Floor, approach

RADIUS_M = 0.05  # of a wheel
ROLLERS = 12  # number per wheel
ROLLER_RADIUS_M = 0.0075  # in its middle
ROLLER_AXIS_M = RADIUS_M - ROLLER_RADIUS_M  # distance from the axle of the wheel
# Half the length of the ellipsoid with which the height of the axle is constant to second order in the wheel angle.
ROLLER_LENGTH_M = math.sqrt(ROLLER_RADIUS_M * (ROLLER_RADIUS_M + 2.0 * ROLLER_AXIS_M))
# Position of each wheel in the body, m, and direction of its lowest roller: forward and to the left (1) or right (-1).
WHEELS = [(0.1, 0.1, -1.0), (0.1, -0.1, 1.0), (-0.1, 0.1, 1.0), (-0.1, -0.1, -1.0)]

# Rollers collide with the floor only, and chassis with each other only.
CLASSES = """
<default class="chassis"><geom type="box" contype="2" conaffinity="2"/></default>
<default class="hub"><geom type="cylinder" contype="0" conaffinity="0" mass="0.1"/></default>
<default class="roller">
  <joint axis="0 0 1" damping="1e-6" armature="1e-7"/>
  <geom type="ellipsoid" contype="0" conaffinity="1" friction="1 0 0" condim="3" mass="0.005"/>
</default>
<default class="servo"><velocity kv="0.2" forcerange="-0.25 0.25"/></default>
"""
BODY = """
<body name="{n}" pos="{x} {y} {radius}" euler="0 0 {heading}">
  <freejoint/>
  <geom class="chassis" pos="0 0 0.03" size="0.16 0.12 0.05" mass="2.66"/>
  {wheels}
</body>
"""
WHEEL = """
<body pos="{x} {y} 0">
  <joint name="{n}-{i}" axis="0 1 0"/>
  <geom class="hub" size="{hub} 0.02" euler="1.5708 0 0"/>
  {rollers}
</body>
"""
ROLLER = """
<body pos="{x} 0 {z}" zaxis="{along_x} {along_y} {along_z}">
  <joint class="roller"/><geom class="roller" size="{radius} {radius} {length}"/>
</body>
"""
SERVO = '<velocity class="servo" joint="{n}-{i}"/>'


def roller(angle, left):
    """Returns the roller at this angle of the wheel; ``left`` is its direction as in ``WHEELS``."""
    s, c = math.sin(angle), math.cos(angle)
    return ROLLER.format(
        x=ROLLER_AXIS_M * s, z=-ROLLER_AXIS_M * c, along_x=c, along_y=left, along_z=s,
        radius=ROLLER_RADIUS_M, length=ROLLER_LENGTH_M,
    )  # fmt: skip


def wheel(name, i):
    x, y, left = WHEELS[i]
    rollers = [roller(2.0 * math.pi * k / ROLLERS, left) for k in range(ROLLERS)]
    return WHEEL.format(n=name, i=i, x=x, y=y, hub=ROLLER_AXIS_M - ROLLER_RADIUS_M, rollers="".join(rollers))


def body(robot):
    wheels = [wheel(robot.name, i) for i in range(len(WHEELS))]
    return BODY.format(
        n=robot.name, x=robot.start.x_m, y=robot.start.y_m, heading=robot.start.heading_rad,
        radius=RADIUS_M, wheels="".join(wheels),
    )  # fmt: skip


class Omni(Floor):
    def __init__(self, robots):
        servos = [SERVO.format(n=robot.name, i=i) for robot in robots for i in range(len(WHEELS))]
        super().__init__(
            robots,
            classes=CLASSES,
            bodies="".join(map(body, robots)),
            servos="".join(servos),
        )
        self.ramp = np.zeros((len(robots), 3))  # v, lateral speed and w that the servos follow
        # Speeds of the wheels, rad/s, for v, lateral speed and w of 1.
        self.wheel_rates = np.array([(1.0, left, left * x - y) for x, y, left in WHEELS]) / RADIUS_M

    def controls(self, twists, dt):
        change = twists - self.ramp
        speed_time = np.linalg.norm(change[:, :2], axis=1, keepdims=True) / self.rates[:, :1]
        turn_time = np.abs(change[:, 2:]) / self.rates[:, 1:]
        approach(self.ramp, twists, np.hstack([speed_time, speed_time, turn_time]), dt)
        return (self.ramp @ self.wheel_rates.T).ravel()


if __name__ == "__main__":
    phalanx.serve(Omni)
