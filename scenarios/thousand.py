"""Writes thousand.json. With the `samples.csv` of a run without faults, it also prints the faults of thousand.toml:

    python3 thousand.py
    phalanx run thousand.toml --pace lockstep --set 'fault=[]' --out calm
    python3 thousand.py calm/samples.csv

1,024 robots form a five-pointed star. The slots are the points of a triangular lattice that lie deepest in the star. The
start of each robot is on the ray from the center to its slot, so that together they begin as a disc, with seeded random
offsets and headings. Each robot receives from the two robots that are nearest to the center among those within REACH_M of
it. Times and robots of the kills are random; a robot is not killed near the slot of another one, which it would block
for the rest of the run.
"""

import csv
import json
import random
import sys
from math import cos, dist, hypot, pi, sin
from pathlib import Path

ROBOTS = 1024
GAP_M = 0.8  # between two slots
REACH_M = 2.5  # between a robot and its in-neighbors
JITTER_M = 0.04
ROUNDNESS = 0.8  # of the start: 1 is a disc, 0 is the star
KILLS = 51  # 5 %
KILLED_S = (4.0, 24.0)
CLEAR_M = 0.45  # between a killed robot and the slots of others
LATE_S = 2.0  # difference between the times at which a robot passes a point in two runs
NOTCH = 0.5  # distance of the star's inner corners from its center, if that of its tips is 1
HEADINGS = 3.14
OFFSET_M = 0.1  # of the front point

draw = random.Random(ROBOTS)
corners = [
    (radius * cos(angle), radius * sin(angle))
    for k in range(5)
    for radius, angle in [(1, pi / 2 + 2 * k * pi / 5), (NOTCH, pi / 2 + (2 * k + 1) * pi / 5)]
]


def size(x, y):
    """Returns the size of the star on whose edge the point lies."""
    sides = zip(corners, corners[1:] + corners[:1])
    # A side is crossed by the ray of the point if the point lies between the rays of its ends.
    for (ax, ay), (bx, by) in sides:
        whole = ax * by - ay * bx
        a, b = (x * by - y * bx) / whole, (ax * y - ay * x) / whole
        if a >= -1e-12 and b >= -1e-12:
            return a + b
    raise AssertionError("the rays of the sides cover the plane")


lattice = [
    (round(GAP_M * (column + row % 2 / 2), 3), round(GAP_M * 3**0.5 / 2 * row, 3))
    for row in range(-40, 41)
    for column in range(-40, 41)
]
slots = sorted(lattice, key=lambda at: (round(size(*at), 6), at))[:ROBOTS]
star = max(size(*at) for at in slots)
disc = 1.45 * (ROBOTS * GAP_M**2 * 3**0.5 / 2 / pi) ** 0.5


def begin(x, y):
    """Returns the start of the robot with this slot."""
    radius = hypot(x, y)
    if radius == 0:
        return x, y
    round_factor = disc * size(x, y) / (star * radius)
    factor = ROUNDNESS * round_factor + 1 - ROUNDNESS
    return tuple(factor * at + draw.uniform(-JITTER_M, JITTER_M) for at in (x, y))


names = [f"r{k + 1}" for k in range(ROBOTS)]
starts = [begin(*slot) for slot in slots]
nodes, edges = [], []
for name, slot, (x, y) in zip(names, slots, starts):
    heading = round(draw.uniform(-HEADINGS, HEADINGS), 2)
    pose = {
        "x_m": round(x - OFFSET_M * cos(heading), 3),
        "y_m": round(y - OFFSET_M * sin(heading), 3),
        "heading_rad": heading,
    }
    nodes.append({"id": name, "place_m": slot, "pose": pose})
    near = [
        other
        for other in range(ROBOTS)
        if dist(slots[other], slot) <= REACH_M and hypot(*slots[other]) < hypot(*slot) - 0.2
    ]
    near.sort(key=lambda other: (round(hypot(*slots[other]), 3), other))
    edges += [{"source": names[other], "target": name} for other in near[:2]]


listed = [",\n".join(map(json.dumps, part)) for part in (nodes, edges)]
head = '{"directed": true, "multigraph": false, "graph": {}'
text = f'{head}, "nodes": [\n{listed[0]}\n], "edges": [\n{listed[1]}\n]}}\n'
Path(__file__).with_suffix(".json").write_text(text)

if len(sys.argv) > 1:
    paths = {name: [] for name in names}
    with open(sys.argv[1], newline="") as samples:
        for row in csv.DictReader(samples):
            t_s, *at = (float(row[key]) for key in ("t_s", "front_x_m", "front_y_m"))
            paths[row["robot"]].append((t_s, at))
    kills = {}
    while len(kills) < KILLS:
        robot, time_s = draw.randrange(1, ROBOTS), round(draw.uniform(*KILLED_S), 1)
        places = [at for t_s, at in paths[names[robot]] if abs(t_s - time_s) <= LATE_S]
        others = [slot for other, slot in enumerate(slots) if other != robot]
        if robot not in kills and min(dist(at, slot) for at in places for slot in others) > CLEAR_M:
            kills[robot] = time_s
    for robot, time_s in sorted(kills.items(), key=lambda kill: kill[1]):
        print(f'    {{ kind = "kill", robot = "{names[robot]}", at_s = {time_s} }},')
