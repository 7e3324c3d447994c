"""Trained policy: a neural network that maps the error of a robot to the twist of its body."""

import json
from pathlib import Path

import phalanx
from phalanx.real import tanh

OBSERVATION = phalanx.Observation(neighbors=1, near=0)
AT = {name: place for place, name in enumerate(OBSERVATION.names)}


def layer(weights, inputs):
    return [tanh(sum(w * x for w, x in zip(row, inputs))) for row in weights]


class Policy(phalanx.Controller):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.network = json.loads(Path("weights.json").read_text())

    def twist(self, odometry, neighbors, t_s):
        seen = OBSERVATION(odometry, neighbors)
        x, y, c, s = (seen[AT[name]] for name in ("error_x_m", "error_y_m", "heading_cos", "heading_sin"))
        error = [c * x + s * y, c * y - s * x]  # ahead and to the left, m
        v, w = layer(self.network["output"], layer(self.network["hidden"], error))
        return self.v_max_m_s * v, self.w_max_rad_s * w


phalanx.serve(Policy)
