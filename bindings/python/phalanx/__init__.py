"""Decentralized multi-robot experiments in which every robot is a process: laws, controllers and plants in Python.

A law is a class with a method ``gamma``; a file that ends in ``phalanx.serve(MyLaw)`` is a robot's program,
which a scenario names under ``[laws.NAME]`` and ``phalanx run`` starts::

    import phalanx
    from phalanx.real import tanh

    class Tanh(phalanx.Law):
        def gamma(self, situation):
            (ex, ey), (vx, vy) = situation.error, situation.desired_velocity
            return -self.k_f_m_s * tanh(ex) + vx, -self.k_f_m_s * tanh(ey) + vy

    phalanx.serve(Tanh)

All quantities are SI; positions and velocities are ``(x, y)`` in the frame ``map``, headings
counter-clockwise from x.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from . import _phalanx, real
from ._phalanx import Neighbor, Odometry, Pose, Situation, Twist, __version__
from .campaigns import Campaign, sweep
from .hunts import Hunt, hunt
from .observation import Observation
from .plant import Limits, Plant, Robot, Wheels
from .runs import Figure, Run, RunError, load, run

__all__ = [
    "Campaign",
    "Controller",
    "Figure",
    "Hunt",
    "Law",
    "Limits",
    "Neighbor",
    "Observation",
    "Odometry",
    "Plant",
    "Pose",
    "Robot",
    "Run",
    "RunError",
    "Situation",
    "Twist",
    "Wheels",
    "__version__",
    "hunt",
    "load",
    "parallel_env",
    "real",
    "run",
    "serve",
    "sweep",
]

if TYPE_CHECKING:
    from .env import LockstepEnv


# By this variable a process knows that it belongs to a run.
_RUN = "PHALANX_RUN"


def _take_words(argv: list[str]) -> list[str] | None:
    """Takes the words off the end of a command line that ``phalanx run`` adds to it, and returns them.

    What is left is the program's own: its arguments in the scenario. ``None`` if a run has not started it.
    """
    end = len(argv)
    if argv[-1:] == ["--realtime-priority"]:
        end -= 1
    begin = end - (3 if argv[end - 2 : end - 1] == ["--incarnation"] else 1)
    is_brief = begin > 0 and os.path.basename(os.path.dirname(argv[begin])) == "briefs"
    if _RUN not in os.environ or not is_brief:
        return None
    words = argv[begin:]
    del argv[begin:]
    return words


_WORDS = _take_words(sys.argv)


class _WithGains:
    def __init__(self, **gains: float) -> None:
        """Called once for every process, with the robot's gains by the keys of ``[laws.NAME] gains``.

        They become attributes of the same names.
        """
        for key, value in gains.items():
            setattr(self, key, value)


class Law(_WithGains):
    """A control law: from what a robot knows to the velocity that its front point is to have.

    It may keep state. The process of a robot that died is replaced by a new one, whose law begins anew.
    Distances are kept after the law, by the scenario's avoidance method, whatever the law says.
    """

    def gamma(self, situation: Situation) -> tuple[float, float]:
        """The nominal velocity of the front point, ``(x, y)`` in m/s, in ``map``.

        Asked once for every odometry sample, in their order, but not while the robot has nothing to go
        by (nobody that it hears was heard yet). Any sequence of two finite numbers will do; anything
        else, and any exception, ends the process.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method gamma(self, situation)")


class Controller(_WithGains):
    """One level lower than a law: from what a robot knows to the twist of its body.

    For predictive control or a trained policy. The avoidance method bounds the twist and leads around
    nobody; the velocity that the twist gives the front point is what other robots are told.
    """

    def twist(
        self, odometry: Odometry, neighbors: list[Neighbor], t_s: float
    ) -> tuple[float, float]:
        """The twist ``(v, w)``: forward speed in m/s, turn rate in rad/s, counter-clockwise.

        ``t_s`` is the time since the run's start, in s. Asked as ``Law.gamma`` is.
        """
        raise NotImplementedError(
            f"{type(self).__name__} has no method twist(self, odometry, neighbors, t_s)"
        )


