"""Steps the scenario named on the command line with the velocities of the built-in laws, in Python, and prints the
trajectory hash. The other arguments are assignments as for --set, and faults."""

import math
import sys

import numpy as np
import phalanx
from phalanx import real


def unit(mu, seen, period_s):
    """formation-unit. (18)"""
    _, ex, ey = seen[:3]
    longest = max(math.sqrt(ex * ex + ey * ey), 5.0 * mu * period_s * 2.0)
    return -mu * ex / longest, -mu * ey / longest


def tanh(k, seen, _):
    """formation-tanh and leader-tanh. (28)"""
    _, ex, ey, vx, vy = seen[:5]
    return -k * real.tanh(ex) + vx, -k * real.tanh(ey) + vy


def law(scenario, name):
    if "triangle" in scenario:
        return lambda seen, period_s: unit(0.1, seen, period_s)
    k = 2.0 if name == "r5" else 3.0
    return lambda seen, period_s: tanh(k, seen, period_s)


scenario, agents, *words = sys.argv[1:]
overrides = {key: value if key == "avoidance.kind" else float(value) for key, value in
             (word.split("=") for word in words if "=" in word)}
faults = [word for word in words if "=" not in word]
agents = None if agents == "all" else agents.split(",")
env = phalanx.parallel_env(scenario, agents=agents, faults=faults, **overrides)
observations, _ = env.reset()
laws = {name: law(scenario, name) for name in env.agents}
integral = dict.fromkeys(env.agents, 0.0)
while env.agents:
    actions = {name: np.array(laws[name](observations[name], env.period_s)) for name in env.agents}
    observations, rewards, *_ = env.step(actions)
    for name, reward in rewards.items():
        integral[name] += reward
        assert reward == -env.period_s * math.hypot(*observations[name][1:3])
print(env.trajectory_hash, sum(integral.values()))
