"""Campaigns (parameter studies): run on this machine or by the workers of any executor, and read as pandas frames."""

from __future__ import annotations

import json
import os
import shlex
import socket
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from functools import cached_property
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from .runs import Run, RunError, import_pandas, load, path_argument, read_frame, run_phalanx

if TYPE_CHECKING:
    from pandas import DataFrame as _DataFrame  # type: ignore[import-untyped, import-not-found, unused-ignore]

__all__ = ["Campaign", "sweep"]

# Exit codes of `phalanx sweep`.
_REFUSED = (2, 3)
_GIVEN_UP = 4


class _Submits(Protocol):
    """The method of an executor that is used: ``submit`` of ``concurrent.futures.Executor``."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]: ...


class Campaign:
    """The folder of a campaign, whose files are read on access. All quantities are SI.

    ``runs``, ``timing``, ``statistics`` and ``pairs`` are pandas frames, and need pandas. All columns of the
    first two are listed in docs/reference/files.md.
    """

    path: Path
    """Path of the folder."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Opens a folder. Raises FileNotFoundError if ``phalanx sweep`` has not written it."""
        self.path = Path(path)
        if not (self.path / "campaign.json").is_file():
            raise FileNotFoundError(
                f"{path} is not the folder of a campaign: it has no campaign.json; expected a folder written by "
                "`phalanx sweep`"
            )

    def __repr__(self) -> str:
        return f"Campaign({str(self.path)!r})"

    @cached_property
    def document(self) -> dict[str, Any]:
        """Contents of ``campaign.json``: axes, seeds, executable, and the numbers of the report."""
        document: dict[str, Any] = json.loads((self.path / "campaign.json").read_text())
        return document

    @cached_property
    def runs(self) -> _DataFrame:
        """Table with a row for each run: the value of each axis, ``seed``, ``outcome``, ``min_distance_m``, ..., ``run``."""
        return read_frame("Campaign.runs", self.path / "runs.csv")

    @cached_property
    def timing(self) -> _DataFrame:
        """Table with a row for each run: results that depend on the machine."""
        return read_frame("Campaign.timing", self.path / "timing.csv")

    @cached_property
    def statistics(self) -> _DataFrame:
        """Table with a row for each combination of settings, with the numbers of the report.

        A rate, such as ``held``, is five columns: ``held_count`` of ``held_of`` runs, ``held``, and Wilson's interval of
        95 % from ``held_low`` to ``held_high``. A median, such as ``converged_at_s``, is five columns too: the number of
        runs ``converged_at_s_of``, the number of those without a value ``converged_at_s_never``, the median
        ``converged_at_s``, and its bootstrap interval of 95 % from ``converged_at_s_low`` to ``converged_at_s_high``.
        NaN: the data do not determine the number.
        """
        return self._rows("statistics", "points")

    @cached_property
    def pairs(self) -> _DataFrame:
        """Comparison of every combination of settings with the first one, seed by seed, as in the report."""
        return self._rows("pairs", "pairs")

    @property
    def report(self) -> Path:
        """Path of the HTML report."""
        return self.path / "report.html"

    def run(self, identity: str) -> Run:
        """Returns a run by its identity, the column ``run``. The key ``keep`` of the campaign determines which tables it has."""
        return load(self.path / "runs" / identity)

    def _rows(self, name: str, key: str) -> _DataFrame:
        pandas = import_pandas(f"Campaign.{name}", f"the numbers are `{key}` in {self.path / 'campaign.json'}")
        return pandas.DataFrame([_flat(row) for row in self.document[key]])


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Returns one row of ``campaign.json`` with its settings and estimates as columns."""
    columns: dict[str, Any] = {}
    for key, value in row.items():
        if key == "settings":
            columns.update(value)
        elif isinstance(value, dict):
            estimate = value.get("rate", value.get("median")) or {}
            counts = (name for name in value if name not in ("rate", "median"))
            columns.update({f"{key}_{name}": value[name] for name in counts})
            columns[key] = estimate.get("value")
            columns.update({f"{key}_{end}": estimate.get(end) for end in ("low", "high")})
        else:
            columns[key] = value
    return columns


def sweep(
    campaign: str | os.PathLike[str],
    *,
    executor: _Submits | None = None,
    out: str | os.PathLike[str] | None = None,
    chunk: int = 1,
    in_process: bool = False,
    retry: bool = False,
    wait_s: float = 3600.0,
) -> Campaign:
    """Computes the missing runs of a campaign, and returns its folder.

    ``executor``: executor whose workers compute the runs: any ``concurrent.futures.Executor``, such as a
    ``ProcessPoolExecutor``, ``Client.get_executor()`` of Dask or ``mpi4py.futures.MPIPoolExecutor``; by default
    ``phalanx sweep`` on all cores of this machine. Workers need this package in the same version, and the campaign,
    its scenario and ``out`` at the same paths. In lockstep the tables are those of ``phalanx sweep``, byte for byte.

    ``out``: the folder, by default ``runs/campaigns/NAME``. ``chunk``: number of runs per task, one after the other.
    ``in_process``: compute each run in one process, without a process for each robot: the same table in less time.
    ``retry``: try failed runs again. ``wait_s``: maximum time until the next task ends, s; an executor that has lost
    all its workers may report nothing.

    Raises RunError for an invalid campaign, and if runs are missing in the end, with their number and the reason. The
    same call then continues. A run that failed three times for a reason outside of the scenario is not an error: a
    warning has the number of such runs, and ``runs.outcome`` is ``"infrastructure"``.
    """
    arguments = [path_argument(campaign)]
    arguments += [f"--out={path_argument(out)}"] if out is not None else []
    more = ["--in-process"] if in_process else []
    more += ["--retry"] if retry else []
    if executor is None:
        return _collect(run_phalanx(["sweep", *arguments, *more]), "")
    if not callable(getattr(executor, "submit", None)):
        raise TypeError(
            f"executor={executor!r} has no method submit: expected a concurrent.futures.Executor, such as "
            "ProcessPoolExecutor() or Dask's Client.get_executor()"
        )
    ended = run_phalanx(["sweep", *arguments, *more, "--emit-commands", f"--chunk={chunk}"])
    if ended.code != 0:
        raise RunError(ended.stderr, ended.code)
    commands = [shlex.split(line)[1:] for line in ended.stdout.splitlines()]
    why = _run_by(executor, commands, wait_s)
    return _collect(run_phalanx(["sweep", *arguments, "--collect"]), why)


class _Task(NamedTuple):
    """Result of a task of an executor."""

    host: str
    code: int
    stderr: str


def _task(command: Sequence[str]) -> _Task:
    """Computes the missing runs of a chunk, on a worker, with the program of the worker's environment."""
    ended = run_phalanx(command, ends_with_caller=True)
    return _Task(socket.gethostname(), ended.code, ended.stderr)


