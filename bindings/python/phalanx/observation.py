"""Inputs of a robot as a list of numbers of fixed length: for policies, in training and in processes."""

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
    """A robot's observation: 11 numbers of its own, 8 of each in-neighbor and 3 of each robot in sensing range.

    The same object converts the situations of an environment, the input of a ``Law`` and the input of a
    ``Controller``: a policy gets the same numbers in a process as in training. All are SI, and vectors are in
    ``map``. ``names`` has the name of each number:

    ====================== =================================================================================
    ``known``              1; 0 if the robot has no reference, and all other numbers are then 0 too
    ``error_*``            front point minus its target by the role, m
    ``desired_velocity_*`` velocity of that target, m/s
    ``front_point_*``      own front point, m
    ``heading_*``          cosine and sine of the heading
    ``v_m_s``, ``w_rad_s`` own twist
    ``neighbor1_*``, ...   in-neighbors, in scenario order: contact (1 fresh, 0.5 stale, 0 lost or none),
                           front point relative to the own one, m, velocity, m/s, desired position
                           relative to the neighbor, m, and age of the newest beacon, s
    ``near1_*``, ...       robots in sensing range, nearest first: 1 if there is one, and its front point
                           relative to the own one, m
    ====================== =================================================================================

    Further neighbors and robots are left out.
    """

    def __init__(self, neighbors: int, near: int) -> None:
        """Creates observations with room for these numbers of in-neighbors and robots in sensing range."""
        if neighbors < 0 or near < 0:
            raise ValueError(f"neighbors is {neighbors} and near is {near}; both must be 0 or more")
        self.neighbors = neighbors
        self.near = near
        self.names: tuple[str, ...] = (
            *_OWN,
            *(f"neighbor{i + 1}_{name}" for i in range(neighbors) for name in _NEIGHBOR),
            *(f"near{i + 1}_{name}" for i in range(near) for name in _NEAR),
        )

    def __len__(self) -> int:
        """Returns the number of numbers."""
        return len(self.names)

    def __call__(
        self, seen: Situation | Odometry | None, neighbors: Sequence[Neighbor] | None = None
    ) -> list[float]:
        """Returns the numbers of a situation, or of a controller's odometry and neighbors; zeros for ``None``."""
        if seen is None:
            return [0.0] * len(self.names)
        if neighbors is None:
            if isinstance(seen, Odometry):
                raise TypeError("an observation of odometry needs the neighbors as a second argument")
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
        for there_x, there_y in (seen.near or [])[: self.near]:
            numbers += [1.0, there_x - x, there_y - y]
        numbers += [0.0] * (len(self.names) - len(numbers))
        return numbers
