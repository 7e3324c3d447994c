"""Writes the tables of lattices in docs/chapter.md from the results of the three campaigns:

    python3 scenarios/campaigns/lattices.py runs/campaigns/lattices-12 runs/campaigns/lattices-30 runs/campaigns/lattices-open docs/chapter.md

Replaces the text between the two marks of a table if one of its campaigns is given. Requires only Python.
"""

import csv
import sys
from pathlib import Path


def table(heads, rows):
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def format_stuck(runs):
    """Returns the number of runs that did not converge and their total, as text."""
    return f"{sum(run['converged'] == '0' for run in runs)} of {len(runs)}" if runs else "-"


def formation_table(runs):
    """Returns a table with a row for each graph of the campaigns `lattices-12` and `lattices-30`."""
    rows = []
    for graph in dict.fromkeys(run["graph"] for run in runs):
        robots, gap, edges = graph.removesuffix(".json").split("-", 2)
        cases = {"constant": [], "closing": [], "replaced": []}
        for run in (run for run in runs if run["graph"] == graph):
            case = run["formation"]
            cases["replaced" if "replaced" in case else "closing" if case == "closing" else "constant"].append(run)
        nearest = min(float(run["min_distance_over_d"]) for case in cases.values() for run in case)
        counts = [format_stuck(case) for case in cases.values()]
        rows.append([robots, gap, edges.replace("-", " "), *counts, f"{nearest:.2f}"])
    rows.sort(key=lambda row: (int(row[0]), float(row[1]), row[2] != "one way"))
    heads = ["robots", "gap / d", "edges", "of constant size: stuck", "with `closing`: stuck", "one replaced: stuck", "nearest / d"]
    return table(heads, rows)


def opening_table(runs):
    """Returns a table with a row for each scale of the campaign `lattices-open`."""
    lattices = list(dict.fromkeys(run["lattice"] for run in runs))
    rows = []
    for mean in sorted({float(run["scale.mean"]) for run in runs}):
        row = [f"{mean * 1.1:.1f}"]
        for lattice in lattices:
            here = [run for run in runs if run["lattice"] == lattice and float(run["scale.mean"]) == mean]
            times = [float(run["converged_at_s"]) for run in here if run["converged_at_s"]]
            row.append(f"{format_stuck(here)}; {max(times):.0f} s" if times else format_stuck(here))
        rows.append(row)
    return table(["gap / d", *lattices], rows)


def replace_marked(text, mark, new):
    """Returns the text with `new` between the two marks."""
    begin, end = f"<!-- {mark} -->\n", f"<!-- /{mark} -->"
    before, rest = text.split(begin)
    return before + begin + new + end + rest.split(end)[1]


def read(folder):
    with open(Path(folder) / "runs.csv", newline="") as file:
        return list(csv.DictReader(file))


*folders, page = sys.argv[1:]
runs = [run for folder in folders for run in read(folder)]
text = Path(page).read_text()
for mark, make_table, key in [
    ("lattices", formation_table, "formation"),
    ("lattices-open", opening_table, "lattice"),
]:
    selected = [run for run in runs if key in run]
    if selected:
        text = replace_marked(text, mark, make_table(selected))
Path(page).write_text(text)
