"""Writes antipodal-2.toml, -4, -8, -16, -32 and -64 into its own directory: `python3 antipodal.py`.

Robots start evenly spaced on a circle, and the goal of each is the opposite point, so that all straight paths cross in
the middle. The spacing is at least 0.4 m and the diameter at least 1.6 m. The duration is four times the travel time of
the straight path plus 20 s.
"""

import math
from pathlib import Path

FRONT_POINT_M = 0.045
SPEED_M_S = 0.2

for robots in (2, 4, 8, 16, 32, 64):
    radius = max(0.8, 0.2 / math.sin(math.pi / robots))
    duration = math.ceil(20 + 4 * 2 * radius / SPEED_M_S)
    rows = []
    for i in range(robots):
        angle = 2 * math.pi * i / robots
        heading = math.remainder(angle + math.pi, 2 * math.pi)
        x, y = (round((radius + FRONT_POINT_M) * f(angle), 6) + 0.0 for f in (math.cos, math.sin))
        goal = [round(-radius * f(angle), 6) + 0.0 for f in (math.cos, math.sin)]
        pose = f"{{ x_m = {x}, y_m = {y}, heading_rad = {heading:.6f} }}"
        rows.append(f'    {{ name = "r{i + 1}", goal_m = {goal}, pose = {pose} }},')
    text = f"""\
# {robots} robots on a circle, each with the opposite point as its goal. No robot receives from another.
# Written by antipodal.py.
name = "antipodal-{robots}"
duration_s = {duration}
period_s = 0.01

robot = [ # front points begin on the circle of {round(radius, 3)} m
{chr(10).join(rows)}
]

[avoidance] # with the gains of other kinds
distance_min_m = 0.2
speed_max_m_s = {SPEED_M_S}
epsilon_per_s = 2.0   # focus: the chapter's 2 mu / d
horizon_s = 2.0       # orca: tau
barrier_per_s = 2.0   # cbf-qp: gamma of its paper
cell_radius_m = 0.6   # rbl: r_s
spread_m = 0.1        # rbl: beta
approach_per_s = 10.0 # rbl: k

[robot_defaults]
front_point_m = 0.045
law = "goal-unit"
speed_m_s = {SPEED_M_S}

[expect]
min_distance_m = 0.2
converged_by_s = {duration}
converged_error_m = 0.05 # a quarter of d
"""
    Path(__file__).with_name(f"antipodal-{robots}.toml").write_text(text)
