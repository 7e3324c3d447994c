"""What moves the robots, in Python: a physics engine, or the wheels of real ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ._phalanx import Pose

__all__ = ["Limits", "Plant", "Robot", "Wheels"]


@dataclass(frozen=True)
class Wheels:
    """What the wheels of a robot can do, by the scenario's ``wheels``."""

    speed_max_m_s: float
    """The largest speed of a wheel's rim, m/s."""
    track_m: float
    """The distance between the wheels, m."""


@dataclass(frozen=True)
class Limits:
    """How fast the twist of a robot is to change, by the scenario's ``limits``."""

    acceleration_m_s2: float
    """a_v: of its speed, m/s^2."""
    turn_acceleration_rad_s2: float
    """a_w: of its turn rate, rad/s^2."""
    braking_time_s: float
    """tau: it is told no twist that takes longer to brake from, s."""


@dataclass(frozen=True)
class Robot:
    """One robot as the plant knows it."""

    name: str
    """Its name in the scenario."""
    start: Pose
    """Where the middle of its axle is at t = 0, in map; it stands."""
    front_point_m: float
    """ell: how far the front point lies ahead of the axle, m."""
    wheels: Wheels | None
    """What its wheels can do; its twists are within it already."""
    limits: Limits | None
    """How fast its twist changes, which is for the plant to keep; None: at once."""


class Plant:
    """What moves the robots of a scenario: ``[plant] program = ["python3", "my_plant.py"]``.

    Everything else stays with Phalanx: which commands are in force and when they expire, the limits of the
    wheels, what is sensed, what is recorded, and every fault. A plant may keep state; there is one
    process of it for the run, and the run ends with it.
    """

    def __init__(self, robots: Sequence[Robot]) -> None:
        """Called once, before t = 0, with the robots in the order of the scenario."""
        self.robots = robots

    def step(
        self, twists: Sequence[tuple[float, float]], dt: float
    ) -> Sequence[Sequence[float]]:
        """Lets ``dt`` s pass, more than 0, and says where that leads.

        ``twists``: what each robot is to do meanwhile, in their order: ``(v, w)``, forward speed in m/s
        and turn rate in rad/s, counter-clockwise; ``(0, 0)`` for one without a command in force.

        The answer: for each robot where the middle of its axle is in map, ``(x, y, heading)`` in m and rad,
        counter-clockwise from x; or ``(x, y, heading, v, w)`` with its twist as odometry is to show it.
        Without, that is the twist of the arc from the last pose to this one. Any sequence of such sequences
        will do, and an array of numpy. Anything else, a number that is not finite, and any exception
        end the run.

        In lockstep ``dt`` is the robots' period, and in real time at most ``plant_tick_s``; both are cut
        where a command expires. In real time it has to take less time than it lets pass.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method step(self, twists, dt)")
