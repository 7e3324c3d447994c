"""Input of laws and controllers at one odometry sample. SI units; positions and velocities are (x, y) in the frame map."""

import os
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Literal, final

__all__ = ["Episode", "serve", "serve_plant", "InNeighbor", "Neighbor", "Odometry", "Outbox", "OwnRobot", "Pose", "Situation", "Twist", "__version__", "real", "resilient_mean"]

from .plant import Limits

__version__: str

real: ModuleType
"""See phalanx.real."""

@final
class Pose:
    """A pose of the axle mid-point, in map."""

    @property
    def x_m(self) -> float: ...
    @property
    def y_m(self) -> float: ...
    @property
    def heading_rad(self) -> float:
        """Heading, counter-clockwise from x, rad, in (-pi, pi]."""

@final
class Twist:
    """A twist of the body."""

    @property
    def v_m_s(self) -> float:
        """Forward speed, m/s."""
    @property
    def side_m_s(self) -> float:
        """Lateral speed, m/s, to the left; 0 unless the robot is omnidirectional."""
    @property
    def w_rad_s(self) -> float:
        """Turn rate, rad/s, counter-clockwise."""

@final
class Neighbor:
    """State of one neighbor, as known from its beacons."""

    @property
    def name(self) -> str: ...
    @property
    def index(self) -> int:
        """Place in the scenario, from 1."""
    @property
    def position(self) -> tuple[float, float]:
        """Front point, m: extrapolated by its velocity to the time of the sample; for a lost neighbor, to the time at
        which it was declared lost."""
    @property
    def velocity(self) -> tuple[float, float]:
        """Published velocity, m/s; zero for a lost neighbor."""
    @property
    def offset(self) -> tuple[float, float]:
        """Desired position relative to the neighbor, m, rotated and scaled with the formation. (20)"""
    @property
    def offset_velocity(self) -> tuple[float, float]:
        """Rate of change of the offset, m/s. (22)"""
    @property
    def age_s(self) -> float:
        """Age of its newest beacon, s. In real time it is negative for a beacon newer than the sample."""
    @property
    def contact(self) -> Literal["fresh", "stale", "lost"]:
        """Contact state: recent beacons, stale and extrapolated, or lost (timed out)."""
    @property
    def incarnation(self) -> int:
        """Number of earlier starts of its process: it increases when the neighbor restarts."""
    @property
    def message(self) -> Any:
        """Newest message of this incarnation: a dict of arrays (numbers or nested lists of the declared shapes), or
        bytes; None before the first one."""
    @property
    def messages(self) -> list[Any]:
        """All messages that arrived since the law was called last, oldest first, at most ``message_queue`` of
        ``[laws.NAME]``; empty without that key."""
    @property
    def params(self) -> dict[str, Any]:
        """``params`` of the edge from this neighbor; empty without any."""
    @property
    def message_age_s(self) -> float | None:
        """Age of that message, s; None without one."""

@final
class InNeighbor:
    """An in-neighbor of the own robot, whether or not a beacon of it was received."""

    @property
    def name(self) -> str: ...
    @property
    def index(self) -> int:
        """Place in the scenario, from 1."""
    @property
    def offset(self) -> tuple[float, float]:
        """Desired position relative to this neighbor as in the scenario, m; (0, 0) if none is given."""
    @property
    def params(self) -> dict[str, Any]:
        """``params`` of the edge from this neighbor; empty without any."""

@final
class OwnRobot:
    """What a law knows of its own robot: ``self.robot``."""

    @property
    def name(self) -> str: ...
    @property
    def index(self) -> int:
        """Place in the scenario, from 1."""
    @property
    def law(self) -> str:
        """Name of the law: NAME of ``[laws.NAME]``."""
    @property
    def incarnation(self) -> int:
        """Number of earlier starts of the robot's process."""
    @property
    def seed(self) -> int:
        """Seed for random numbers, which follows from the scenario's and differs from robot to robot."""
    @property
    def neighbors(self) -> list[InNeighbor]:
        """In-neighbors, in the order of the scenario."""
    @property
    def place(self) -> tuple[float, float] | None:
        """``place_m`` of the robot, m."""
    @property
    def goal(self) -> tuple[float, float] | None:
        """``goal_m`` of the robot, m."""
    @property
    def params(self) -> dict[str, Any]:
        """``params`` of the law, with those of the robot in place of equal keys."""
    @property
    def front_point_m(self) -> float:
        """Distance of the front point ahead of the axle (ell), m."""
    @property
    def limits(self) -> Limits | None:
        """Acceleration limits; None if the twist changes at once."""
    @property
    def distance_min_m(self) -> float:
        """Minimum distance of two front points (d), m."""
    @property
    def speed_max_m_s(self) -> float:
        """Speed limit of a front point (v_max), m/s; infinite if there is none."""
    @property
    def sensing_radius_m(self) -> float:
        """Distance up to which other robots are sensed, m."""
    @property
    def period_s(self) -> float:
        """Control period, s."""
    @property
    def pace(self) -> Literal["lockstep", "realtime"]: ...

