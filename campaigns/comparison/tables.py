"""Makes the tables of docs/comparison.md from the tables of a campaign:

    python3 campaigns/comparison/tables.py runs/campaigns/comparison docs/comparison.md

What stands between the page's two marks is replaced. Needs nothing but Python.
"""

import csv
import math
import statistics
import sys
from pathlib import Path

MARKS = ("<!-- tables -->\n", "<!-- end of tables -->\n")


def wilson(count, of):
    """The rate in percent with Wilson's interval of 95 %."""
    z, p = 1.959964, count / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return f"{100 * p:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def median(values, digits):
    return f"{statistics.median(values):.{digits}f}" if values else "-"


def makespan(values):
    """The median; of runs that never end it is none."""
    middle = statistics.median(values)
    return f"{middle:.1f}" if math.isfinite(middle) else "never"


def table(heads, rows):
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines) + "\n"


def in_order(values):
    return list(dict.fromkeys(values))


folder, page = Path(sys.argv[1]), Path(sys.argv[2])
timing = {row["run"]: row for row in csv.DictReader(open(folder / "timing.csv"))}
runs = [row for row in csv.DictReader(open(folder / "runs.csv")) if row["outcome"] != "infrastructure"]
for run in runs:
    run["kind"], run["robots"] = run["avoidance.kind"], int(run["scene"].split("-")[1])
    run["scene"] = run["scene"].split("-")[0]
    run["below"] = int(run["violations"]) > 0
    run["arrived"] = run["converged"] == "1"
kinds, scenes, conditions = (in_order(run[key] for run in runs) for key in ("kind", "scene", "condition"))


def some(**wanted):
    return [run for run in runs if all(run[key] == value for key, value in wanted.items())]


text = f"{len(runs)} runs. In each field: runs of which some pair came nearer than d, and runs in which everybody arrived, in "
text += "percent with Wilson's interval of 95 %, over all numbers of robots.\n\n"
for scene in scenes:
    rows = []
    for kind in kinds:
        row = [f"`{kind}`"]
        for condition in conditions:
            here = some(kind=kind, scene=scene, condition=condition)
            below = wilson(sum(run["below"] for run in here), len(here)) if here else "-"
            arrived = wilson(sum(run["arrived"] for run in here), len(here)) if here else "-"
            row.append(f"{below} below d, {arrived} arrived, n = {len(here)}")
        rows.append(row)
    text += f"### {scene.capitalize()}\n\n" + table(["method", *conditions], rows)

HEADS = ["robots", "method", "n", "below d, %", "below 0.99 d, %", "smallest distance / d", "arrived, %", "makespan, s", "path / straight", "compute, us"]
for condition in conditions:
    for scene in scenes:
        rows = []
        for robots in sorted({run["robots"] for run in some(scene=scene, condition=condition)}):
            for kind in kinds:
                here = some(kind=kind, scene=scene, condition=condition, robots=robots)
                if not here:
                    continue
                there = [run for run in here if run["arrived"]]
                times = [timing[run["run"]]["compute_mean_us"] for run in here if run["run"] in timing]
                rows.append([
                    str(robots),
                    f"`{kind}`",
                    str(len(here)),
                    wilson(sum(run["below"] for run in here), len(here)),
                    wilson(sum(float(run["min_distance_over_d"]) < 0.99 for run in here), len(here)),
                    f"{min(float(run['min_distance_over_d']) for run in here):.4f}",
                    wilson(len(there), len(here)),
                    makespan([float(run["converged_at_s"] or "inf") for run in here]),
                    median([float(run["path_over_straight"]) for run in there], 2),
                    median([float(time) for time in times if time], 1),
                ])
        text += f"### {scene.capitalize()}, {condition}\n\n" + table(HEADS, rows)

before, rest = page.read_text().split(MARKS[0])
page.write_text(before + MARKS[0] + "\n" + text.rstrip("\n") + "\n\n" + MARKS[1] + rest.split(MARKS[1])[1])
