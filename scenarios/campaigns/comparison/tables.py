"""Makes the tables of docs/comparison.md from the tables of the campaigns:

    python3 scenarios/campaigns/comparison/tables.py runs/campaigns/comparison docs/comparison.md
    python3 scenarios/campaigns/comparison/tables.py runs/campaigns/scenes docs/comparison.md
    python3 scenarios/campaigns/comparison/tables.py runs/campaigns/dense docs/comparison.md

What stands between the campaign's two marks of the page is replaced; where the page has the same tables with rows of
other methods, these rows stay. Needs nothing but Python.
"""

import csv
import math
import statistics
import sys
from pathlib import Path


def wilson(count, of):
    """The rate in percent with Wilson's interval of 95 %."""
    z, p = 1.959964, count / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return f"{100 * p:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def rate(runs, key):
    return wilson(sum(run[key] for run in runs), len(runs))


def median(values, digits):
    return f"{statistics.median(values):.{digits}f}" if values else "-"


def makespan(runs):
    """The median; of runs that never end it is none."""
    middle = statistics.median(float(run["converged_at_s"] or "inf") for run in runs)
    return f"{middle:.1f}" if math.isfinite(middle) else "never"


def least(runs, key):
    return f"{min(float(run[key]) for run in runs):.4f}"


def table(heads, rows):
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines) + "\n"


def in_order(runs, key):
    return list(dict.fromkeys(run[key] for run in runs))


def some(runs, **wanted):
    return [run for run in runs if all(run[key] == value for key, value in wanted.items())]


def compute(runs):
    return median([float(run["compute"]) for run in runs if run["compute"]], 1)


def comparison(runs):
    """Of scenarios/campaigns/comparison.toml: an overview, then a table for each condition and scene."""
    for run in runs:
        run["scene"], run["robots"] = run["scene"].split("-")
    kinds, scenes, conditions = (in_order(runs, key) for key in ("kind", "scene", "condition"))
    text = f"{len(runs)} runs. Each cell has the percentage of runs in which a pair came closer than d, and of runs in which all robots "
    text += "arrived, with Wilson's 95 % interval, over all numbers of robots.\n\n"
    for scene in scenes:
        rows = []
        for kind in kinds:
            row = [f"`{kind}`"]
            for condition in conditions:
                here = some(runs, kind=kind, scene=scene, condition=condition)
                found = f"{rate(here, 'below')} below d, {rate(here, 'arrived')} arrived" if here else "-"
                row.append(f"{found}, n = {len(here)}")
            rows.append(row)
        text += f"### {scene.capitalize()}\n\n" + table(["method", *conditions], rows)
    heads = ["robots", "method", "n", "below d, %", "below 0.99 d, %", "smallest distance / d", "arrived, %", "makespan, s", "path / straight", "compute, us"]
    for condition in conditions:
        for scene in scenes:
            rows = []
            there = some(runs, scene=scene, condition=condition)
            for robots in sorted(in_order(there, "robots"), key=int):
                for kind in kinds:
                    here = some(there, kind=kind, robots=robots)
                    if not here:
                        continue
                    ways = [float(run["path_over_straight"]) for run in some(here, arrived=True)]
                    row = [robots, f"`{kind}`", str(len(here)), rate(here, "below"), rate(here, "far_below")]
                    row += [least(here, "min_distance_over_d"), rate(here, "arrived"), makespan(here)]
                    rows.append([*row, median(ways, 2), compute(here)])
            text += f"### {scene.capitalize()}, {condition}\n\n" + table(heads, rows)
    return text


def scenes(runs):
    """Of scenarios/campaigns/scenes.toml: one table."""
    rows = []
    for scene in in_order(runs, "scene"):
        for kind in in_order(runs, "kind"):
            here = some(runs, scene=scene, kind=kind)
            row = [f"`{scene}`", f"`{kind}`", str(len(here)), rate(here, "below"), least(here, "min_distance_over_d")]
            row += [rate(here, "below_clearance"), least(here, "min_clearance_m")]
            rows.append([*row, rate(here, "arrived"), makespan(here), compute(here)])
    heads = ["scene", "method", "n", "below d, %", "smallest distance / d", "below the clearance, %", "smallest clearance, m"]
    return table([*heads, "arrived, %", "makespan, s", "compute, us"], rows)


def dense(runs):
    """Of scenarios/campaigns/dense.toml: one table. Where robots die, those count that live."""
    rows = []
    for scene in in_order(runs, "scene"):
        for condition in in_order(runs, "condition"):
            for kind in in_order(runs, "kind"):
                here = some(runs, scene=scene, condition=condition, kind=kind)
                if not here:
                    continue
                living = sum(int(run["alive_at_end"]) for run in here)
                row = [f"`{scene}`, `{condition}`", f"`{kind}`", str(len(here)), rate(here, "below")]
                row += [least(here, "min_distance_over_d"), rate(here, "arrived")]
                row += [f"{100 * sum(run['robots_arrived'] for run in here) / living:.1f}", makespan(here)]
                rows.append(row)
    heads = ["scene, condition", "method", "n", "below d, %", "smallest distance / d", "all arrived, %"]
    return table([*heads, "robots arrived, %", "makespan, s"], rows)


def keyed(text):
    """Lines, each with its heading and the fields that name its row; the overview has a method alone there."""
    heading, lines = "", []
    for line in text.splitlines():
        heading = line if line.startswith("#") else heading
        fields = line.split("|")
        lines.append(((heading, *fields[1 : 3 if len(fields) > 7 else 2]), line))
    return lines


def into(old, new):
    """The old tables with the rows of the new ones; the new tables where the old ones have none of these rows."""
    rows = {key: line for key, line in keyed(new) if line.startswith("| ")}
    known = {key for key, _ in keyed(old)}
    if not rows.keys() <= known:
        return new
    return "\n".join(rows.get(key, line) for key, line in keyed(old)) + "\n"


folder, page = Path(sys.argv[1]), Path(sys.argv[2])
timing = {row["run"]: row for row in csv.DictReader(open(folder / "timing.csv"))}
runs = [row for row in csv.DictReader(open(folder / "runs.csv")) if row["outcome"] != "infrastructure"]
for run in runs:
    run["compute"] = timing.get(run["run"], {}).get("compute_p99_us")
    run["kind"] = run["avoidance.kind"]
    run["below"] = int(run["violations"]) > 0
    run["far_below"] = float(run["min_distance_over_d"]) < 0.99
    run["below_clearance"] = int(run["clearance_violations"]) > 0
    run["robots_arrived"] = int(run["arrived"])
    run["arrived"] = run["converged"] == "1"
if "condition" not in runs[0]:
    name, text = "scenes", scenes(runs)
elif any(run["scene"].endswith("-dead") for run in runs):
    name, text = "dense", dense(runs)
else:
    name, text = "comparison", comparison(runs)
marks = (f"<!-- {name} -->\n", f"<!-- end of {name} -->\n")
before, rest = page.read_text().split(marks[0])
old, after = rest.split(marks[1])
text = into(old.strip("\n"), text.rstrip("\n"))
page.write_text(before + marks[0] + "\n" + text.rstrip("\n") + "\n\n" + marks[1] + after)
