"""Decentralized multi-robot experiments with a process for each robot: laws, controllers and plants in Python.

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

from . import _phalanx, real, resilient
from ._phalanx import InNeighbor, Neighbor, Odometry, Outbox, OwnRobot, Pose, Situation, Twist, __version__
from .campaigns import Campaign, sweep
from .hunts import Hunt, hunt
from .observation import Observation
from .plant import Limits, Plant, Robot, Wheels
from .runs import Figure, Run, RunError, load, print_metrics, run

__all__ = [
    "Campaign",
    "Controller",
    "Figure",
    "Hunt",
    "InNeighbor",
    "Law",
    "Limits",
    "Neighbor",
    "Observation",
    "Odometry",
    "OwnRobot",
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
    "print_metrics",
    "real",
    "resilient",
    "run",
    "serve",
    "sweep",
]

if TYPE_CHECKING:
    from .env import LockstepEnv


# Environment variable that is set in the processes of a run.
_RUN = "PHALANX_RUN"


def _take_run_arguments(argv: list[str]) -> list[str] | None:
    """Removes the arguments that ``phalanx run`` has added from the end of a command line, and returns them.

    The program's own arguments remain. Returns ``None`` if the program was not started by a run.
    """
    end = len(argv)
    if argv[-1:] == ["--realtime-priority"]:
        end -= 1
    begin = end - (3 if argv[end - 2 : end - 1] == ["--incarnation"] else 1)
    is_brief = begin > 0 and os.path.basename(os.path.dirname(argv[begin])) == "briefs"
    if _RUN not in os.environ or not is_brief:
        return None
    arguments = argv[begin:]
    del argv[begin:]
    return arguments


_RUN_ARGUMENTS = _take_run_arguments(sys.argv)


class _WithGains:
    robot: OwnRobot
    """The robot of this law, set before ``__init__`` runs."""
    _outbox: Outbox

    def __init__(self, **gains: float) -> None:
        """Called once in every process, with the robot's gains by the keys of ``[laws.NAME] gains``.

        Sets an attribute for each gain.
        """
        for key, value in gains.items():
            setattr(self, key, value)

    def publish(self, data: bytes | None = None, /, **arrays: Any) -> None:
        """Sends a message to the out-neighbors with the beacon of the present answer.

        Either all arrays that ``message`` in ``[laws.NAME]`` declares, as numbers or nested sequences of the declared
        shapes, or bytes if it has ``message_bytes_max``. A neighbor finds the newest message in
        ``Neighbor.message``; in lockstep one period later. Of several calls for one answer, the last one counts.
        Raises ``ValueError`` or ``TypeError`` if the message does not have the declared format.
        """
        self._outbox.publish(data, **arrays)

    def target(
        self, position: Sequence[float], velocity: Sequence[float] = (0.0, 0.0)
    ) -> None:
        """Names where the front point is to be, ``(x, y)`` in m, for the present answer; only with ``role = "free"``.

        Error, convergence, reward and the guard's arrival go by it. ``velocity``: velocity of that point, m/s. Without a
        call in an answer, the robot is not judged.
        """
        self._outbox.target(position, velocity)

    def record(self, **values: float) -> None:
        """Records values of signals that ``signals`` in ``[laws.NAME]`` declares: ``self.record(cost_m2=0.5)``.

        They are in ``signals.csv``, in the report and in the recording; ``[metrics]`` of the scenario may reduce them to
        numbers of the run. Of several values of a signal for one answer, the last one counts. Raises ``ValueError`` for
        a signal that is not declared and for a value that is no finite number.
        """
        self._outbox.record(**values)

    def withhold(self) -> None:
        """Sends no beacon with the present answer, as in event-triggered control; needs ``withholds = true``.

        Neighbors extrapolate the last beacon, whose age grows. Raises ``ValueError`` if the law does not declare it.
        """
        self._outbox.withhold()


class Law(_WithGains):
    """A control law: computes the desired velocity of a robot's front point from what the robot knows.

    It may have state. If the process of a robot is restarted, its law starts with new state. The scenario's
    avoidance method bounds the velocity afterwards, so the law need not keep distances.
    """

    def gamma(self, situation: Situation) -> tuple[float, float]:
        """Returns the nominal velocity of the front point, ``(x, y)`` in m/s, in ``map``.

        Called once for every odometry sample, in order, but not while the robot has no reference (no beacon of
        an in-neighbor was received yet). The result may be any sequence of two finite numbers; anything
        else, and any exception, ends the process.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method gamma(self, situation)")


