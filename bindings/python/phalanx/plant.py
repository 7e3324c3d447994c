"""Plants in Python: a physics engine, or the drivers of real robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ._phalanx import Pose

__all__ = ["Limits", "Plant", "Robot", "Wheels"]


@dataclass(frozen=True)
class Wheels:
    """Wheel limits of a robot, the scenario's ``wheels``."""

    speed_max_m_s: float
    """Maximum speed of a wheel's rim, m/s."""
    track_m: float
    """Distance between the wheels, m."""


@dataclass(frozen=True)
class Limits:
    """Acceleration limits of a robot, the scenario's ``limits``."""

    acceleration_m_s2: float
    """Maximum acceleration (a_v), m/s^2."""
    turn_acceleration_rad_s2: float
    """Maximum turn acceleration (a_w), rad/s^2."""
    braking_time_s: float
    """Maximum braking time of a commanded twist (tau), s."""


@dataclass(frozen=True)
class Robot:
    """One robot, as the plant knows it."""

    name: str
    """Name in the scenario."""
    start: Pose
    """Pose of the axle mid-point, or of the center, at t = 0, in map; the robot is at rest."""
    front_point_m: float
    """Distance of the front point ahead of the axle (ell), m."""
    drive: str
    """Drive in the scenario: ``"differential"``, ``"omni"`` or ``"ackermann"``."""
    wheels: Wheels | None
    """Wheel limits, which its twists already meet; None if there are none."""
    limits: Limits | None
    """Acceleration limits, which the plant must meet; None if the twist changes at once."""


class Plant:
    """Motion of all robots of a scenario: ``[plant] program = ["python3", "my_plant.py"]``.

    Everything else is done by Phalanx: acceptance and expiry of commands, wheel limits, sensing, recording and
    faults. A plant may have state; a run has one process of it, and ends if that process ends.
    """

    def __init__(self, robots: Sequence[Robot]) -> None:
        """Called once, before t = 0, with the robots in the order of the scenario."""
        self.robots = robots

    def step(
        self, twists: Sequence[tuple[float, ...]], dt: float
    ) -> Sequence[Sequence[float]]:
        """Advances the robots by ``dt`` s, which is positive, and returns their poses.

        ``twists``: commanded twist of each robot, in scenario order: ``(v, w)``, forward speed in m/s and turn
        rate in rad/s, counter-clockwise; ``(0, 0)`` for a robot without a valid command. A robot with
        ``drive = "omni"`` has ``(v, side, w)``; ``side`` is the lateral speed in m/s, to the left.

        The result has a row for each robot: the pose of its axle mid-point in map, ``(x, y, heading)`` in m and
        rad, counter-clockwise from x; or ``(x, y, heading, v, w)`` with the twist that odometry reports, for
        ``drive = "omni"`` ``(x, y, heading, v, side, w)``. By
        default that is the twist of the arc from the last pose to this one. The result may be any sequence of
        such sequences, or a numpy array. Anything else, a number that is not finite, and any exception end the
        run.

        In lockstep ``dt`` is the robots' period, and in real time at most ``plant_tick_s``; both are shortened
        if a command expires. In real time the call must take less time than ``dt``.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method step(self, twists, dt)")
