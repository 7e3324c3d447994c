"""Writes swaps-128.toml into its own directory: `python3 swaps-128.py`.

128 TurtleBot3 Burgers and 30 discs in a square; random pairs of robots swap their positions. Front points start at
least 0.65 m apart and 0.5 m from each disc.
"""

import math
import random
from pathlib import Path

ROBOTS, DISCS, HALF_SIDE_M = 128, 30, 7.5
FRONT_M = 0.1  # distance of the Burger's front point (off-axis point) from the axle
draw = random.Random(128)


def draw_point(half_side):
    """Draws a point that is uniformly distributed in a square."""
    return [draw.uniform(-half_side, half_side) for _ in "xy"]


discs, places = [], []
while len(discs) < DISCS:
    center, radius = draw_point(HALF_SIDE_M - 1.0), draw.uniform(0.15, 0.45)
    # The gap between any two discs lets two robots pass each other.
    if all(math.dist(center, other) > radius + size + 1.1 for other, size in discs):
        discs.append((center, radius))
while len(places) < ROBOTS:
    place = draw_point(HALF_SIDE_M)
    clear = all(math.dist(place, center) > radius + 0.5 for center, radius in discs)
    if clear and all(math.dist(place, other) > 0.65 for other in places):
        places.append(place)

order = draw.sample(range(ROBOTS), ROBOTS)
partner = {a: b for pair in zip(order[::2], order[1::2]) for a, b in (pair, pair[::-1])}

robots = []
for i, (x, y) in enumerate(places):
    heading = round(draw.uniform(-3.14, 3.14), 2)
    x, y = x - FRONT_M * math.cos(heading), y - FRONT_M * math.sin(heading)
    goal = [round(at, 2) for at in places[partner[i]]]
    pose = f"{{ x_m = {x:.6f}, y_m = {y:.6f}, heading_rad = {heading} }}"
    robots.append(f'    {{ name = "r{i + 1}", goal_m = {goal}, pose = {pose} }},')
discs = [
    f'    {{ kind = "disc", center_m = [{x:.2f}, {y:.2f}], radius_m = {radius:.2f} }},'
    for (x, y), radius in discs
]
newline = "\n"
Path(__file__).with_suffix(".toml").write_text(f"""\
# 128 TurtleBot3 Burgers among 30 discs; 64 random pairs swap places while some robot is killed every second and
# restarted a second later. Written by swaps-128.py.
name = "swaps-128"
duration_s = 300.0
period_s = 0.02
seed = 1

chaos = {{ mean_time_between_kills_s = 1.0, restart_after_s = 1.0, from_s = 5.0, until_s = 215.0 }}
robot = [ # whose place is the goal
{newline.join(robots)}
]
obstacle = [
{newline.join(discs)}
]

[avoidance]
kind = "guard"
distance_min_m = 0.42
clearance_m = 0.21
speed_max_m_s = 0.22

[robot_defaults]
model = "turtlebot3-burger"
law = "goal-unit" # (18), of a goal
speed_m_s = 0.15

[expect]
min_distance_m = 0.42
min_clearance_m = 0.21
""")
