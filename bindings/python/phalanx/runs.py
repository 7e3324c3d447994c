"""Runs for analysis: started from Python, and read as pandas frames."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from pandas import DataFrame as _DataFrame  # type: ignore[import-untyped, import-not-found, unused-ignore]

__all__ = ["Figure", "Run", "RunError", "load", "run"]

# What `phalanx run` ends with after a run that went to its end: as expected, or not.
_WENT_TO_ITS_END = (0, 1)
# A run that is interrupted is given so long to end by itself, s.
_ENDS_WITHIN_S = 30.0
# By this variable a process of phalanx knows which parent it is to die with.
_PARENT = "PHALANX_PARENT"


class RunError(RuntimeError):
    """A run that did not begin, or did not go to its end: what ``phalanx`` said about it."""

    code: int
    """The exit code: 2 for a command line, 3 for a scenario that is wrong, 4 for a run that ended early."""

    def __init__(self, said: str, code: int) -> None:
        # Both, so that it can be sent from process to process.
        super().__init__(said, code)
        self.code = code

    def __str__(self) -> str:
        return str(self.args[0])


class Figure:
    """One figure of a run, which notebooks show."""

    path: Path
    """Where it is, as SVG."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"Figure({str(self.path)!r})"

    def _repr_svg_(self) -> str:
        return self.path.read_text()


class Run:
    """A run's directory, read when it is asked. All quantities are SI.

    ``samples``, ``pairs``, ``events`` and ``latency`` are pandas frames, and need pandas; the tables that they are
    made of are ``samples.csv`` and so on in ``path``. Every column: docs/reference/files.md.
    """

    path: Path
    """The directory."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r})"

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What came out, as ``summary.json`` has it: ``min_distance_m``, ``final_error_m`` by robot, ``converged_at_s``,
        ``expectations``, ``faults``, ... Lengths in m, times in s, and what ends in ``_ns`` in ns.

        Raises FileNotFoundError for a run that was cut short before it had one.
        """
        text = (self.path / "summary.json").read_text()
        summary: dict[str, Any] = json.loads(text)
        return summary

    @property
    def held(self) -> bool:
        """Whether the run went to its end and every expectation of its scenario held."""
        return bool(self.summary["exit"] == 0)

    @cached_property
    def samples(self) -> _DataFrame:
        """Every robot at ``record_hz``: ``t_s``, ``robot``, ``x_m``, ``y_m`` and ``heading_rad`` of the middle of its axle,
        ``v_m_s``, ``w_rad_s``, ``error_m``, ``alive``, ``ideal_error_m``, ``front_x_m``,
        ``front_y_m``.

        One row for each instant and robot, in order of time; errors are NaN while there is none.
        """
        return self._table("samples")

    @cached_property
    def pairs(self) -> _DataFrame:
        """The smallest distance of each pair of front points over all ticks: ``robot_a``, ``robot_b``,
        ``min_distance_m``, and when that was."""
        return self._table("pairs")

    @cached_property
    def events(self) -> _DataFrame:
        """What happened: ``t_s``, ``kind``, ``robot`` (NaN if it was nobody's), ``detail``."""
        return self._table("events")

    @cached_property
    def latency(self) -> _DataFrame:
        """One row for each stage of latency, and robot or edge; times in ns."""
        return self._table("latency")

    @property
    def figures(self) -> dict[str, Figure]:
        """The figures by their names, such as ``"errors"``; none of a run without a report."""
        found = sorted((self.path / "figures").glob("*.svg"))
        return {path.stem: Figure(path) for path in found}

    @property
    def report(self) -> Path:
        """The page with everything, and the run replayed."""
        return self.path / "report.html"

    @property
    def tables(self) -> dict[str, _DataFrame]:
        """Every table of the run as a frame, by the name of its file: ``"samples"``, ``"latency_over_time"``, and
        ``"export/poses"`` of what ``phalanx export`` wrote."""
        found = sorted([*self.path.glob("*.csv"), *self.path.glob("export/*.csv")])
        names = (path.relative_to(self.path).with_suffix("").as_posix() for path in found)
        return {name: self._table(name) for name in names}

    def _table(self, name: str) -> _DataFrame:
        return frame(f"Run.{name}", self.path / f"{name}.csv")


