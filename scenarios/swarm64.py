"""Writes swarm64.json into its own directory: `python3 swarm64.py` (requires networkx 3.4 or newer).

The formation is a grid of 8 x 8 with gaps of 0.6 m. Each robot receives from the robots one step closer to the leader in
its row and in its column. The start positions are 0.75 m apart, with seeded random offsets of up to 0.15 m per axis.
"""

import json
import random
from pathlib import Path

import networkx as nx

LEADER = (3, 3)  # row (counted from the rear) and column (from the left)
draw = random.Random(64)


def step_toward(here, there):
    """Returns the index one step from `here` toward `there`."""
    return here + (there > here) - (there < here)


name = {(row, column): f"r{8 * row + column + 1}" for row in range(8) for column in range(8)}
name[LEADER] = "leader"

graph = nx.DiGraph()
for place, robot in name.items():
    ahead, right = place[0] - LEADER[0], place[1] - LEADER[1]
    # The trajectory starts at (6, 0) m along y; slots are in the leader's frame.
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
    for heard in [(step_toward(row, LEADER[0]), column), (row, step_toward(column, LEADER[1]))]:
        if heard != (row, column):
            graph.add_edge(name[heard], robot)

data = nx.node_link_data(graph, edges="edges")
nodes, edges = (",\n".join(map(json.dumps, data.pop(key))) for key in ("nodes", "edges"))
head = json.dumps(data).removesuffix("}")
text = f'{head}, "nodes": [\n{nodes}\n], "edges": [\n{edges}\n]}}\n'
Path(__file__).with_suffix(".json").write_text(text)
