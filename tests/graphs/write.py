"""Writes the graphs of this folder: python3 write.py FOLDER.

Needs networkx, numpy and pandas; networkx 3.4.2 wrote the committed files.
"""
import json
import math
import sys

import networkx as nx
import numpy as np
import pandas as pd
import numpy as np
import pandas as pd

out = sys.argv[1]
# The triangle of the chapter's first case: r1 receives from r2, r2 from r3, r3 from r1.
h = 0.2598076211353316
starts = {"r1": (-0.045, -0.35, 0.0), "r2": (0.4, 0.205, math.pi / 2), "r3": (-0.4, 0.295, -math.pi / 2)}
edges = [("r2", "r1", [0.15, h]), ("r3", "r2", [-0.3, 0.0]), ("r1", "r3", [0.15, -h])]
g = nx.DiGraph()
for name, (x, y, heading) in starts.items():
    g.add_node(name, pose={"x_m": x, "y_m": y, "heading_rad": heading})
for a, b, c in edges:
    g.add_edge(a, b, offset_m=c)
for spelling in ("edges", "links"):
    with open(f"{out}/triangle-{spelling}.json", "w") as f:
        json.dump(nx.node_link_data(g, edges=spelling), f, indent=1)
g = nx.DiGraph()
for name, (x, y, heading) in starts.items():
    g.add_node(name, x_m=x, y_m=y, heading_rad=heading, law="formation-unit", speed_m_s=0.1)
for a, b, (x, y) in edges:
    g.add_edge(a, b, offset_x_m=x, offset_y_m=y)
nx.write_graphml(g, f"{out}/triangle.graphml")
# Slots instead of offsets, and numbers instead of names.
places = {0: (0.0, 0.0), 1: (-0.15, -h), 2: (0.15, -h)}
g = nx.DiGraph()
g.add_nodes_from(places)
g.add_edges_from([(1, 0), (2, 1), (0, 2)])
with open(f"{out}/triangle-numbers.json", "w") as f:
    json.dump(nx.node_link_data(g, edges="edges"), f)
nx.write_graphml(g, f"{out}/triangle-numbers.graphml")
# networkx's matrix has A[i, j] = 1 for i -> j; that of (6) is its transpose: a_ij = 1 if i receives from j.
a = nx.to_numpy_array(g, nodelist=[0, 1, 2]).T
np.savetxt(f"{out}/triangle-matrix.csv", a, delimiter=",", fmt="%d")
names = ["r1", "r2", "r3"]
pd.DataFrame(a, index=names, columns=names).to_csv(f"{out}/triangle-names.csv")
# An undirected graph.
u = nx.Graph()
u.add_nodes_from(names)
u.add_edges_from([("r1", "r2"), ("r2", "r3"), ("r3", "r1")])
with open(f"{out}/all-hear-all.json", "w") as f:
    json.dump(nx.node_link_data(u, edges="edges"), f)
nx.write_graphml(u, f"{out}/all-hear-all.graphml")
