"""What a robot knows, as a list of numbers of fixed length: for policies, in training and in processes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ._phalanx import Neighbor, Odometry, Situation

__all__ = ["Observation"]

_OWN = (
    "known",
    "error_x_m",
    "error_y_m",
    "desired_velocity_x_m_s",
    "desired_velocity_y_m_s",
    "front_point_x_m",
    "front_point_y_m",
    "heading_cos",
    "heading_sin",
    "v_m_s",
    "w_rad_s",
)
_NEIGHBOR = ("contact", "x_m", "y_m", "vx_m_s", "vy_m_s", "offset_x_m", "offset_y_m", "age_s")
_NEAR = ("is_there", "x_m", "y_m")
_CONTACTS = {"fresh": 1.0, "stale": 0.5, "lost": 0.0}


class Observation:
    """A robot's observation: 11 numbers of its own, 8 of each neighbour heard and 3 of each robot near.

    The same object makes them of an environment's situations, of those that a ``Law`` is asked with, and of
    what a ``Controller`` is asked with: a policy sees in a process what it saw in training. All are SI, and
    vectors are in ``map``. ``names`` has what each number is:

    ====================== =================================================================================
    ``known``              1; 0 where the robot has nothing to go by, and all others are 0 too
    ``error_*``            own front point minus where the role wants it, m
    ``desired_velocity_*`` the velocity of that place, m/s
    ``front_point_*``      own front point, m
    ``heading_*``          cosine and sine of the heading
    ``v_m_s``, ``w_rad_s`` own twist
    ``neighbor1_*``, ...   of those heard so far, in scenario order: contact (1 fresh, 0.5 stale, 0 lost or none),
                           front point as seen from the own one, m, its velocity, m/s, where to stand as seen
                           from it, m, and the age of what is known, s
    ``near1_*``, ...       of the robots sensed near, nearest first: 1 where there is one, and its front point as
                           seen from the own one, m
    ====================== =================================================================================

    What there is more of than there is room for is left out.
    """

    def __init__(self, neighbors: int, near: int) -> None:
        """With room for so many neighbours and robots near."""
        if neighbors < 0 or near < 0:
            raise ValueError(f"there is no room for {neighbors} neighbors and {near} near")
        self.neighbors = neighbors
        self.near = near
        self.names: tuple[str, ...] = (
            *_OWN,
            *(f"neighbor{i + 1}_{name}" for i in range(neighbors) for name in _NEIGHBOR),
            *(f"near{i + 1}_{name}" for i in range(near) for name in _NEAR),
        )

    def __len__(self) -> int:
        """How many numbers it is."""
        return len(self.names)

    def __call__(
        self, seen: Situation | Odometry | None, neighbors: Sequence[Neighbor] | None = None
    ) -> list[float]:
        """The numbers of a situation, or of a controller's odometry and neighbours; of ``None``, zeros."""
        if seen is None:
            return [0.0] * len(self.names)
        if neighbors is None:
            if isinstance(seen, Odometry):
                raise TypeError("an observation of odometry needs the neighbors beside it")
            neighbors = seen.neighbors
        pose, twist = seen.pose, seen.twist
        x, y = seen.front_point
        heading = pose.heading_rad
        numbers = [1.0, *seen.error, *seen.desired_velocity, x, y]
        numbers += [math.cos(heading), math.sin(heading), twist.v_m_s, twist.w_rad_s]
        for heard in neighbors[: self.neighbors]:
            there_x, there_y = heard.position
            numbers += [_CONTACTS[heard.contact], there_x - x, there_y - y]
            numbers += [*heard.velocity, *heard.offset, heard.age_s]
        numbers += [0.0] * (len(_OWN) + len(_NEIGHBOR) * self.neighbors - len(numbers))
        for there_x, there_y in seen.near[: self.near]:
            numbers += [1.0, there_x - x, there_y - y]
        numbers += [0.0] * (len(self.names) - len(numbers))
        return numbers
