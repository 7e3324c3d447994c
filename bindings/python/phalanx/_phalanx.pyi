"""What a robot knows at one odometry sample. SI; positions and velocities are (x, y) in the frame map."""

import os
from collections.abc import Sequence
from types import ModuleType
from typing import Literal, final

__all__ = ["Episode", "serve", "serve_plant", "Neighbor", "Odometry", "Pose", "Situation", "Twist", "__version__", "real"]

__version__: str

real: ModuleType
"""See phalanx.real."""

@final
class Pose:
    """A pose of the middle of the axle, in map."""

    @property
    def x_m(self) -> float: ...
    @property
    def y_m(self) -> float: ...
    @property
    def heading_rad(self) -> float:
        """Counter-clockwise from x, in (-pi, pi]."""

@final
class Twist:
    """A twist of the body."""

    @property
    def v_m_s(self) -> float:
        """Forward speed, m/s."""
    @property
    def w_rad_s(self) -> float:
        """Turn rate, rad/s, counter-clockwise."""

@final
class Neighbor:
    """What is known of one robot that was heard."""

    @property
    def name(self) -> str: ...
    @property
    def position(self) -> tuple[float, float]:
        """Its front point, m: extrapolated by its velocity to the sample; of a lost robot, to the moment at
        which it was given up."""
    @property
    def velocity(self) -> tuple[float, float]:
        """The velocity that it publishes, m/s; zero once it is lost."""
    @property
    def offset(self) -> tuple[float, float]:
        """Where to stand as seen from it, m: turned and scaled as the formation is now. (20)"""
    @property
    def offset_velocity(self) -> tuple[float, float]:
        """How the offset changes, m/s. (22)"""
    @property
    def age_s(self) -> float:
        """How old its newest beacon is, s; in real time below 0 for one that is newer than the sample."""
    @property
    def contact(self) -> Literal["fresh", "stale", "lost"]:
        """How well it is heard."""

@final
class Situation:
    """One instant as a law sees it."""

    @property
    def error(self) -> tuple[float, float]:
        """Own front point minus where the robot's role wants it, m. (13) (32)"""
    @property
    def desired_velocity(self) -> tuple[float, float]:
        """The velocity of the place that the role wants, m/s."""
    @property
    def pose(self) -> Pose: ...
    @property
    def front_point(self) -> tuple[float, float]:
        """Own front point, m."""
    @property
    def twist(self) -> Twist:
        """Own twist in force at the sample."""
    @property
    def near(self) -> list[tuple[float, float]]:
        """Front points of the robots sensed near, m, nearest first."""
    @property
    def t_s(self) -> float:
        """Time since the run's start, s."""
    @property
    def period_s(self) -> float:
        """Time from one answer to the next, s."""
    @property
    def neighbors(self) -> list[Neighbor]:
        """Whoever of those that it hears was heard at least once; the lost are among them."""

@final
class Odometry:
    """What a robot senses and where it is to be, for a controller."""

    @property
    def pose(self) -> Pose: ...
    @property
    def twist(self) -> Twist:
        """The twist in force at the sample."""
    @property
    def front_point(self) -> tuple[float, float]:
        """Own front point, m."""
    @property
    def front_point_m(self) -> float:
        """How far the front point lies ahead of the axle, m."""
    @property
    def near(self) -> list[tuple[float, float]]:
        """Front points of the robots sensed near, m, nearest first."""
    @property
    def error(self) -> tuple[float, float]:
        """Own front point minus where the robot's role wants it, m."""
    @property
    def desired_velocity(self) -> tuple[float, float]:
        """The velocity of the place that the role wants, m/s."""
    @property
    def period_s(self) -> float:
        """Time from one answer to the next, s."""

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
        """The scenario with these assignments and faults, at its start."""
    @property
    def robots(self) -> list[tuple[str, float, int]]:
        """Name, front_point_m and number of in-neighbours of each robot whose actions come from outside."""
    @property
    def period_s(self) -> float: ...
    @property
    def speed_max_m_s(self) -> float:
        """Infinite where the avoidance method has no limit."""
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
        """What this robot knows now; None if it has nothing to go by, or does not take part."""
    def bodies(self) -> list[tuple[str, float, float, float, float, bool]]:
        """Returns name, x in m, y in m, heading in rad, front_point_m, and whether its process is alive, of every
        robot in scenario order."""
    def is_gone(self, robot: str) -> bool:
        """Whether it was killed, and nothing restarts it."""
    def step(self, actions: Sequence[tuple[str, tuple[float, float]]]) -> None:
        """Everybody acts, and a period passes."""
