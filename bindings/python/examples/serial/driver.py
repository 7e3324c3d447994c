"""A driver for robots with a microcontroller on a serial line.

The lines, in ASCII:   to the robot    T v w                 m/s, rad/s: valid until the next one, at most 0.1 s
                       from it         P x y heading v w     m, m, rad, m/s, rad/s: every 10 ms

``devices.json`` has the device of each robot; "stub" starts stub.py behind a pseudo-terminal instead. Real time
only. docs/hardware.md lists all requirements of a driver.
"""

import atexit
import json
import math
import os
import pty
import subprocess
import sys
import time
import tty
from pathlib import Path

import phalanx

HERE = Path(__file__).parent
SILENT_S = 2.0  # maximum time without a message of a robot, after which the run ends
HEARD_WITHIN_S = 5.0  # maximum time until the first message of a robot
OFF_M, OFF_RAD = 0.05, 0.1  # maximum distance of a robot from its start pose in the scenario


class Line:
    """Serial line of one robot. It never blocks."""

    def __init__(self, robot, device):
        self.name, self.rest = robot.name, b""
        self.state, self.heard = None, -math.inf
        if device == "stub":
            self.fd = stub(robot)
        else:
            self.fd = os.open(device, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        os.set_blocking(self.fd, False)

    def send(self, v, w):
        try:
            os.write(self.fd, b"T %.5f %.5f\n" % (v, w))
        except BlockingIOError:
            pass  # the line is full; the robot stops if it gets no command

    def listen(self):
        """Reads the newest complete line."""
        try:
            while text := os.read(self.fd, 4096):
                self.rest += text
        except BlockingIOError:
            pass
        *lines, self.rest = self.rest.split(b"\n")
        for line in reversed(lines):
            words = line.split()
            if len(words) == 6 and words[0] == b"P":
                self.state, self.heard = [float(word) for word in words[1:]], time.monotonic()
                return


def stub(robot):
    """Starts a simulated robot, which ends with this process, and returns its line."""
    line, other_end = pty.openpty()
    tty.setraw(other_end)
    start = [str(number) for number in (robot.start.x_m, robot.start.y_m, robot.start.heading_rad)]
    subprocess.Popen([sys.executable, HERE / "stub.py", *start], stdin=other_end, stdout=other_end)
    os.close(other_end)
    return line


class Driver(phalanx.Plant):
    def __init__(self, robots):
        devices = json.loads((HERE / "devices.json").read_text())
        self.lines = [Line(robot, devices[robot.name]) for robot in robots]
        atexit.register(self.stop)
        began = time.monotonic()
        while any(line.state is None for line in self.lines):
            if time.monotonic() > began + HEARD_WITHIN_S:
                silent = [line.name for line in self.lines if line.state is None]
                raise RuntimeError(f"not heard within {HEARD_WITHIN_S} s: {', '.join(silent)}")
            time.sleep(0.001)
            for line in self.lines:
                line.listen()
        for line, robot in zip(self.lines, robots):
            x, y, heading, *_ = line.state
            turned = math.remainder(heading - robot.start.heading_rad, math.tau)
            if math.hypot(x - robot.start.x_m, y - robot.start.y_m) > OFF_M or abs(turned) > OFF_RAD:
                raise RuntimeError(f"{line.name} is at {x}, {y}, {heading}, not at its start")
        self.began, self.t = time.monotonic(), 0.0

    def step(self, twists, dt):
        now = time.monotonic()
        self.t += dt
        if self.t > now - self.began + 1.0:
            raise RuntimeError("robots cannot move faster than real time: run with --pace realtime")
        for line, (v, w) in zip(self.lines, twists):
            line.send(v, w)
            line.listen()
            if now - line.heard > SILENT_S:
                raise RuntimeError(f"{line.name} was not heard for {now - line.heard:.3f} s")
        return [line.state for line in self.lines]

    def stop(self):
        for line in self.lines:
            line.send(0.0, 0.0)


if __name__ == "__main__":
    phalanx.serve(Driver)
