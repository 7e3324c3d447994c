"""Writes swarm64.json beside itself: `python3 swarm64.py` (networkx 3.4 or newer).

A grid of 8 x 8 with gaps of 0.6 m. Each robot hears those one step nearer to the leader, along its
row and along its column. They start 0.75 m apart, give or take up to 0.15 m by a seed.
"""

import json
import random
from pathlib import Path

import networkx as nx

LEADER = (3, 3)  # row (counted from the rear) and column (from the left)
draw = random.Random(64)


def nearer(here, there):
    """One step from here to there, in a row or column."""
    return here + (there > here) - (there < here)


name = {(row, column): f"r{8 * row + column + 1}" for row in range(8) for column in range(8)}
name[LEADER] = "leader"

graph = nx.DiGraph()
for place, robot in name.items():
    ahead, right = place[0] - LEADER[0], place[1] - LEADER[1]
    # The trajectory begins at (6, 0) m, along y; places are in the leader's frame.
    start = [6.0 + 0.75 * right, 0.75 * ahead]
    start = [round(at + draw.uniform(-0.15, 0.15), 2) for at in start]
    heading = round(draw.uniform(-3.14, 3.14), 2)
    attributes = {}
    if place == LEADER:
        start, heading, attributes = [6.0, -0.1], 1.570796, {"law": "leader-tanh"}
    graph.add_node(
        robot,
        place_m=[round(0.6 * ahead, 1), round(0.6 * -right, 1)],
        pose={"x_m": start[0], "y_m": start[1], "heading_rad": heading},
        **attributes,
    )
for (row, column), robot in name.items():
    for heard in [(nearer(row, LEADER[0]), column), (row, nearer(column, LEADER[1]))]:
        if heard != (row, column):
            graph.add_edge(name[heard], robot)

data = nx.node_link_data(graph, edges="edges")
nodes, edges = (",\n".join(map(json.dumps, data.pop(key))) for key in ("nodes", "edges"))
head = json.dumps(data).removesuffix("}")
text = f'{head}, "nodes": [\n{nodes}\n], "edges": [\n{edges}\n]}}\n'
Path(__file__).with_suffix(".json").write_text(text)
