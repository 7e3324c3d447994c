#!/usr/bin/env python3
"""Prints the table of docs/explanation/bodies.md from the results of the campaign `bodies.toml`:

    python3 scenarios/campaigns/bodies.py runs/campaigns/bodies

Each cell has the median time to arrive in s, and its ratio to that of the front point in the same scene. The row "lower bound" has the
time that the robot with the longest way would need if it were alone, and drove to its goal in a straight line at the speed of its
law: no avoidance that keeps this speed can be faster. Requires Python 3.11.
"""

import csv
import math
import statistics
import sys
import tomllib
from pathlib import Path


def alone_s(scenario):
    """Returns the time after which the last robot would be within the error that counts as arrived, s."""
    defaults, tolerance_m = scenario["robot_defaults"], scenario.get("expect", {}).get("converged_error_m", 0.05)
    times_s = []
    for robot in (defaults | robot for robot in scenario["robot"]):
        pose, ahead_m = robot["pose"], robot["front_point_m"]
        start = [pose["x_m"] + ahead_m * math.cos(pose["heading_rad"]), pose["y_m"] + ahead_m * math.sin(pose["heading_rad"])]
        times_s.append((math.dist(start, robot["goal_m"]) - tolerance_m) / robot["speed_m_s"])
    return max(times_s)


def main(results):
    with (results / "runs.csv").open() as lines:
        runs = list(csv.DictReader(lines))
    scenes, bodies = (list(dict.fromkeys(run[axis] for run in runs)) for axis in ("scene", "body"))
    measured = {(scene, body): [] for scene in scenes for body in bodies}
    alone = {scene: [] for scene in scenes}
    for run in runs:
        measured[run["scene"], run["body"]].append(float(run["converged_at_s"] or "inf"))
        if run["body"] == "front":
            alone[run["scene"]].append(alone_s(tomllib.loads((results / "runs" / run["run"] / "scenario.toml").read_text())))
    print("|", *scenes, sep=" | ", end=" |\n")
    print("|---" * (1 + len(scenes)), end="|\n")
    print("| lower bound", *(f"{statistics.median(alone[scene]):.1f}" for scene in scenes), sep=" | ", end=" |\n")
    for body in bodies:
        medians_s = [(statistics.median(measured[scene, body]), statistics.median(measured[scene, "front"])) for scene in scenes]
        print(f"| {body}", *(f"{own:.1f} ({own / front:.2f})" for own, front in medians_s), sep=" | ", end=" |\n")
    late = sum(math.isinf(time_s) for times_s in measured.values() for time_s in times_s)
    print(f"\n{len(runs)} runs; in {late} a robot did not arrive")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
