#!/usr/bin/env python3
"""Swaps of robots with different sizes and speeds: writes swap-16.toml and swap-32.toml in this folder, and with `--run PHALANX` runs
the campaign in process and prints the makespan of the team beside that of robots that all keep the largest distance, and beside the
time that the robot with the longest way would need if it were alone.

Sizes (keep) are 0.07, 0.10 and 0.14 m and speed limits 0.39, 0.30 and 0.18 m/s, in turn. The makespan is the time from which on all
robots stay within 5 cm of their goals, as the median over seeds; a run in which a robot never arrives counts as longer than any other.
Exits with 1 if a pair came closer than it may.
"""

import argparse
import csv
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent))
from bodies import alone_s  # noqa: E402
KEEPS_M = [0.07, 0.10, 0.14]
SPEEDS_M_S = [0.39, 0.30, 0.18]
# Area for each robot, m^2.
AREA_M2 = 0.36
# Minimum distance of two starts, and so of two goals, m: closer than d_f = 0.295 m, two robots of the largest size do not both come to rest.
APART_M = 0.3

SCENARIO = """# {count} robots with three sizes and speed limits swap positions, controlled at their axle midpoints. Two robots keep the sum of
# their sizes. Written by swaps.py.
name = "swap-{count}"
duration_s = 240.0
period_s = 0.02
end_after_converged_s = 2.0

robot = [
{robots}]

[avoidance]
kind = "guard"
distance_min_m = 0.28 # the two largest robots
speed_max_m_s = 0.3

[robot_defaults]
front_point_m = 0.0
turn_rate_max_rad_s = 4.0
law = "goal-unit"
speed_m_s = 0.1

[expect]
min_distance_over_d = 1.0
"""


def write(count):
    """Writes the scenario with `count` robots on a circle; the campaign draws other starts and goals."""
    robots = ""
    radius_m = 0.4 * count / math.tau
    for i in range(count):
        x_m, y_m = (radius_m * part(math.tau * i / count) for part in (math.cos, math.sin))
        heading_rad = math.remainder(math.tau * i / count + math.pi, math.tau)
        robots += (f'    {{ name = "r{i + 1}", goal_m = [{-x_m:.6f}, {-y_m:.6f}], keep_m = {KEEPS_M[i % 3]:.2f}, '
                   f'speed_max_m_s = {SPEEDS_M_S[i % 3]:.2f}, '
                   f'pose = {{ x_m = {x_m:.6f}, y_m = {y_m:.6f}, heading_rad = {heading_rad:.6f} }} }},\n')
    (HERE / f"swap-{count}.toml").write_text(SCENARIO.format(count=count, robots=robots))


def makespans(rows):
    """Returns the number of arrived runs and of runs, and the median makespan in s."""
    times_s = [float(row["converged_at_s"] or "inf") for row in rows]
    return sum(math.isfinite(time_s) for time_s in times_s), len(times_s), statistics.median(times_s)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", metavar="PHALANX", help="the program, such as target/debug/phalanx")
    parser.add_argument("--seeds", type=int, default=8, help="runs of each kind [default: 8]")
    parser.add_argument("--jobs", type=int, default=1, help="runs at the same time [default: 1]")
    args = parser.parse_args()
    for count in (16, 32):
        write(count)
    if args.run:
        sys.exit(compare(args))


def compare(args):
    """Runs the campaign and prints the makespans. Returns the exit code."""
    sound = True
    for count in (16, 32):
        measured = {}
        for kind in ("by size", "one d"):
            with tempfile.TemporaryDirectory() as folder:
                rows, alone_times_s = sweep(args, count, kind, pathlib.Path(folder))
            arrived, runs, median_s = measured[kind] = makespans(rows)
            below = sum(int(row["violations"]) > 0 for row in rows)
            least = min(float(row["min_distance_over_d"]) for row in rows)
            sound &= below == 0
            print(f"{count} robots, {kind}: {arrived} of {runs} runs arrived, makespan {median_s:.1f} s, {below} runs below a "
                  f"minimum distance, smallest {least:.4f}", flush=True)
        by_size_s, one_d_s, bound_s = measured["by size"][2], measured["one d"][2], statistics.median(alone_times_s)
        print(f"{count} robots: {by_size_s / one_d_s:.2f} of the makespan with one d, of which {bound_s / one_d_s:.2f} is the least possible "
              f"({bound_s:.1f} s)", flush=True)
    return 0 if sound else 1


def sweep(args, count, kind, folder):
    """Runs the swaps of one kind. Returns the rows of the table of runs, and the times of robots that are alone, s."""
    side_m = math.sqrt(AREA_M2 * count)
    sizes = [f"robot.r{i + 1}.keep_m={max(KEEPS_M)}" for i in range(count)] if kind == "one d" else []
    sets = "".join(f"{key.split('=')[0]} = {key.split('=')[1]}\n" for key in sizes)
    (folder / "campaign.toml").write_text(
        f'name = "teams"\nscenario = "{HERE}/swap-{count}.toml"\nseeds = {args.seeds}\n'
        f'starts = {{ box_m = [{side_m:.4f}, {side_m:.4f}], apart_m = {APART_M}, goals = "swaps" }}\n' + ("[set]\n" + sets if sets else ""))
    command = [args.run, "sweep", folder / "campaign.toml", "--in-process", "--jobs", str(args.jobs), "--out", folder / "out"]
    ended = subprocess.run(command, capture_output=True, text=True)
    table = folder / "out" / "runs.csv"
    if not table.exists():
        sys.exit(f"{command}: {ended.stdout}{ended.stderr}")
    with table.open() as lines:
        rows = list(csv.DictReader(lines))
    scenarios = [folder / "out" / "runs" / row["run"] / "scenario.toml" for row in rows]
    return rows, [alone_s(tomllib.loads(scenario.read_text())) for scenario in scenarios]


if __name__ == "__main__":
    main()
