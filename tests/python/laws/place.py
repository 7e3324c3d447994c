"""A controller that goes to its slot by the inverse of the front point's map. (17)"""

import math

import phalanx


class Place(phalanx.Controller):
    def __init__(self, k_per_s):
        self.k = k_per_s

    def twist(self, odometry, neighbors, t_s):
        (ex, ey), (vx, vy) = odometry.error, odometry.desired_velocity
        ux, uy = vx - self.k * ex, vy - self.k * ey
        heading = odometry.pose.heading_rad
        v = math.cos(heading) * ux + math.sin(heading) * uy
        w = (math.cos(heading) * uy - math.sin(heading) * ux) / odometry.front_point_m
        return v, w


phalanx.serve(Place)
