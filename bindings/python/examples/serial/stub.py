"""A simulated robot on a serial line: ``python3 stub.py X Y HEADING``, with stdin and stdout as the line.

It does what the firmware of a real robot must do: v and w reach the commanded twist together, within the
acceleration limits of the wheels; and the robot stops after 0.1 s without a command.
"""

import math
import os
import select
import sys
import time

PERIOD_S = 0.01
WATCHDOG_S = 0.1
ACCELERATIONS = 2.5, 3.2  # m/s^2, rad/s^2: a TurtleBot3 Burger's


def main():
    x, y, heading = map(float, sys.argv[1:])
    v = w = 0.0
    target, told, rest = (0.0, 0.0), -math.inf, b""
    last = time.monotonic()
    while True:
        readable, _, _ = select.select([0], [], [], max(0.0, last + PERIOD_S - time.monotonic()))
        if readable:
            text = os.read(0, 4096)
            if not text:
                return  # the line is closed
            *lines, rest = (rest + text).split(b"\n")
            for words in (line.split() for line in lines):
                if len(words) == 3 and words[0] == b"T":
                    target, told = (float(words[1]), float(words[2])), time.monotonic()
        now = time.monotonic()
        if now < last + PERIOD_S:
            continue
        dt, last = now - last, now
        goal = target if now - told < WATCHDOG_S else (0.0, 0.0)
        change = goal[0] - v, goal[1] - w
        needed = max(abs(change[0]) / ACCELERATIONS[0], abs(change[1]) / ACCELERATIONS[1])
        share = min(1.0, dt / needed) if needed else 1.0
        v, w = v + share * change[0], w + share * change[1]
        x, y = x + v * dt * math.cos(heading + w * dt / 2), y + v * dt * math.sin(heading + w * dt / 2)
        heading = math.remainder(heading + w * dt, math.tau)
        os.write(1, b"P %.5f %.5f %.5f %.5f %.5f\n" % (x, y, heading, v, w))


if __name__ == "__main__":
    try:
        main()
    except (OSError, KeyboardInterrupt):
        pass  # the other end of the line is closed
