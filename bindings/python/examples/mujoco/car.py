"""Cars on a floor, in MuJoCo: a driven rear axle with a differential, and steered front wheels.

Wheels roll by friction, and may slip; bodies have mass, and collide. Size and mass are about those of an F1TENTH. One
motor with a maximum torque controls the mean speed of the rear wheels, and brakes. A twist (v, w) is driven at the
steering angle atan(wheelbase w / v), with Ackermann geometry of the front wheels. The speed follows a ramp within
the scenario's ``limits`` of the robot, and the steering angle a ramp of its own. Not modeled: suspension, rolling
resistance, and deformation of tires. Needs ``pip install mujoco``; nothing is drawn.
"""

import numpy as np
import phalanx
from floor import Floor, approach

WHEELBASE_M, TRACK_M = 0.3302, 0.27
RADIUS_M = 0.05  # of a wheel
STEERING_MAX_RAD = 0.4189
STEERING_RATE_RAD_S = 3.2  # maximum rate of the steering angle

# Wheels collide with the floor only, and chassis with each other only.
CLASSES = """
<default class="chassis"><geom type="box" contype="2" conaffinity="2"/></default>
<default class="wheel">
  <geom type="ellipsoid" contype="0" conaffinity="1" friction="1 0 0" condim="3" mass="0.15"/>
</default>
<default class="steering"><joint axis="0 0 1" armature="1e-3"/><position kp="2" kv="0.12" forcerange="-1 1"/></default>
<default class="motor"><velocity kv="1" forcerange="-1.5 1.5"/></default>
"""
# The origin of a body is the midpoint of its rear axle, at which a car is controlled.
BODY = """
<body name="{n}" pos="{x} {y} {radius}" euler="0 0 {heading}">
  <freejoint/>
  <geom class="chassis" pos="{middle} 0 0.03" size="0.29 0.155 0.05" mass="3.14"/>
  <body pos="0 {half} 0">
    <joint name="{n}-rear-left" axis="0 1 0"/><geom class="wheel" size="{radius} 0.02 {radius}"/>
  </body>
  <body pos="0 -{half} 0">
    <joint name="{n}-rear-right" axis="0 1 0"/><geom class="wheel" size="{radius} 0.02 {radius}"/>
  </body>
  <body pos="{base} {half} 0">
    <joint class="steering" name="{n}-left"/>
    <joint axis="0 1 0"/><geom class="wheel" size="{radius} 0.02 {radius}"/>
  </body>
  <body pos="{base} -{half} 0">
    <joint class="steering" name="{n}-right"/>
    <joint axis="0 1 0"/><geom class="wheel" size="{radius} 0.02 {radius}"/>
  </body>
</body>
"""
DIFFERENTIAL = """
<fixed name="{n}-axle">
  <joint joint="{n}-rear-left" coef="0.5"/><joint joint="{n}-rear-right" coef="0.5"/>
</fixed>
"""
SERVOS = """
<velocity class="motor" tendon="{n}-axle"/>
<position class="steering" joint="{n}-left"/><position class="steering" joint="{n}-right"/>
"""


def body(robot):
    return BODY.format(
        n=robot.name, x=robot.start.x_m, y=robot.start.y_m, heading=robot.start.heading_rad,
        radius=RADIUS_M, base=WHEELBASE_M, middle=0.5 * WHEELBASE_M, half=0.5 * TRACK_M,
    )  # fmt: skip


class Car(Floor):
    def __init__(self, robots):
        super().__init__(
            robots,
            classes=CLASSES,
            bodies="".join(map(body, robots)),
            tendons="".join(DIFFERENTIAL.format(n=robot.name) for robot in robots),
            servos="".join(SERVOS.format(n=robot.name) for robot in robots),
        )
        self.ramp = np.zeros((len(robots), 2))  # speed and steering angle that the servos follow
        self.targets = np.zeros((len(robots), 2))
        self.rates = np.column_stack([self.rates[:, 0], np.full(len(robots), STEERING_RATE_RAD_S)])

    def controls(self, twists, dt):
        v, w = twists.T
        moves = np.abs(v) > 1e-6  # other cars keep their steering angle
        self.targets[:, 0] = v
        self.targets[moves, 1] = np.arctan(WHEELBASE_M * w[moves] / v[moves])
        np.clip(self.targets[:, 1], -STEERING_MAX_RAD, STEERING_MAX_RAD, out=self.targets[:, 1])
        approach(self.ramp, self.targets, np.abs(self.targets - self.ramp) / self.rates, dt)
        curvature = np.tan(self.ramp[:, 1]) / WHEELBASE_M  # of the path of the rear axle's midpoint, 1/m
        left, right = (
            np.arctan(WHEELBASE_M * curvature / (1.0 - side * curvature)) for side in (0.5 * TRACK_M, -0.5 * TRACK_M)
        )
        return np.column_stack([self.ramp[:, 0] / RADIUS_M, left, right]).ravel()


if __name__ == "__main__":
    phalanx.serve(Car)
