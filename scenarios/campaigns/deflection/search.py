"""Optimizes the constants of the guard's avoidance steering (`agent/src/avoidance/deflection/constants.rs`):

    pip install cma
    cargo build --release --features tuning
    python3 scenarios/campaigns/deflection/search.py --minutes 30 --out search.csv

Uses CMA-ES over the logarithms of the constants, which a build with the feature `tuning` reads from the environment variable
PHALANX_DEFLECTION. The cost of a point is the mean cost of the runs of each cell of a training
campaign, averaged over the cells. The cost of a run is r = log(makespan / makespan of the best other method), plus
4 (r - log 0.97) if that is positive, plus a penalty on paths longer than 1.085 times the straight line in the ideal swaps
of 16 and 32 robots. The makespan of a run that never arrives is twice its duration. Each generation has new seeds, from
100,001 on, which docs/comparison.md does not use.
"""

import argparse
import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import cma

HERE = Path(__file__).resolve().parent
CAMPAIGNS = HERE.parent
ROOT = CAMPAIGNS.parent.parent

# Start value, minimum and maximum of each constant.
CONSTANTS = {
    "dither_rad": (0.1, 0.01, 2.0),
    "around": (0.3, 0.1, 2.0),
    "around_at_last": (1.6, 0.3, 4.0),
    "impatience_time": (0.9, 0.1, 5.0),
    "slack_share": (0.17, 0.03, 0.6),
    "margin": (1.9, 0.5, 4.0),
    "look_ahead": (3.3, 0.3, 8.0),
    "look_ahead_share": (1.7, 0.2, 6.0),
    "look_ahead_turn_rad": (0.75, 0.1, 2.0),
    "yield_share": (0.45, 0.05, 1.0),
    "yield_speed": (1.0, 0.1, 2.0),
    "yield_reach": (0.45, 0.2, 4.0),
}


