"""Writes the graphs of this directory: `python3 lattices.py`.

The lattices have 12 robots in four columns or 30 in six, with gaps of 1.1, 1.2 and 1.5 times d = 0.2 m. Each robot receives from
its left and lower neighbors (`one-way`) or from all adjacent robots (`both-ways`). The campaign draws the start poses; the poses here
only keep the robots apart.
"""

import json
from pathlib import Path

D_M = 0.2
HERE = Path(__file__).parent

for robots, columns in [(12, 4), (30, 6)]:
    for gap in [1.1, 1.2, 1.5]:
        for ways in ["one-way", "both-ways"]:
            name = [f"r{i + 1}" for i in range(robots)]
            cells = [divmod(i, columns) for i in range(robots)]
            nodes = [
                {
                    "id": name[i],
                    "place_m": [round(gap * D_M * column, 3), round(gap * D_M * row, 3)],
                    "pose": {"x_m": 0.6 * column, "y_m": 0.6 * row, "heading_rad": 0.0},
                }
                for i, (row, column) in enumerate(cells)
            ]
            ahead = [(i - 1, i) for i in range(robots) if cells[i][1] > 0]
            ahead += [(i - columns, i) for i in range(robots) if cells[i][0] > 0]
            edges = ahead + ([(to, source) for source, to in ahead] if ways == "both-ways" else [])
            edges = [{"source": name[source], "target": name[to]} for source, to in edges]
            nodes, edges = (",\n".join(map(json.dumps, part)) for part in (nodes, edges))
            head = '{"directed": true, "multigraph": false, "graph": {}'
            text = f'{head}, "nodes": [\n{nodes}\n], "edges": [\n{edges}\n]}}\n'
            (HERE / f"{robots}-{gap}-{ways}.json").write_text(text)
