"""Hunts (falsification): search for a run that misses an expectation, which may be a function in Python."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from .runs import Run, RunError, assignments, load, path_argument, run_phalanx, unused_path

__all__ = ["Hunt", "hunt"]

# Exit codes of a completed `phalanx hunt`: nothing found, or a run that misses an expectation.
_COMPLETED_CODES = (0, 1)


class Hunt:
    """The folder of a completed hunt."""

    path: Path
    """Path of the folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"Hunt({str(self.path)!r})"

    @cached_property
    def document(self) -> dict[str, Any]:
        """Contents of ``hunt.json``: ``found``, ``runs``, ``margin_of_file``, ``what`` happens in one sentence, ``trajectory_hash``, ..."""
        document: dict[str, Any] = json.loads((self.path / "hunt.json").read_text())
        return document

    @property
    def found(self) -> bool:
        """Whether a run missed an expectation."""
        return bool(self.document["found"])

    @property
    def scenario(self) -> Path:
        """Scenario file of the simplest run that missed an expectation, or of the run with the smallest margin."""
        return self.path / str(self.document["file"])

    @property
    def run(self) -> Run:
        """The run of ``scenario``, in lockstep."""
        return load(self.scenario.with_suffix(""))


def hunt(
    scenario: str | os.PathLike[str],
    *,
    margin: Callable[[Run], float] | None = None,
    runs: int | None = None,
    minutes: float | None = None,
    vary: Sequence[str] = (),
    seed: int | None = None,
    jobs: int | None = None,
    out: str | os.PathLike[str] | None = None,
    faults: Sequence[str] = (),
    **overrides: Any,
) -> Hunt:
    """Searches for a run of a scenario that misses an expectation, shrinks it, and returns the hunt's folder.

    ``margin``: function of a run, with its tables, that returns the margin to a miss: a number in any unit, negative for
    a miss. It is called for one run at a time, and the run's directory exists only during the call. By default the
    margins of the scenario's expectations are used. ``runs``, ``minutes``: maximum number of runs, and maximum duration.
    ``vary``: ``"starts"``, ``"faults"``, ``"delays"``, ``"noise"``, ``"gains"``. ``out``: the folder; an incomplete hunt in
    it continues, if the function is the same. ``faults``, ``overrides``: as for ``phalanx.run``.

    Raises RunError with the error text of ``phalanx``, and exceptions of the function.
    """
    folder = Path(out) if out is not None else unused_path(Path("runs/hunts"), Path(scenario).stem)
    arguments = ["hunt", path_argument(scenario), f"--out={path_argument(folder)}"]
    arguments += [f"--margin={getattr(margin, '__name__', 'margin')}"] if margin else []
    arguments += [f"--vary={','.join(vary)}"] if vary else []
    for option, value in (("--runs", runs), ("--minutes", minutes), ("--seed", seed), ("--jobs", jobs)):
        arguments += [f"{option}={value}"] if value is not None else []
    arguments += [f"--fault={fault}" for fault in faults]
    arguments += [f"--set={assignment}" for assignment in assignments(overrides)]
    ended = run_phalanx(arguments, answer=partial(_evaluate_margin, margin) if margin else None)
    if ended.code not in _COMPLETED_CODES:
        raise RunError(ended.stderr, ended.code)
    return Hunt(folder)


def _evaluate_margin(margin: Callable[[Run], float], run_dir: str) -> str:
    return repr(float(margin(load(run_dir))))
