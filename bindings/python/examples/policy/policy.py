"""A policy with four parameters: maps the error of a robot to the twist that moves its front point to its slot."""

import numpy as np
import phalanx

OBSERVATION = phalanx.Observation(neighbors=1, near=4)
AT = {name: place for place, name in enumerate(OBSERVATION.names)}
TWIST_MAX = np.array([0.3, 0.3 / 0.045])  # the scenario's speed_max_m_s, and the same over front_point_m


def twist(weights, observation):
    """Returns the twist (v, w), m/s and rad/s, of the policy with these weights (2 by 2)."""
    x, y = observation[AT["error_x_m"]], observation[AT["error_y_m"]]
    c, s = observation[AT["heading_cos"]], observation[AT["heading_sin"]]
    error = np.array([c * x + s * y, c * y - s * x])  # ahead and to the left, m
    return TWIST_MAX * np.tanh(weights @ error)