def _run_by(executor: _Submits, commands: Sequence[Sequence[str]], wait_s: float) -> str:
    """Runs the commands on an executor. Returns a message about the first failure, or an empty text."""
    ended: SimpleQueue[Future[_Task]] = SimpleQueue()
    tasks: list[Future[_Task]] = []
    why = ""
    try:
        for command in commands:
            try:
                found = executor.submit(_task, command)
            except Exception as error:
                why = f"the executor takes no more tasks ({_describe_error(error)})"
                break
            tasks.append(_check_future(found))
            tasks[-1].add_done_callback(ended.put)
        for _ in tasks:
            try:
                task: Any = ended.get(timeout=wait_s).result()
            except Empty:
                return why or f"no task ended for {wait_s:g} s, which is `wait_s`: are there workers?"
            except (Exception, CancelledError) as error:
                why = why or f"the executor failed ({_describe_error(error)})"
                continue
            if not isinstance(task, _Task):
                why = why or f"the executor gave {task!r} as the result of a task, expected what the task returned"
                continue
            if task.code in _REFUSED:
                return f"a worker on {task.host} refused it:\n{task.stderr}"
    finally:
        for future in tasks:
            future.cancel()
    return why


def _check_future(found: Any) -> Future[_Task]:
    """Returns what ``submit`` has returned. Raises TypeError if it cannot be used as a future."""
    missing = [name for name in ("add_done_callback", "result", "cancel") if not callable(getattr(found, name, None))]
    if missing:
        raise TypeError(
            f"executor.submit returned {found!r}, which has no method {missing[0]}: expected a future as "
            "concurrent.futures.Executor returns it"
        )
    future: Future[_Task] = found
    return future


def _describe_error(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".rstrip(": ")


def _collect(ended: Any, why: str) -> Campaign:
    """Returns the campaign whose tables were just written. Raises RunError if runs are missing."""
    summary, _, path = ended.stdout.rstrip().rpartition("\nwritten to ")
    if ended.code in _REFUSED or not path:
        raise RunError(ended.stderr, ended.code)
    campaign = Campaign(path)
    missing = sum(point["missing"] for point in campaign.document["points"])
    if missing > 0:
        why = why or ended.stderr or (
            "the tasks succeeded, but their results are not in this folder: do all workers share it, and do they have "
            "the same build of phalanx?"
        )
        raise RunError(
            f"{summary}: {why}\nThe complete runs stay in {path}: call phalanx.sweep again with a working executor to run "
            "the missing ones.",
            _GIVEN_UP,
        )
    if ended.code == _GIVEN_UP:
        warnings.warn(f"{summary}; retry=True tries them again", stacklevel=3)
    return campaign
