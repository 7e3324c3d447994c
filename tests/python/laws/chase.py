"""A controller that drives at the nearest robot at maximum speed."""

import math

import phalanx


class Chase(phalanx.Controller):
    def twist(self, odometry, neighbors, t_s):
        if not odometry.near:
            return 0.3, 0.0
        x, y = odometry.near[0]
        to = math.atan2(y - odometry.pose.y_m, x - odometry.pose.x_m)
        turn = math.remainder(to - odometry.pose.heading_rad, 2.0 * math.pi)
        return 10.0 * math.cos(turn), 10.0 * math.sin(turn) / odometry.front_point_m


phalanx.serve(Chase)