class Controller(_WithGains):
    """A controller, one level lower than a law: computes the twist of the robot's body.

    Use it for predictive control or a trained policy. The avoidance method bounds the twist, but does not steer
    around other robots. The robot publishes the velocity that the twist gives its front point.
    """

    def twist(
        self, odometry: Odometry, neighbors: list[Neighbor], t_s: float
    ) -> tuple[float, float] | tuple[float, float, float]:
        """Returns the desired twist ``(v, w)``: forward speed in m/s, turn rate in rad/s, counter-clockwise.

        A robot with ``drive = "omni"`` needs ``(v, side, w)``; ``side`` is the lateral speed in m/s, to the left.

        ``t_s`` is the time since the start of the run, s. Called for the same samples as ``Law.gamma``.
        """
        raise NotImplementedError(
            f"{type(self).__name__} has no method twist(self, odometry, neighbors, t_s)"
        )


def serve(part: type[Law] | type[Controller] | type[Plant]) -> NoReturn:
    """Runs this process as a robot with a law or controller of this class, or as the plant.

    Call it at the end of a program that a scenario names: ``phalanx run`` adds the arguments. It never
    returns: the process ends with the run (exit code 0), if the law fails (1), or if a plant fails or a
    resource is missing (4).

    The program's own arguments, as in ``program = ["python3", "law.py", "--model", "m.pt"]``, are in ``sys.argv``:
    ``import phalanx`` has removed the arguments that ``phalanx run`` added at the end of it.
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
        epilog=f'`phalanx run SCENARIO` starts it if the scenario names it: {table} program = ["python3", "..."].',
    )
    parser.add_argument("brief", nargs="?", help="configuration file in the run directory")
    if not moves:
        parser.add_argument(
            "--incarnation", type=int, default=0, help="number of earlier starts"
        )
    parser.add_argument(
        "--realtime-priority", action="store_true", help="run with SCHED_FIFO priority"
    )
    arguments = parser.parse_args(_RUN_ARGUMENTS)
    if arguments.brief is None:
        file = os.path.basename(sys.argv[0]) or "my_law.py"
        parser.exit(
            2,
            f"{file} does nothing by itself: a scenario runs it, with odometry, neighbors and a clock. Name it in a scenario\n\n"
            f'    {table}\n    program = ["python3", "{file}"]\n\n'
            "in the same folder, and run the scenario: phalanx run SCENARIO\n",
        )
    if moves:
        sys.exit(_phalanx.serve_plant(part, arguments.brief, arguments.realtime_priority))
    sys.exit(_phalanx.serve(part, arguments.brief, arguments.incarnation, arguments.realtime_priority))


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
    """Returns a scenario as a PettingZoo parallel environment, for training.

    Plant, sensors, links, faults, guard and the inputs of an agent are those of ``phalanx run --pace lockstep``, bit by
    bit. But this is not a deployment: all robots and the plant are in this process, and a robot is late, lost or killed
    only if the scenario plans it. To deploy a trained policy, run it as a ``Law`` or ``Controller``, in processes.

    ``action``: kind of an agent's action, two numbers within the scenario's ``speed_max_m_s``.
    ``"velocity"``: the velocity of its front point, (x, y) in m/s in ``map``, as a ``Law`` returns it;
    ``"twist"``: (v, w) in m/s and rad/s, as a ``Controller`` returns it. The avoidance method bounds both. The
    action of an agent without a reference has no effect, as in a run, which does not call a law then.

    ``agents``: names of the robots that are agents; all by default. The other robots use their laws, which must be
    built in. The program of an agent's law is not started: the law only gives the robot's role.

    Observations are ``Observation``s with room for the maximum number of in-neighbors of an agent and for ``near``
    robots in sensing range. Rewards: see ``LockstepEnv.step``. ``faults`` and ``overrides`` change the scenario, as for
    ``phalanx.run``: ``faults=["kill r2 @1 restart 2"]``, ``duration_s=5.0``. A robot that is killed and restarted
    observes zeros in between.

    ``render_mode="rgb_array"``: ``render`` returns pictures as arrays. An environment can be copied and pickled at any
    step, as the wrappers of SuperSuit do, which Stable-Baselines3 needs. The copy continues like the original, bit by bit.

    Raises ``ValueError`` with the diagnostic of ``phalanx check`` if the scenario is invalid, and ``ImportError``
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
