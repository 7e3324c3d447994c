"""Steps a law with messages in an environment, and prints the trajectory hash, and a copy's hash.

``messages.py SCENARIO``: the file ``law.py`` beside the scenario has the law of all robots.
"""

import copy
import os
import runpy
import sys
import tomllib

import phalanx

scenario = sys.argv[1]
laws = []
phalanx.serve = laws.append  # the file of a law ends in this call
runpy.run_path(os.path.join(os.path.dirname(scenario), "law.py"))
with open(scenario, "rb") as file:
    text = tomllib.load(file)
(law,) = text["laws"].values()
gains = {key: text["robot_defaults"][key] for key in law["gains"]}


class Calls:
    """Passes the calls of a law on to the environment."""

    def __init__(self, env, agent):
        self.publish = lambda data, **arrays: env.publish(agent, **arrays)
        self.withhold = lambda: env.withhold(agent)


def finish(env, robots):
    while env.agents:
        actions = {}
        for agent in env.agents:
            robots[agent]._outbox = Calls(env, agent)
            actions[agent] = robots[agent].gamma(env.situation(agent))
        env.step(actions)
        if len(env._actions) == 100:
            yield copy.deepcopy(env), {agent: copy.copy(robot) for agent, robot in robots.items()}
    yield env.trajectory_hash


env = phalanx.parallel_env(scenario, duration_s=5.0)
env.reset()
at_one_second, whole = finish(env, {agent: laws[0](**gains) for agent in env.possible_agents})
*_, again = finish(*at_one_second)
assert again == whole, (again, whole)
print(whole)