@final
class Outbox:
    """What leaves with the next answer: ``Law.publish``, ``Law.target``, ``Law.record`` and ``Law.withhold``."""

    def publish(self, data: bytes | None = None, /, **arrays: Any) -> None: ...
    def target(self, position: Sequence[float], velocity: Sequence[float] | None = None) -> None: ...
    def record(self, **values: float) -> None: ...
    def withhold(self) -> None: ...

@final
class Situation:
    """Input of a law: what the robot knows at one odometry sample."""

    @property
    def error(self) -> tuple[float, float]:
        """Front point minus its target by the robot's role, m. (13) (32)"""
    @property
    def desired_velocity(self) -> tuple[float, float]:
        """Velocity of that target half a period after the sample, m/s."""
    @property
    def pose(self) -> Pose: ...
    @property
    def front_point(self) -> tuple[float, float]:
        """Front point of the robot, m."""
    @property
    def twist(self) -> Twist:
        """Twist of the robot at the sample."""
    @property
    def near(self) -> list[tuple[float, float]] | None:
        """Front points of the robots in sensing range, m, nearest first; ``None`` while the proximity sensor fails."""
    @property
    def near_cut(self) -> bool:
        """Whether more robots are in range than ``near`` lists: 32, or 16 with an avoidance method that senses velocities."""
    @property
    def t_s(self) -> float:
        """Time since the start of the run, s."""
    @property
    def period_s(self) -> float:
        """Control period, s."""
    @property
    def neighbors(self) -> list[Neighbor]:
        """In-neighbors from which a beacon was received at least once, including lost ones."""

@final
class Odometry:
    """Sensor data and target of a robot, for a controller."""

    @property
    def pose(self) -> Pose: ...
    @property
    def twist(self) -> Twist:
        """Twist of the robot at the sample."""
    @property
    def front_point(self) -> tuple[float, float]:
        """Front point of the robot, m."""
    @property
    def front_point_m(self) -> float:
        """Distance of the front point ahead of the axle, m."""
    @property
    def near(self) -> list[tuple[float, float]] | None:
        """Front points of the robots in sensing range, m, nearest first; ``None`` while the proximity sensor fails."""
    @property
    def near_cut(self) -> bool:
        """Whether more robots are in range than ``near`` lists: 32, or 16 with an avoidance method that senses velocities."""
    @property
    def error(self) -> tuple[float, float]:
        """Front point minus its target by the robot's role, m."""
    @property
    def desired_velocity(self) -> tuple[float, float]:
        """Velocity of that target half a period after the sample, m/s."""
    @property
    def period_s(self) -> float:
        """Control period, s."""

def resilient_mean(own: float, values: Sequence[float], liars_max: int) -> float:
    """See phalanx.resilient.w_msr."""

def serve(law: type, brief: str, incarnation: int, realtime_priority: bool) -> int: ...
def serve_plant(plant: type, brief: str, realtime_priority: bool) -> int: ...

@final
class Episode:
    """One episode of an environment: see phalanx.env."""

    def __new__(
        cls,
        scenario: str | os.PathLike[str],
        set: Sequence[str],
        faults: Sequence[str],
        seed: int | None,
        robots: Sequence[str] | None,
        twists: bool,
    ) -> Episode:
        """Creates an episode of a scenario with these assignments and faults, before its first step."""
    @property
    def robots(self) -> list[tuple[str, float, int]]:
        """Name, front_point_m and number of in-neighbors of each robot whose actions come from Python."""
    @property
    def period_s(self) -> float: ...
    @property
    def speed_max_m_s(self) -> float:
        """Speed limit; infinite if the avoidance method has none."""
    @property
    def distance_min_m(self) -> float:
        """Smallest distance d between two front points that the scenario allows, m."""
    @property
    def walls(self) -> list[tuple[list[tuple[float, float]], float]]:
        """The convex parts of walls and obstacles: corners in m, and a radius in m that is 0 for polygons. A disc
        has one corner, its center."""
    @property
    def seed(self) -> int: ...
    @property
    def is_over(self) -> bool: ...
    @property
    def trajectory_hash(self) -> str: ...
    def situation(self, robot: str) -> Situation | None:
        """Returns the current input of a robot's law; None if it has no reference or its process does not take part."""
    def outbox(self, robot: str) -> Outbox:
        """What a robot whose actions come from Python sends with its next answer."""
    def bodies(self) -> list[tuple[str, float, float, float, float, bool]]:
        """Returns name, x in m, y in m, heading in rad, front_point_m, and whether its process is alive, of every
        robot in scenario order."""
    def is_gone(self, robot: str) -> bool:
        """Returns whether a robot was killed and will not be restarted."""
    def step(self, actions: Sequence[tuple[str, tuple[float, float]]]) -> None:
        """Applies the actions and advances one period. Robots without an action stop."""
