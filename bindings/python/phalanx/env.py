"""A scenario as an environment of PettingZoo, for training: ``phalanx.parallel_env``."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pettingzoo import ParallelEnv  # type: ignore[import-untyped]

from ._phalanx import Episode, Situation
from .observation import Observation
from .runs import assignments

__all__ = ["LockstepEnv"]

Array = NDArray[np.float64]


class LockstepEnv(ParallelEnv[str, Array, Array]):
    """A scenario in lockstep, in this process, as a parallel environment. See ``phalanx.parallel_env``."""

    metadata = {"name": "phalanx_v0", "render_modes": []}

    def __init__(
        self,
        scenario: str | os.PathLike[str],
        *,
        action: Literal["velocity", "twist"] = "velocity",
        agents: Sequence[str] | None = None,
        near: int = 4,
        faults: Sequence[str] = (),
        **overrides: Any,
    ) -> None:
        """See ``phalanx.parallel_env``."""
        if action not in ("velocity", "twist"):
            raise ValueError(f"action is {action!r}, expected 'velocity' or 'twist'")
        self.scenario = os.fspath(scenario)
        self.action = action
        self._chosen = None if agents is None else list(agents)
        self._overrides = overrides
        self._faults = list(faults)
        self._episode = self._begin({}, None)
        self._seed = self._episode.seed
        self._was_reset = False
        robots = self._episode.robots
        self.possible_agents = [name for name, _, _ in robots]
        self.agents: list[str] = []
        #: Makes the observations of situations, also where the policy is a robot's law.
        self.observation = Observation(max((heard for _, _, heard in robots), default=0), near)
        self._observation_spaces = {
            name: Box(-np.inf, np.inf, (len(self.observation),), np.float64) for name, _, _ in robots
        }
        speed = self._episode.speed_max_m_s
        self._action_spaces = {}
        for name, front_point_m, _ in robots:
            high = [speed, speed if action == "velocity" else speed / front_point_m]
            self._action_spaces[name] = Box(-np.array(high), np.array(high), (2,), np.float64)

    def _begin(self, more: Mapping[str, Any], seed: int | None) -> Episode:
        # Nobody judges an episode.
        words = ["expect={}", *assignments(self._overrides), *assignments(more)]
        twists = self.action == "twist"
        return Episode(self.scenario, words, self._faults, seed, self._chosen, twists)

    def observation_space(self, agent: str) -> Box:
        """Of every agent the same: any numbers, as many as ``observation`` has names."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Two numbers within the scenario's ``speed_max_m_s``: a velocity, or a twist."""
        return self._action_spaces[agent]

    @property
    def period_s(self) -> float:
        """Time from one step to the next, s: the scenario's ``period_s``."""
        return self._episode.period_s

    @property
    def trajectory_hash(self) -> str:
        """The hash of all bodies' motion so far: at an episode's end that of ``phalanx run --pace lockstep``
        whose robots wanted the same."""
        return self._episode.trajectory_hash

    def situation(self, agent: str) -> Situation | None:
        """What a law would be asked with now; ``None`` where it would not be asked."""
        return self._episode.situation(agent)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Puts everybody back to the start.

        ``seed`` takes the place of the scenario's ``seed``, of which noise and faults are drawn: episodes with
        the same seed and actions are the same bit by bit. Without it the first episode has the scenario's own,
        and each further one the next higher. ``options["overrides"]``: keys of the scenario for this episode
        alone, such as ``{"robot": {"r1": {"pose": {"x_m": 0.3}}}}``.
        """
        if seed is not None:
            self._seed = seed
        elif self._was_reset:
            self._seed += 1
        self._was_reset = True
        self._episode = self._begin((options or {}).get("overrides", {}), self._seed)
        self.agents = list(self.possible_agents)
        return {name: self._observe(name) for name in self.agents}, {name: {} for name in self.agents}

    def step(
        self, actions: Mapping[str, Array]
    ) -> tuple[
        dict[str, Array],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """All agents act, and one period passes.

        An agent's reward is minus its error in m times the period in s, at the new sample: over an episode,
        minus the integral of the error. It is 0 while the agent has nothing to go by. An agent that a fault
        kills for good is terminated; all others are truncated when the scenario's ``duration_s`` is over.
        """
        now = self.agents
        self._episode.step([(name, self._checked(name, actions)) for name in now])
        is_over = self._episode.is_over
        observations, rewards = {}, {}
        for name in now:
            seen = self._episode.situation(name)
            observations[name] = np.array(self.observation(seen))
            rewards[name] = -self.period_s * math.hypot(*seen.error) if seen else 0.0
        terminations = {name: self._episode.is_gone(name) for name in now}
        truncations = {name: is_over for name in now}
        self.agents = [name for name in now if not (is_over or terminations[name])]
        return observations, rewards, terminations, truncations, {name: {} for name in now}

    def _observe(self, agent: str) -> Array:
        return np.array(self.observation(self._episode.situation(agent)))

    def _checked(self, agent: str, actions: Mapping[str, Array]) -> tuple[float, float]:
        if agent not in actions:
            raise ValueError(f"there is no action of {agent}")
        try:
            if isinstance(actions[agent], (str, bytes, bytearray, Mapping)):
                raise TypeError
            first, second = actions[agent]
            return float(first), float(second)
        except (TypeError, ValueError):
            raise ValueError(
                f"the action of {agent} is {actions[agent]!r}, expected two numbers"
            ) from None

    def render(self) -> None:
        """Draws nothing: ``phalanx run --view`` shows the policy's robots."""

    def close(self) -> None:
        """Frees nothing: all is in this process."""
