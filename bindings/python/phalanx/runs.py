"""Runs, started from Python and read as pandas frames."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from pandas import DataFrame as _DataFrame  # type: ignore[import-untyped, import-not-found, unused-ignore]

__all__ = ["Figure", "Run", "RunError", "load", "print_metrics", "run"]

# Exit codes of a completed `phalanx run`: expectations met, or not.
_COMPLETED_CODES = (0, 1)
# Maximum time for an interrupted run to end before it is killed, s.
_INTERRUPT_TIMEOUT_S = 30.0
# Environment variable with the parent process at whose exit a phalanx process ends.
_PARENT = "PHALANX_PARENT"


class RunError(RuntimeError):
    """Error text of ``phalanx`` for a run that did not start or was not completed."""

    code: int
    """Exit code: 2 for an invalid command line, 3 for an invalid scenario, 4 for a run that ended early."""

    def __init__(self, said: str, code: int) -> None:
        # Both arguments, so that the exception can be pickled.
        super().__init__(said, code)
        self.code = code

    def __str__(self) -> str:
        return str(self.args[0])


class Figure:
    """One figure of a run, which notebooks display."""

    path: Path
    """Path of the SVG file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"Figure({str(self.path)!r})"

    def _repr_svg_(self) -> str:
        return self.path.read_text()


class Run:
    """The directory of a run, whose files are read on access. All quantities are SI.

    ``samples``, ``pairs``, ``events``, ``signals``, ``messages`` and ``latency`` are pandas frames, and need pandas; the tables are
    ``samples.csv`` and so on in ``path``. All columns are listed in docs/reference/files.md.
    """

    path: Path
    """Path of the directory."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r})"

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Results of the run, the contents of ``summary.json``: ``min_distance_m``, ``final_error_m`` by robot, ``converged_at_s``,
        ``expectations``, ``faults``, ... Lengths in m, times in s, and keys ending in ``_ns`` in ns.

        Raises FileNotFoundError for a run that was interrupted before it was written.
        """
        text = (self.path / "summary.json").read_text()
        summary: dict[str, Any] = json.loads(text)
        return summary

    @property
    def held(self) -> bool:
        """Whether the run was completed and met every expectation of its scenario."""
        return bool(self.summary["exit"] == 0)

    @cached_property
    def samples(self) -> _DataFrame:
        """State of every robot at ``record_hz``, such as ``x_m``, ``y_m`` and ``heading_rad`` of the axle mid-point, and
        ``error_m``; docs/reference/files.md lists all columns.

        One row for each time and robot, in order of time; errors are NaN while they are undefined.
        """
        return self._table("samples")

    @cached_property
    def pairs(self) -> _DataFrame:
        """Minimum distance of each pair of front points over all ticks: ``robot_a``, ``robot_b``,
        ``min_distance_m``, and its time."""
        return self._table("pairs")

    @cached_property
    def events(self) -> _DataFrame:
        """Events, such as ``kill`` or ``contact`` as ``kind``; ``robot``, ``other`` and ``state`` are NaN if the event has none."""
        return self._table("events")

    @cached_property
    def signals(self) -> _DataFrame:
        """Signals that the laws recorded: ``t_s``, ``robot``, ``signal`` and ``value``; at ``record_hz``, the newest value since
        the sample before. Raises FileNotFoundError for a run whose laws record none.
        """
        return self._table("signals")

    @cached_property
    def messages(self) -> _DataFrame:
        """Messages that the laws published: ``t_s``, ``robot``, ``array``, ``index`` and ``value`` of each number, or ``bytes``
        in hexadecimal form for messages without a structure; at ``record_hz``, the newest message since the sample before.
        Raises FileNotFoundError for a run of a scenario without ``record_messages = true``.
        """
        return self._table("messages")

    @cached_property
    def latency(self) -> _DataFrame:
        """Latencies, with a row for each stage and robot or edge; times in ns."""
        return self._table("latency")

    @property
    def figures(self) -> dict[str, Figure]:
        """Figures by name, such as ``"errors"``; empty for a run without a report."""
        found = sorted((self.path / "figures").glob("*.svg"))
        return {path.stem: Figure(path) for path in found}

    @property
    def report(self) -> Path:
        """Path of the HTML report, which replays the run."""
        return self.path / "report.html"

    @property
    def tables(self) -> dict[str, _DataFrame]:
        """All tables of the run as frames, by file name: ``"samples"``, ``"latency_over_time"``, and
        ``"export/poses"`` after ``phalanx export``."""
        found = sorted([*self.path.glob("*.csv"), *self.path.glob("export/*.csv")])
        names = (path.relative_to(self.path).with_suffix("").as_posix() for path in found)
        return {name: self._table(name) for name in names}

    def _table(self, name: str) -> _DataFrame:
        return read_frame(f"Run.{name}", self.path / f"{name}.csv")