def serve(part: type[Law] | type[Controller] | type[Plant]) -> NoReturn:
    """Makes this process what its command line names: a robot with a law or controller of this class, or what
    moves all robots.

    To be called at the end of a program that a scenario names: ``phalanx run`` adds the arguments. It
    returns never: the process ends with the run (exit code 0), with the law (1), or for want of anything
    else that it needs (4), as with a plant that fails.

    Arguments of the program's own, as in ``program = ["python3", "law.py", "--model", "m.pt"]``, are in ``sys.argv`` as
    ever: ``import phalanx`` has taken those that ``phalanx run`` adds off its end.
    """
    if not (isinstance(part, type) and issubclass(part, (Law, Controller, Plant))):
        raise TypeError(
            "phalanx.serve takes a class derived from phalanx.Law, phalanx.Controller or phalanx.Plant, "
            f"not {part!r}"
        )
    import argparse

    moves = issubclass(part, Plant)
    table = "[plant]" if moves else "[laws.NAME]"
    parser = argparse.ArgumentParser(
        description=f"The plant {part.__name__}." if moves else f"A robot with the law {part.__name__}.",
        epilog=f'`phalanx run SCENARIO` starts it, where the scenario names it: {table} program = ["python3", "..."].',
    )
    parser.add_argument("brief", nargs="?", help="what it is to be, from the run's directory")
    if not moves:
        parser.add_argument(
            "--incarnation", type=int, default=0, help="how often it was started before"
        )
    parser.add_argument(
        "--realtime-priority", action="store_true", help="run before every ordinary process"
    )
    words = parser.parse_args(_WORDS)
    if words.brief is None:
        file = os.path.basename(sys.argv[0]) or "my_law.py"
        parser.exit(
            2,
            f"{file} does nothing by itself: a scenario runs it, with odometry, neighbors and a clock. Name it in the scenario,\n\n"
            f'    {table}\n    program = ["python3", "{file}"]\n\n'
            "beside which it lies, and run that: phalanx run SCENARIO\n",
        )
    if moves:
        sys.exit(_phalanx.serve_plant(part, words.brief, words.realtime_priority))
    sys.exit(_phalanx.serve(part, words.brief, words.incarnation, words.realtime_priority))


def parallel_env(
    scenario: str | os.PathLike[str],
    *,
    action: Literal["velocity", "twist"] = "velocity",
    agents: Sequence[str] | None = None,
    near: int = 4,
    faults: Sequence[str] = (),
    render_mode: Literal["rgb_array"] | None = None,
    **overrides: Any,
) -> LockstepEnv:
    """A scenario as a parallel environment of PettingZoo, for training.

    The world, the sensors, the links, the faults and the guard are those of ``phalanx run --pace lockstep``, bit
    by bit, and so is what an agent knows. But this is no deployment: all robots are in this process, with
    the world they are in, and nobody can be late, lost or killed but by the plan. What was trained here is to
    be run as a ``Law`` or ``Controller``, in processes.

    ``action``: what an agent answers with, two numbers within the scenario's ``speed_max_m_s``.
    ``"velocity"``: the velocity of its front point, (x, y) in m/s in ``map``, as a ``Law`` answers;
    ``"twist"``: (v, w) in m/s and rad/s, as a ``Controller`` answers. Either enters the avoidance method. The
    action of an agent that has nothing to go by yet has no effect, as in a run, where no law is asked then.

    ``agents``: which robots are agents; without, all. The others have their laws, which must be built in. The
    program of an agent's law is not started: the law says only what the robot's role is.

    Observations are ``Observation``s with room for everybody that some agent hears and for ``near`` robots
    sensed near. Rewards: see ``LockstepEnv.step``. ``faults`` and ``overrides`` change the scenario, as those of
    ``phalanx.run``: ``faults=["kill r2 @1 restart 2"]``, ``duration_s=5.0``. A robot that is killed and restarted
    observes zeros meanwhile.

    ``render_mode="rgb_array"``: ``render`` returns pictures as arrays. An environment can be copied and pickled at any
    step, and goes on from there bit by bit: the wrappers of SuperSuit, which Stable-Baselines3 needs, do so.

    Raises ``ValueError`` with the diagnostic of ``phalanx check`` if the scenario is wrong, and ``ImportError``
    without pettingzoo, gymnasium and numpy.
    """
    try:
        from .env import LockstepEnv
    except ImportError as error:
        raise ImportError(
            f"phalanx.parallel_env needs more packages ({error}): pip install pettingzoo gymnasium numpy"
        ) from error
    return LockstepEnv(
        scenario,
        action=action,
        agents=agents,
        near=near,
        faults=faults,
        render_mode=render_mode,
        **overrides,
    )
