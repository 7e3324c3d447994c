"""Finds the weights with the cross-entropy method, and writes them to policy.npy."""

from pathlib import Path

import numpy as np
import phalanx
from policy import twist

HERE = Path(__file__).parent
EPISODES, BEST, ROUNDS = 16, 4, 12

env = phalanx.parallel_env(HERE / "triangle.toml", action="twist", duration_s=8.0, period_s=0.02)
dice = np.random.default_rng(1)


def total_reward(weights, headings):
    """Returns minus the integral of the errors of all robots over an episode, m s."""
    starts = {name: {"pose": {"heading_rad": heading}} for name, heading in headings.items()}
    observations, _ = env.reset(seed=1, options={"overrides": {"robot": starts}})
    total = 0.0
    while env.agents:
        actions = {name: twist(weights, observations[name]) for name in env.agents}
        observations, rewards, _, _, _ = env.step(actions)
        total += sum(rewards.values())
    return total


mean, deviation = np.zeros((2, 2)), np.full((2, 2), 10.0)
for round in range(ROUNDS):
    headings = {name: dice.uniform(-3.1, 3.1) for name in env.possible_agents}
    candidates = dice.normal(mean, deviation, (EPISODES, 2, 2))
    rewards = [total_reward(weights, headings) for weights in candidates]
    best = candidates[np.argsort(rewards)[-BEST:]]
    mean, deviation = best.mean(axis=0), best.std(axis=0) + 0.2
    print(f"round {round + 1}: best reward {max(rewards):.2f} m s")
np.save(HERE / "policy.npy", mean)
