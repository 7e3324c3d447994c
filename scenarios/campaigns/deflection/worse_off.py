#!/usr/bin/env python3
"""Prints the robots that a new build leaves farther from their slots than an old one, after each single kill and cut.

    worse_off.py OLD NEW     two `phalanx` binaries

Runs nine shipped scenarios with 173 permanent faults at half of the duration, in process. Exits with 1 if a robot that
ends within 1 cm of its slot in the old build does not in the new one. Takes about one minute.
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

SCENARIOS = pathlib.Path(__file__).resolve().parents[2]
NAMES = "containment escort lattice-12 line-5 pentagon ring-6 standing-leaders swap-8 triangle".split()
OFF_M = 0.01
FARTHER_M = 0.005


def faults_of(scenario):
    """Returns a kill of each robot and a cut of each edge, at half of the duration."""
    robots, at_s = scenario["robot"], scenario["duration_s"] / 2
    edges = [(edge["from"], edge["to"]) for edge in scenario.get("edge", [])]
    edges += [(heard, robot["name"]) for robot in robots for heard in robot.get("hears", [])]
    kills = [f"kill {robot['name']} @{at_s}" for robot in robots]
    return kills + [f"cut {a}->{b} @{at_s}" for a, b in edges]


def final_errors(phalanx, name, faults, folder):
    """Returns the final distance of each robot from its slot, m, as a dict for each fault; None for robots that are dead."""
    campaign, out = folder / f"{name}.toml", folder / name
    cases = [f'{{ axis = "fault", name = "{i}", faults = ["{fault}"] }},\n' for i, fault in enumerate(faults)]
    path = SCENARIOS / f"{name}.toml"
    campaign.write_text(f'name = "{name}"\nscenario = "{path}"\nseeds = 1\ncase = [\n{"".join(cases)}]\n[set]\nexpect = {{}}\n')
    subprocess.run([phalanx, "sweep", campaign, "--in-process", "--out", out], check=True, capture_output=True)
    errors = {}
    with open(out / "runs.csv") as table:
        for row in csv.DictReader(table):
            (summary,) = out.glob(f"**/{row['run']}*/summary.json")
            errors[int(row["fault"])] = dict(json.loads(summary.read_text())["final_ideal_error_m"])
    return errors


def main(old, new):
    counts = dict.fromkeys(["robots", "lost their slots", "farther", "nearer"], 0)
    for name in NAMES:
        faults = faults_of(tomllib.loads((SCENARIOS / f"{name}.toml").read_text()))
        with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
            before = final_errors(old, name, faults, pathlib.Path(one))
            after = final_errors(new, name, faults, pathlib.Path(other))
        for i, fault in enumerate(faults):
            for robot, then in before[i].items():
                now = after[i][robot]
                if then is None or now is None:
                    continue
                lost = then <= OFF_M < now
                counts["robots"] += 1
                counts["lost their slots"] += lost
                counts["farther"] += now > then + FARTHER_M
                counts["nearer"] += now < then - FARTHER_M
                if lost or now > then + FARTHER_M:
                    print(f"{name}, {fault}: {robot} {then:.4f} m, now {now:.4f} m{', lost its slot' if lost else ''}")
    print(", ".join(f"{count} {what}" for what, count in counts.items()))
    return int(counts["lost their slots"] > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
