"""A scenario as a PettingZoo environment, for training: ``phalanx.parallel_env``."""

from __future__ import annotations

import copy
import math
import os
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pettingzoo import ParallelEnv  # type: ignore[import-untyped]

from ._phalanx import Episode, Situation
from .observation import Observation
from .runs import assignments
from .top_view import TopView

__all__ = ["LockstepEnv"]

Array = NDArray[np.float64]

_Call = tuple[str, str, tuple[Any, ...], dict[str, Any]]
"""Agent, method of its outbox, arguments, and keyword arguments."""

_TRAIL_S = 5.0
"""Length of the trails in a picture, s."""
_TRAIL_POINTS = 100
"""Maximum number of points of a trail."""


class LockstepEnv(ParallelEnv[str, Array, Array]):
    """A scenario in lockstep, in this process, as a parallel environment. See ``phalanx.parallel_env``."""

    metadata: dict[str, Any] = {
        "name": "phalanx_v0",
        "render_modes": ["rgb_array"],
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: str | os.PathLike[str],
        *,
        action: Literal["velocity", "twist"] = "velocity",
        agents: Sequence[str] | None = None,
        near: int = 4,
        faults: Sequence[str] = (),
        render_mode: Literal["rgb_array"] | None = None,
        **overrides: Any,
    ) -> None:
        """See ``phalanx.parallel_env``."""
        if action not in ("velocity", "twist"):
            raise ValueError(f"action is {action!r}, expected 'velocity' or 'twist'")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(
                f"render_mode is {render_mode!r}, expected 'rgb_array' or None; "
                "`phalanx run --view` shows a run in the browser"
            )
        self.render_mode = render_mode
        self.scenario = os.fspath(scenario)
        self.action = action
        self._chosen = None if agents is None else list(agents)
        self._near = near
        self._overrides = overrides
        self._faults = list(faults)
        self._episode_overrides: Mapping[str, Any] = {}
        self._actions: list[list[tuple[str, tuple[float, float]]]] = []
        #: Calls of publish, withhold and target before each step, and before the next one.
        self._sent: list[list[_Call]] = []
        self._to_send: list[_Call] = []
        self._episode = self._begin({}, None)
        self._seed = self._episode.seed
        self._was_reset = False
        robots = self._episode.robots
        self.possible_agents = [name for name, _, _ in robots]
        self.agents: list[str] = []
        #: Converts situations to observations, also for a policy that is a robot's law.
        self.observation = Observation(max((heard for _, _, heard in robots), default=0), near)
        self._observation_spaces = {
            name: Box(-np.inf, np.inf, (len(self.observation),), np.float64) for name, _, _ in robots
        }
        self.state_space = Box(
            -np.inf, np.inf, (len(robots) * len(self.observation),), np.float64
        )
        #: Metadata of the class, and ``render_fps``: pictures per second of run time, one for each step.
        self.metadata = {**type(self).metadata, "render_fps": max(1, round(1.0 / self.period_s))}
        speed = self._episode.speed_max_m_s
        self._action_spaces = {}
        for name, front_point_m, _ in robots:
            high = [speed, speed if action == "velocity" else speed / front_point_m]
            self._action_spaces[name] = Box(-np.array(high), np.array(high), (2,), np.float64)
        self._start_picture()

    def __getstate__(self) -> dict[str, Any]:
        """Returns the state for pickling, which restores the environment at the same step: arguments, seed and actions."""
        return {
            "scenario": os.path.abspath(self.scenario),
            "arguments": {
                "action": self.action,
                "agents": self._chosen,
                "near": self._near,
                "faults": self._faults,
                "render_mode": self.render_mode,
                **self._overrides,
            },
            "seed": self._seed,
            "was_reset": self._was_reset,
            "episode_overrides": self._episode_overrides,
            "actions": [list(actions) for actions in self._actions],
            "sent": [list(calls) for calls in [*self._sent, self._to_send]],
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Restores the environment by computing the episode again up to the same step, bit by bit the same."""
        self.__init__(state["scenario"], **state["arguments"])  # type: ignore[misc]
        self._seed = state["seed"]
        if not state["was_reset"]:
            return
        self.reset(seed=self._seed, options={"overrides": state["episode_overrides"]})
        for actions, calls in zip(state["actions"], state["sent"]):
            self._call_again(calls)
            self.step(dict(actions))
        self._call_again(state["sent"][-1])

    def _call_again(self, calls: list[_Call]) -> None:
        for agent, method, arguments, keywords in calls:
            self._call(agent, method, arguments, keywords)

    def _call(
        self, agent: str, method: str, arguments: tuple[Any, ...], keywords: dict[str, Any]
    ) -> None:
        getattr(self._episode.outbox(agent), method)(*arguments, **keywords)
        self._to_send.append((agent, method, copy.deepcopy(arguments), copy.deepcopy(keywords)))

    def publish(self, agent: str, data: bytes | None = None, /, **arrays: Any) -> None:
        """Sends a message of an agent to its out-neighbors with the beacon of the next step, as ``Law.publish``."""
        self._call(agent, "publish", () if data is None else (data,), arrays)

    def withhold(self, agent: str) -> None:
        """Sends no beacon of an agent with the next step, as ``Law.withhold``."""
        self._call(agent, "withhold", (), {})

    def target(
        self, agent: str, position: Sequence[float], velocity: Sequence[float] = (0.0, 0.0)
    ) -> None:
        """Names where a free agent is to be, as ``Law.target``. Its reward after the next step goes by it."""
        self._call(agent, "target", (tuple(position), tuple(velocity)), {})

    def _begin(self, more: Mapping[str, Any], seed: int | None) -> Episode:
        # Expectations are not evaluated in an episode.
        arguments = ["expect={}", *assignments(self._overrides), *assignments(more)]
        twists = self.action == "twist"
        return Episode(self.scenario, arguments, self._faults, seed, self._chosen, twists)

    def observation_space(self, agent: str) -> Box:
        """Returns the observation space, equal for all agents: as many unbounded numbers as ``observation`` has names."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Returns the action space: two numbers within the scenario's ``speed_max_m_s``, a velocity or a twist."""
        return self._action_spaces[agent]

    @property
    def period_s(self) -> float:
        """Duration of a step, s: the scenario's ``period_s``."""
        return self._episode.period_s

    @property
    def trajectory_hash(self) -> str:
        """Hash of the motion of all robots. At the end of an episode it equals that of a ``phalanx run --pace lockstep``
        with the same commands."""
        return self._episode.trajectory_hash

    def situation(self, agent: str) -> Situation | None:
        """Returns the current input of a law; ``None`` if a law would not be called."""
        return self._episode.situation(agent)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Starts a new episode, with all robots at their start poses.

        ``seed`` replaces the scenario's ``seed``, from which noise and faults are drawn: episodes with
        the same seed and actions are the same bit by bit. By default the first episode has the scenario's own
        seed, and each further one the next higher number. ``options["overrides"]``: keys of the scenario for this episode
        only, such as ``{"robot": {"r1": {"pose": {"x_m": 0.3}}}}``.
        """
        if seed is not None:
            self._seed = seed
        elif self._was_reset:
            self._seed += 1
        overrides = (options or {}).get("overrides", {})
        self._episode = self._begin(overrides, self._seed)
        self._was_reset = True
        self._episode_overrides = overrides
        self._actions = []
        self._sent, self._to_send = [], []
        self.agents = list(self.possible_agents)
        self._start_picture()
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
        """Applies the actions of all agents and advances one period.

        An agent's reward is minus its error in m times the period in s, at the new sample: over an episode,
        minus the integral of the error. It is 0 while the agent has no reference. An agent that a fault
        kills without a restart is terminated; all others are truncated when the scenario's ``duration_s`` is over.
        If no agent is left, nothing happens.

        Raises ``gymnasium.error.ResetNeeded`` before the first ``reset``, and ``ValueError`` if an agent has no
        action or one that is not two finite numbers.
        """
        if not self._was_reset:
            raise ResetNeeded("step was called before reset: call reset first")
        now = self.agents
        checked = [(name, self._check_action(name, actions)) for name in now]
        self._episode.step(checked)
        if now:
            self._actions.append(checked)
            self._sent.append(self._to_send)
            self._to_send = []
        if self.render_mode is not None:
            self._extend_trails()
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

    def _check_action(self, agent: str, actions: Mapping[str, Array]) -> tuple[float, float]:
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

    def state(self) -> Array:
        """Returns the observations of all agents, in the order of ``possible_agents``, as one array."""
        return np.concatenate([self._observe(name) for name in self.possible_agents])

    def _start_picture(self) -> None:
        """Creates the picture of an episode, without trails, with space for the starts and the walls."""
        bodies = self._episode.bodies()
        self._view = TopView()
        self._trails: list[deque[tuple[float, float]]] = [
            deque(maxlen=_TRAIL_POINTS) for _ in bodies
        ]
        self._trail_every = max(1, round(_TRAIL_S / _TRAIL_POINTS / self.period_s))
        for corners, radius_m in self._episode.walls:
            for x, y in corners:
                self._view.include([(x - radius_m, y - radius_m), (x + radius_m, y + radius_m)])
        if self.render_mode is not None:
            self._extend_trails()

    def _extend_trails(self) -> None:
        """Adds the current front points to the trails and the shown area, if another point is due."""
        if len(self._actions) % self._trail_every:
            return
        for trail, (name, x, y, heading, ahead, _) in zip(self._trails, self._episode.bodies()):
            front = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
            trail.append(front)
            wanted = self._desired_point(name)
            self._view.include([front] if wanted is None else [front, wanted])

    def _desired_point(self, robot: str) -> tuple[float, float] | None:
        """Returns the target of an agent's front point, m; ``None`` for other robots and if it is unknown."""
        seen = self._episode.situation(robot) if robot in self._action_spaces else None
        if seen is None:
            return None
        return seen.front_point[0] - seen.error[0], seen.front_point[1] - seen.error[1]

    def render(self) -> NDArray[np.uint8] | None:
        """Returns a picture of all robots from above, 480 by 480 pixels of red, green and blue.

        It has walls, trails of 5 s, a cross at the desired point of each agent, and a ring of radius d/2 around each front
        point. Dead robots are gray. ``None``, with a warning, if ``render_mode`` is not ``"rgb_array"``.
        """
        if self.render_mode is None:
            logger.warn("render was called without a render_mode: parallel_env(..., render_mode='rgb_array')")
            return None
        bodies = self._episode.bodies()
        wanted = [self._desired_point(name) for name, *_ in bodies]
        return self._view.draw(
            [(x, y, heading, ahead, alive) for _, x, y, heading, ahead, alive in bodies],
            wanted,
            [list(trail) for trail in self._trails],
            self._episode.walls,
            self._episode.distance_min_m,
        )

    def close(self) -> None:
        """Does nothing: the environment has no external resources."""