def toml(value):
    """Returns a value as TOML in one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return json.dumps(value)


def best_others(page):
    """Returns the smallest median makespan of `orca`, `cbf-qp` and `rbl` for each cell of docs/comparison.md, s."""
    best, cell = {}, None
    for line in page.splitlines():
        if line.startswith(("###", "<!--")):
            head = re.match(r"### (Circle|Swaps), (\w+)$", line)
            cell = (head[1].lower(), head[2]) if head else None
        fields = [field.strip() for field in line.split("|")[1:-1]]
        if cell and len(fields) == 10 and fields[1] in ("`orca`", "`cbf-qp`", "`rbl`") and fields[7] != "never":
            key = (f"{cell[0]}-{fields[0]}", cell[1])
            best[key] = min(best.get(key, math.inf), float(fields[7]))
    return best


def training(seeds, only):
    """Returns the training campaign as TOML: scenes of the comparison in all conditions, denser ones under `ideal` and
    `radio`, scenes with walls, and lattices."""
    whole = tomllib.loads((CAMPAIGNS / "comparison.toml").read_text())
    scenes = [case for case in whole["case"] if case["axis"] == "scene" and not case["name"].endswith("-2")]
    conditions = [case for case in whole["case"] if case["axis"] == "condition"]
    for robots in (16, 32):
        side = round(math.sqrt(0.16 * robots), 3)
        starts = {"box_m": [side, side], "apart_m": 0.26, "goals": "swaps"}
        scenario = f"comparison/antipodal-{robots}.toml"
        scenes.append({"name": f"dense-{robots}", "scenario": scenario, "starts": starts})
    cells = []
    for scene in scenes:
        for condition in conditions:
            if scene["name"].startswith("dense") and condition["name"] not in ("ideal", "radio"):
                continue
            cell = {**scene, **condition, "axis": "cell", "name": f"{scene['name']}/{condition['name']}"}
            cell["set"] = {**condition.get("set", {}), **whole["set"]}
            cells.append(cell)
    for scene in ("corridor", "doorway", "warehouse", "intersection"):
        starts = {"box_m": [0.3, 0.3], "around": "each", "apart_m": 0.43}
        cells.append({"axis": "cell", "name": scene, "scenario": f"../{scene}.toml", "starts": starts})
    for graph in ("12-1.1-both-ways", "12-1.2-one-way"):
        cell = {"axis": "cell", "name": graph, "scenario": "../lattices/lattice.toml"}
        cell["starts"] = {"box_m": [2.4, 2.4], "apart_m": 0.25}
        cell["set"] = {"duration_s": 200.0, "scale": {"kind": "sine", "mean": 1.0}, "graph": f"{graph}.json"}
        cells.append(cell)
    for cell in cells:
        cell["scenario"] = str((CAMPAIGNS / cell["scenario"]).resolve())
    cells = [cell for cell in cells if re.search(only, cell["name"])]
    rows = "\n".join(f"    {toml(cell)}," for cell in cells)
    head = f'name = "training"\nscenario = {toml(cells[0]["scenario"])}\nseeds = {toml(seeds)}\n'
    return head + f"case = [\n{rows}\n]\n"


def run_cost(run, best):
    """Returns the cost of one run."""
    arrived = run["converged"] == "1"
    scene, _, condition = run["cell"].partition("/")
    walled = not condition
    lasts_s = 200.0 if walled else 90.0
    makespan_s = float(run["converged_at_s"]) if arrived else 2.0 * lasts_s
    other_s = best.get((scene, condition), 40.0)
    ratio = math.log(makespan_s / other_s)
    if (scene, condition) not in best:
        return ratio
    cost = ratio + 4.0 * max(0.0, ratio - math.log(0.97))
    if condition == "ideal" and scene in ("swaps-16", "swaps-32") and run["path_over_straight"]:
        cost += 8.0 * max(0.0, math.log(float(run["path_over_straight"]) / 1.085))
    return cost


def campaign_cost(values, seeds, best, args):
    """Runs the training campaign with these values of the constants and returns its cost."""
    with tempfile.TemporaryDirectory() as work:
        campaign, out = Path(work) / "training.toml", Path(work) / "out"
        campaign.write_text(training(seeds, args.only))
        environment = {**os.environ, "PHALANX_DEFLECTION": ",".join(f"{key}={value!r}" for key, value in values.items())}
        command = [args.phalanx, "sweep", campaign, "--in-process", "--out", out]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        if not (out / "runs.csv").exists():
            sys.exit(done.stderr)
        cells = {}
        for run in csv.DictReader((out / "runs.csv").open()):
            cells.setdefault(run["cell"], []).append(run_cost(run, best))
    return sum(sum(costs) / len(costs) for costs in cells.values()) / len(cells)


def values_at(point):
    values = {}
    for (key, (start, low, high)), x in zip(CONSTANTS.items(), point, strict=True):
        values[key] = float(f"{min(max(start * math.exp(x), low), high):.4g}")
    return values


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0, help="duration of the search")
    parser.add_argument("--seeds", type=int, default=4, help="number of runs of each cell at a point")
    parser.add_argument("--only", default="", help="regular expression that selects cells by name")
    parser.add_argument("--out", type=Path, default=Path("search.csv"), help="output file, with a row for each generation")
    parser.add_argument("--phalanx", default=str(ROOT / "target/release/phalanx"), help="path of the program")
    args = parser.parse_args()
    best = best_others((ROOT / "docs/comparison.md").read_text())
    options = {"popsize": 9, "seed": 1, "verbose": -9}
    search = cma.CMAEvolutionStrategy([0.0] * len(CONSTANTS), 0.25, options)
    until = time.monotonic() + 60.0 * args.minutes
    with args.out.open("w") as file:
        rows = csv.writer(file)
        rows.writerow(["generation", "least_cost", "mean_cost", *CONSTANTS])
        generation = 0
        while time.monotonic() < until:
            seeds = {"from": 100_001 + 1000 * generation, "count": args.seeds}
            points = search.ask()
            costs = [campaign_cost(values_at(point), seeds, best, args) for point in points]
            search.tell(points, costs)
            generation += 1
            mean = sum(costs) / len(costs)
            rows.writerow([generation, min(costs), mean, *values_at(search.mean).values()])
            file.flush()


if __name__ == "__main__":
    main()
