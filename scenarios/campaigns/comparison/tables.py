"""Writes the tables of docs/comparison.md from the results of the campaigns:

    python3 scenarios/campaigns/comparison/tables.py runs/campaigns/comparison docs/comparison.md
    python3 scenarios/campaigns/comparison/tables.py runs/campaigns/scenes docs/comparison.md
    python3 scenarios/campaigns/comparison/tables.py runs/campaigns/dense docs/comparison.md

Replaces the text between the two marks of the campaign in the page. If the page has the same tables with rows of other
methods, it keeps those rows. Requires only Python.
"""

import csv
import math
import statistics
import sys
from pathlib import Path


def wilson(count, total):
    """Returns the rate in percent with Wilson's 95 % interval, as text."""
    z, p = 1.959964, count / total
    middle = (p + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return f"{100 * p:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def rate(runs, key):
    return wilson(sum(run[key] for run in runs), len(runs))


def median(values, digits):
    return f"{statistics.median(values):.{digits}f}" if values else "-"


def makespan(runs):
    """Returns the median makespan, s; "never" if the median run never converges."""
    middle = statistics.median(float(run["converged_at_s"] or "inf") for run in runs)
    return f"{middle:.1f}" if math.isfinite(middle) else "never"


def format_minimum(runs, key):
    return f"{min(float(run[key]) for run in runs):.4f}"


def table(heads, rows):
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines) + "\n"


def distinct_values(runs, key):
    return list(dict.fromkeys(run[key] for run in runs))


def select_runs(runs, **wanted):
    return [run for run in runs if all(run[key] == value for key, value in wanted.items())]


def compute(runs):
    return median([float(run["compute"]) for run in runs if run["compute"]], 1)


def comparison(runs):
    """Returns the text for scenarios/campaigns/comparison.toml: an overview, then a table for each condition and scene."""
    for run in runs:
        run["scene"], run["robots"] = run["scene"].split("-")
    kinds, scenes, conditions = (distinct_values(runs, key) for key in ("kind", "scene", "condition"))
    text = f"{len(runs)} runs. Each cell has the percentage of runs in which a pair came closer than d, and of runs in which all robots "
    text += "arrived, with Wilson's 95 % interval, over all numbers of robots.\n\n"
    for scene in scenes:
        rows = []
        for kind in kinds:
            row = [f"`{kind}`"]
            for condition in conditions:
                here = select_runs(runs, kind=kind, scene=scene, condition=condition)
                found = f"{rate(here, 'below')} below d, {rate(here, 'arrived')} arrived" if here else "-"
                row.append(f"{found}, n = {len(here)}")
            rows.append(row)
        text += f"### {scene.capitalize()}\n\n" + table(["method", *conditions], rows)
    heads = ["robots", "method", "n", "below d, %", "below 0.99 d, %", "smallest distance / d", "arrived, %", "makespan, s", "path / straight", "compute, us"]
    for condition in conditions:
        for scene in scenes:
            rows = []
            there = select_runs(runs, scene=scene, condition=condition)
            for robots in sorted(distinct_values(there, "robots"), key=int):
                for kind in kinds:
                    here = select_runs(there, kind=kind, robots=robots)
                    if not here:
                        continue
                    ways = [float(run["path_over_straight"]) for run in select_runs(here, arrived=True)]
                    row = [robots, f"`{kind}`", str(len(here)), rate(here, "below"), rate(here, "far_below")]
                    row += [format_minimum(here, "min_distance_over_d"), rate(here, "arrived"), makespan(here)]
                    rows.append([*row, median(ways, 2), compute(here)])
            text += f"### {scene.capitalize()}, {condition}\n\n" + table(heads, rows)
    return text


def scenes(runs):
    """Returns the table for scenarios/campaigns/scenes.toml."""
    rows = []
    for scene in distinct_values(runs, "scene"):
        for kind in distinct_values(runs, "kind"):
            here = select_runs(runs, scene=scene, kind=kind)
            row = [f"`{scene}`", f"`{kind}`", str(len(here)), rate(here, "below"), format_minimum(here, "min_distance_over_d")]
            row += [rate(here, "below_clearance"), format_minimum(here, "min_clearance_m")]
            rows.append([*row, rate(here, "arrived"), makespan(here), compute(here)])
    heads = ["scene", "method", "n", "below d, %", "smallest distance / d", "below the clearance, %", "smallest clearance, m"]
    return table([*heads, "arrived, %", "makespan, s", "compute, us"], rows)


def dense(runs):
    """Returns the table for scenarios/campaigns/dense.toml. Rates of robots count only those alive at the end."""
    rows = []
    for scene in distinct_values(runs, "scene"):
        for condition in distinct_values(runs, "condition"):
            for kind in distinct_values(runs, "kind"):
                here = select_runs(runs, scene=scene, condition=condition, kind=kind)
                if not here:
                    continue
                living = sum(int(run["alive_at_end"]) for run in here)
                row = [f"`{scene}`, `{condition}`", f"`{kind}`", str(len(here)), rate(here, "below")]
                row += [format_minimum(here, "min_distance_over_d"), rate(here, "arrived")]
                row += [f"{100 * sum(run['robots_arrived'] for run in here) / living:.1f}", makespan(here)]
                rows.append(row)
    heads = ["scene, condition", "method", "n", "below d, %", "smallest distance / d", "all arrived, %"]
    return table([*heads, "robots arrived, %", "makespan, s"], rows)


def keyed(text):
    """Returns (key, line) for each line. The key is the heading and the fields that identify the row; in the overview only
    the method identifies it."""
    heading, lines = "", []
    for line in text.splitlines():
        heading = line if line.startswith("#") else heading
        fields = line.split("|")
        lines.append(((heading, *fields[1 : 3 if len(fields) > 7 else 2]), line))
    return lines


def merge_tables(old, new):
    """Returns the old tables with the rows of the new ones in place of the same rows; the new tables if the old ones lack
    some of these rows."""
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
text = merge_tables(old.strip("\n"), text.rstrip("\n"))
page.write_text(before + marks[0] + "\n" + text.rstrip("\n") + "\n\n" + marks[1] + after)
