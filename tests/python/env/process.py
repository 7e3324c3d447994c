"""A law that prints the observation of r1 at 0.5 s, in an environment (`env`) or in a process."""

import sys

import phalanx


def show(numbers):
    print("seen:", " ".join(map(repr, numbers)), flush=True)


def gamma(situation):
    return -situation.error[0], -situation.error[1]


class Shows(phalanx.Law):
    def gamma(self, situation):
        if abs(situation.t_s - 0.5) < 1e-9:
            show(phalanx.Observation(neighbors=1, near=4)(situation))
        return gamma(situation)


if sys.argv[1:2] == ["env"]:
    env = phalanx.parallel_env(sys.argv[2])
    env.reset()
    situation = env.situation("r1")
    while situation is None or situation.t_s < 0.5 - 1e-9:
        seen = {name: env.situation(name) for name in env.agents}
        observations = env.step({name: gamma(s) if s else (0, 0) for name, s in seen.items()})[0]
        situation = env.situation("r1")
    assert list(observations["r1"]) == env.observation(situation)
    show(observations["r1"].tolist())
else:
    phalanx.serve(Shows)
