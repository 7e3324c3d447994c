"""Common part of the plants in MuJoCo: bodies on a floor, whose servos follow ramps of the commanded twists."""

import math

import mujoco
import numpy as np
import phalanx

STEP_S = 0.001  # maximum duration of one step of the engine
HASTE = 1.25  # ramps are steeper than declared by this factor, because servos lag behind them

WORLD = """
<mujoco>
  <compiler angle="radian"/>
  <option integrator="implicitfast" cone="elliptic" impratio="10"/>
  <default>{classes}</default>
  <worldbody><geom type="plane" size="0 0 1" conaffinity="0"/>{bodies}</worldbody>
  <tendon>{tendons}</tendon>
  <actuator>{servos}</actuator>
</mujoco>
"""


def approach(values, targets, needed, dt):
    """Moves ``values`` towards ``targets`` for ``dt`` s; each of them takes ``needed`` s to arrive."""
    values += (targets - values) * np.minimum(1.0, dt / np.maximum(needed, 1e-12))


class Floor(phalanx.Plant):
    """Plant that simulates bodies named as their robots; subclasses compute the controls of the servos.

    ``parts`` are the MJCF texts that are inserted into ``WORLD``.
    """

    def __init__(self, robots, **parts):
        rates = [robot.limits for robot in robots]
        self.rates = HASTE * np.array(
            [(r.acceleration_m_s2, r.turn_acceleration_rad_s2) if r else (math.inf, math.inf) for r in rates]
        )
        self.model = mujoco.MjModel.from_xml_string(WORLD.format(**{"tendons": "", **parts}))
        self.data = mujoco.MjData(self.model)
        self.bodies = [self.model.body(robot.name).id for robot in robots]
        joints = [self.model.body(robot.name).jntadr[0] for robot in robots]
        self.dofs = np.array([self.model.jnt_dofadr[joint] for joint in joints])
        mujoco.mj_forward(self.model, self.data)

    def controls(self, twists, dt):
        """Returns the controls of all servos for the next ``dt`` s."""
        raise NotImplementedError

    def step(self, twists, dt):
        twists, steps = np.array(twists), math.ceil(dt / STEP_S)
        self.model.opt.timestep = dt / steps
        for _ in range(steps):
            self.data.ctrl[:] = self.controls(twists, dt / steps)
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        ahead = self.data.xmat[self.bodies].reshape(-1, 3, 3)[:, :2, 0]
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        velocities, turns = (self.data.qvel[self.dofs[:, None] + columns] for columns in ([0, 1], [5]))
        speeds = [np.sum(velocities * ahead, axis=1), np.sum(velocities * left, axis=1)]
        headings = np.arctan2(ahead[:, 1], ahead[:, 0])
        return np.column_stack([
            self.data.xpos[self.bodies][:, :2], headings, *speeds[: twists.shape[1] - 1], turns[:, 0]
        ])  # fmt: skip
