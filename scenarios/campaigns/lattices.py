"""Makes the tables of lattices in docs/chapter.md from the tables of the three campaigns:

    python3 scenarios/campaigns/lattices.py runs/campaigns/lattices-12 runs/campaigns/lattices-30 runs/campaigns/lattices-open docs/chapter.md

What stands between the two marks of a table is replaced, if a campaign that it is of is named. Needs nothing but Python.
"""

import csv
import sys
from pathlib import Path


def table(heads, rows):
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def stuck(runs):
    """How many did not converge, of how many."""
    return f"{sum(run['converged'] == '0' for run in runs)} of {len(runs)}" if runs else "-"


def formed(runs):
    """One row for each graph of the campaigns `lattices-12` and `lattices-30`."""
    rows = []
    for graph in dict.fromkeys(run["graph"] for run in runs):
        robots, gap, edges = graph.removesuffix(".json").split("-", 2)
        of = {"constant": [], "closing": [], "replaced": []}
        for run in (run for run in runs if run["graph"] == graph):
            case = run["formation"]
            of["replaced" if "replaced" in case else "closing" if case == "closing" else "constant"].append(run)
        nearest = min(float(run["min_distance_over_d"]) for case in of.values() for run in case)
        counts = [stuck(of[case]) for case in of]
        rows.append([robots, gap, edges.replace("-", " "), *counts, f"{nearest:.2f}"])
    rows.sort(key=lambda row: (int(row[0]), float(row[1]), row[2] != "one way"))
    heads = ["robots", "gap / d", "edges", "of constant size: stuck", "with `closing`: stuck", "one replaced: stuck", "nearest / d"]
    return table(heads, rows)


def opened(runs):
    """One row for each scale of the campaign `lattices-open`."""
    lattices = list(dict.fromkeys(run["lattice"] for run in runs))
    rows = []
    for mean in sorted({float(run["scale.mean"]) for run in runs}):
        row = [f"{mean * 1.1:.1f}"]
        for lattice in lattices:
            here = [run for run in runs if run["lattice"] == lattice and float(run["scale.mean"]) == mean]
            times = [float(run["converged_at_s"]) for run in here if run["converged_at_s"]]
            row.append(f"{stuck(here)}; {max(times):.0f} s" if times else stuck(here))
        rows.append(row)
    return table(["gap / d", *lattices], rows)


def replaced(text, mark, new):
    begin, end = f"<!-- {mark} -->\n", f"<!-- /{mark} -->"
    before, rest = text.split(begin)
    return before + begin + new + end + rest.split(end)[1]


def read(folder):
    with open(Path(folder) / "runs.csv", newline="") as file:
        return list(csv.DictReader(file))


*folders, page = sys.argv[1:]
runs = [run for folder in folders for run in read(folder)]
text = Path(page).read_text()
for mark, rows, key in [("lattices", formed, "formation"), ("lattices-open", opened, "lattice")]:
    of_it = [run for run in runs if key in run]
    if of_it:
        text = replaced(text, mark, rows(of_it))
Path(page).write_text(text)
