"""Leader election: heartbeats flood the ring, and the living robot with the smallest index leads."""

import phalanx


class Election(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.beats = [0.0] * self.robot.params["robots"]  # newest heartbeat of each robot
        self.heard_s = [-1.0] * len(self.beats)  # time at which it was received
        self.count = 0

    def gamma(self, situation):
        me, now = self.robot.index - 1, situation.t_s
        self.count += 1
        # A restarted robot counts above what it counted before.
        own = [b for b in self.beats]
        own[me] = 1e6 * self.robot.incarnation + self.count
        for beats in [own] + [n.message["beats"] for n in situation.neighbors if n.message]:
            for j, beat in enumerate(beats):
                if beat > self.beats[j]:
                    self.beats[j], self.heard_s[j] = beat, now
        self.publish(beats=self.beats)
        timeout_s = self.robot.params["timeout_s"]
        living = [j for j, heard_s in enumerate(self.heard_s) if now - heard_s <= timeout_s]
        x, y = self.robot.place
        goal = (x, y + 0.5) if living[0] == me else (x, y)  # the leader steps forward
        self.target(goal)
        return [self.k_per_s * (g - p) for g, p in zip(goal, situation.front_point)]


phalanx.serve(Election)