def frames(name: str, otherwise: str) -> Any:
    """The package pandas, for the frame of this name; without it, the error says what there is ``otherwise``."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            f"{name} is a pandas frame, and pandas cannot be imported ({error}): pip install pandas; {otherwise}"
        ) from error
    return pandas


def frame(name: str, path: Path) -> _DataFrame:
    """The table of this name as a frame."""
    pandas = frames(name, f"the table itself is {path}")
    # A robot may be called as what pandas takes for no value.
    return pandas.read_csv(path, keep_default_na=False, na_values=[""])


def load(run_dir: str | os.PathLike[str]) -> Run:
    """The run whose directory this is. Nothing is started.

    Raises FileNotFoundError for a directory that ``phalanx run`` has not written.
    """
    path = Path(run_dir)
    if not (path / "scenario.toml").is_file():
        raise FileNotFoundError(
            f"{path} is no run directory: it has no scenario.toml; expected the directory that `phalanx run` "
            "has written"
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
    """Runs a scenario to its end, in processes, and gives its directory.

    ``pace``: ``"lockstep"`` for simulated time, the same from run to run; ``"realtime"`` for the clock. ``out``: the
    directory to be made; else ``runs/NAME-DATE-TIME``. ``faults``: as on the command line, such as
    ``"kill r2 @5 restart 1"``. ``draw``: with figures and report. ``overrides``: keys of the scenario and their
    values, in the units of their names; dicts for tables: ``duration_s=10``,
    ``avoidance={"speed_max_m_s": 0.3}``, ``robot={"r1": {"law": "my-law"}}``, ``expect={}``.

    The run whose expectations were missed is a run, too: look at ``held``. Raises RunError with what
    ``phalanx`` said for a scenario that is wrong and for a run that ended early.
    """
    path = Path(scenario)
    directory = Path(out) if out is not None else unused(Path("runs"), path.stem)
    words = ["run", path_word(path), f"--pace={pace}", f"--out={path_word(directory)}"]
    words += [] if draw else ["--no-report"]
    words += [f"--fault={fault}" for fault in faults]
    words += [f"--set={assignment}" for assignment in assignments(overrides)]
    ended = called(words)
    if ended.code not in _WENT_TO_ITS_END:
        raise RunError(ended.said, ended.code)
    return load(directory)


class Ended(NamedTuple):
    """How ``phalanx`` ended."""

    code: int
    """Its exit code."""
    printed: str
    """Its results, from its standard output."""
    said: str
    """What it said about it, from its standard error."""


def called(
    words: Sequence[str], *, ends_with_caller: bool = False, answer: Callable[[str], str] | None = None
) -> Ended:
    """Calls ``phalanx``. With ``ends_with_caller`` it dies with this process, even where that one is killed. What it asks,
    in lines that begin with "? ", is put to ``answer``."""
    scripts = sysconfig.get_path("scripts")
    # The programs of this environment first: `python3` is then one that has this package.
    path = os.pathsep.join([scripts, os.environ.get("PATH", os.defpath)])
    program = shutil.which("phalanx", path=path)
    if program is None:
        raise RunError(f"there is no program `phalanx` in {scripts}: install the package again", 2)
    parent = {_PARENT: str(os.getpid())} if ends_with_caller else {}
    # Not a pipe: nobody reads it while what is asked is answered.
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            [program, *words],
            stdin=subprocess.PIPE if answer else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            env={**os.environ, **parent, "PATH": path, "NO_COLOR": "1"},
        )
        printed = _printed(process, answer)
        said.seek(0)
        return Ended(process.returncode, printed, said.read().strip())


def _printed(process: subprocess.Popen[str], answer: Callable[[str], str] | None) -> str:
    """What it prints until it ends; what it asks is answered."""
    printed = ""
    try:
        for line in process.stdout or ():
            if answer is None or process.stdin is None or not line.startswith("? "):
                printed += line
                continue
            answered = answer(line[2:].rstrip("\n"))
            # Who has ended meanwhile has said why.
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(answered + "\n")
                process.stdin.flush()
        process.wait()
    except BaseException:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
        raise
    return printed


def path_word(path: str | os.PathLike[str]) -> str:
    """A path as a word of a command line that is not taken for an option."""
    word = os.fspath(path)
    return f"./{word}" if word.startswith("-") else word


def unused(folder: Path, name: str) -> Path:
    """A directory of this name and of now that is not there yet in a folder."""
    stem = folder / time.strftime(f"{name}-%Y%m%d-%H%M%S")
    path, number = stem, 1
    while path.exists():
        number += 1
        path = stem.with_name(f"{stem.name}-{number}")
    return path


def assignments(overrides: Mapping[str, Any]) -> list[str]:
    """Keys of a scenario and their values, dicts for tables, as ``--set`` takes them."""
    return [f"{key}={_toml(value)}" for key, value in _flat(overrides)]


def _flat(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The keys of nested tables, dotted."""
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _toml(value: Any) -> str:
    """A value as TOML has it."""
    if hasattr(value, "tolist"):  # of numpy
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
    raise TypeError(f"{value!r} is no value of a scenario: expected numbers, words, lists and dicts of them")