def import_pandas(name: str, otherwise: str) -> Any:
    """Returns the package pandas, for the frame of this name. Without it, raises an error that ends in ``otherwise``."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            f"{name} is a pandas frame, and pandas cannot be imported ({error}): pip install pandas; {otherwise}"
        ) from error
    return pandas


def read_frame(name: str, path: Path) -> _DataFrame:
    """Returns the table in a file as a frame."""
    pandas = import_pandas(name, f"the table itself is {path}")
    # The name of a robot may be a text that pandas takes for a missing value.
    return pandas.read_csv(path, keep_default_na=False, na_values=[""])


def load(run_dir: str | os.PathLike[str]) -> Run:
    """Returns the run of a directory, without starting anything.

    Raises FileNotFoundError if ``phalanx run`` has not written the directory.
    """
    path = Path(run_dir)
    if not (path / "scenario.toml").is_file():
        raise FileNotFoundError(
            f"{path} is not a run directory: it has no scenario.toml; expected a directory written by `phalanx run`"
        )
    return Run(path)


def run(
    scenario: str | os.PathLike[str],
    *,
    pace: Literal["lockstep", "realtime"] = "realtime",
    out: str | os.PathLike[str] | None = None,
    faults: Sequence[str] = (),
    draw: bool = True,
    **overrides: Any,
) -> Run:
    """Runs a scenario to its end, in processes, and returns its directory.

    ``pace``: ``"lockstep"`` for reproducible simulated time; ``"realtime"`` for wall time. ``out``: directory to create,
    by default ``runs/NAME-DATE-TIME``. ``faults``: as on the command line, such as ``"kill r2 @5 restart 1"``.
    ``draw``: create figures and report. ``overrides``: keys of the scenario and their values, in the units of
    their names; dicts for tables: ``duration_s=10``,
    ``avoidance={"speed_max_m_s": 0.3}``, ``robot={"r1": {"law": "my-law"}}``, ``expect={}``.

    A run that missed expectations raises nothing: see ``held``. Raises RunError with the error text of ``phalanx``
    for an invalid scenario and for a run that ended early.
    """
    path = Path(scenario)
    directory = Path(out) if out is not None else unused_path(Path("runs"), path.stem)
    arguments = ["run", path_argument(path), f"--pace={pace}", f"--out={path_argument(directory)}"]
    arguments += [] if draw else ["--no-report"]
    arguments += [f"--fault={fault}" for fault in faults]
    arguments += [f"--set={assignment}" for assignment in assignments(overrides)]
    ended = run_phalanx(arguments)
    if ended.code not in _COMPLETED_CODES:
        raise RunError(ended.stderr, ended.code)
    return load(directory)


class Ended(NamedTuple):
    """Result of a call of ``phalanx``."""

    code: int
    """Exit code."""
    stdout: str
    """Standard output."""
    stderr: str
    """Standard error."""


def run_phalanx(
    arguments: Sequence[str], *, ends_with_caller: bool = False, answer: Callable[[str], str] | None = None
) -> Ended:
    """Runs ``phalanx``. With ``ends_with_caller`` it ends when this process exits, even if that is killed. Its requests,
    lines that begin with "? ", are passed to ``answer``."""
    scripts = sysconfig.get_path("scripts")
    # The programs of this environment come first, so that `python3` has this package.
    path = os.pathsep.join([scripts, os.environ.get("PATH", os.defpath)])
    program = shutil.which("phalanx", path=path)
    if program is None:
        raise RunError(f"there is no program `phalanx` in {scripts}: install the package again", 2)
    parent = {_PARENT: str(os.getpid())} if ends_with_caller else {}
    # Not a pipe, which would not be read while a request is answered.
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            [program, *arguments],
            stdin=subprocess.PIPE if answer else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            env={**os.environ, **parent, "PATH": path, "NO_COLOR": "1"},
        )
        printed = _read_output(process, answer)
        said.seek(0)
        return Ended(process.returncode, printed, said.read().strip())


def _read_output(process: subprocess.Popen[str], answer: Callable[[str], str] | None) -> str:
    """Answers the requests of a process until it ends, and returns the rest of its output."""
    printed = ""
    try:
        for line in process.stdout or ():
            if answer is None or process.stdin is None or not line.startswith("? "):
                printed += line
                continue
            answered = answer(line[2:].rstrip("\n"))
            # A process that has ended meanwhile has reported the reason.
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(answered + "\n")
                process.stdin.flush()
        process.wait()
    except BaseException:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=_INTERRUPT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
        raise
    return printed


def path_argument(path: str | os.PathLike[str]) -> str:
    """Returns a path as an argument that is not taken for an option."""
    word = os.fspath(path)
    return f"./{word}" if word.startswith("-") else word


def unused_path(folder: Path, name: str) -> Path:
    """Returns the path of a new directory in a folder, with this name and the current time."""
    stem = folder / time.strftime(f"{name}-%Y%m%d-%H%M%S")
    path, number = stem, 1
    while path.exists():
        number += 1
        path = stem.with_name(f"{stem.name}-{number}")
    return path


def assignments(overrides: Mapping[str, Any]) -> list[str]:
    """Returns overrides of scenario keys, with dicts for tables, as arguments of ``--set``."""
    return [f"{key}={_toml(value)}" for key, value in _flat(overrides)]


def _flat(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yields the values of nested tables with dotted keys."""
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _toml(value: Any) -> str:
    """Returns a value in TOML syntax."""
    if hasattr(value, "tolist"):  # a numpy value
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(_toml, value)) + "]"
    raise TypeError(f"{value!r} is no value of a scenario: expected numbers, strings, lists and dicts of them")


def print_metrics(function: Callable[[Run], Mapping[str, float | None]]) -> None:
    """Passes the run of the last argument to a function, and prints the metrics that it returns by name.

    A file that ends in this call is a program of ``[metrics.NAME]``. ``None`` is a metric without a value. The run has
    all its files, except for ``summary.json``.
    """
    if len(sys.argv) < 2:
        sys.exit(
            f"{Path(sys.argv[0]).name} expects the directory of a run as its last argument: a scenario names it as `program` of "
            "`[metrics.NAME]`, and `phalanx run SCENARIO` starts it"
        )
    values = function(load(sys.argv[-1]))
    print(json.dumps({name: None if value is None else float(value) for name, value in values.items()}))
