"""Distributed auction: robots and goals are matched by prices that the robots raise and compare with their neighbors."""

import math

import phalanx


class Auction(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.goals = self.robot.params["goals_m"]
        self.prices = [0.0] * len(self.goals)
        self.owners = [0.0] * len(self.goals)  # index of the highest bidder, from 1; 0 for none
        self.start = None

    def gamma(self, situation):
        self.start = self.start or situation.front_point
        me = float(self.robot.index)
        for message in (n.message for n in situation.neighbors if n.message):
            for j, bid in enumerate(zip(message["prices_m"], message["owners"])):
                if bid > (self.prices[j], self.owners[j]):
                    self.prices[j], self.owners[j] = bid
        if me not in self.owners:
            values = [-math.dist(self.start, goal) - price for goal, price in zip(self.goals, self.prices)]
            best, second = sorted(values)[-1:-3:-1]
            j = values.index(best)
            self.prices[j] += best - second + self.robot.params["epsilon_m"]
            self.owners[j] = me
        self.publish(prices_m=self.prices, owners=self.owners)
        goal = self.goals[self.owners.index(me)]
        self.target(goal)
        return [self.k_per_s * (g - p) for g, p in zip(goal, situation.front_point)]


phalanx.serve(Auction)
