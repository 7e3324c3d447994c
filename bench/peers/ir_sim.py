#!/usr/bin/env python3
"""Compares the processor time per robot and step of ir-sim and of Phalanx in lockstep.

In both, N differential-drive robots on a circle swap positions with the opposite robots.
- ir-sim runs in one Python process with steps of 0.1 s, without a display and without its collision check. With
  `--behavior rvo` (default) each robot avoids all others by reciprocal velocity obstacles; with `dash` no robot avoids
  another. Only `env.step()` is timed, after a warm-up.
- Phalanx runs N + 2 processes with steps of 5 ms, the guard, samples over iceoryx2, metrics and recording. Its time is
  that of all processes, including the start-up.
The work is similar but not equal: avoidance method, language and isolation differ. One step of ir-sim covers 20 steps of
Phalanx; multiply by the number of steps to compare simulated seconds.

    python3 -m venv target/peers
    target/peers/bin/pip install -r bench/peers/requirements.txt
    cargo build --profile dist
    target/peers/bin/python bench/peers/ir_sim.py --phalanx target/dist/phalanx
"""

import argparse
import contextlib
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PERIOD_S = 0.005
# Radius of a robot in ir-sim, m.
RADIUS_M = 0.1


def ir_sim_us(robots, steps, behavior):
    """Returns the processor time of ir-sim per robot and step, us, after a tenth of the steps as warm-up."""
    with contextlib.redirect_stdout(sys.stderr):  # it prints messages about missing displays
        import irsim

    circle_m = max(2.0, 0.6 * robots / math.tau)
    side_m = 2 * circle_m + 2
    position_m = lambda k, turn: (
        side_m / 2 + circle_m * math.cos(math.tau * k / robots + turn),
        side_m / 2 + circle_m * math.sin(math.tau * k / robots + turn),
    )
    states = [[*position_m(k, 0.0), math.tau * k / robots + math.pi] for k in range(robots)]
    goals = [[*position_m(k, math.pi), 0.0] for k in range(robots)]
    world = {
        "world": {
            "height": side_m, "width": side_m, "step_time": 0.1, "sample_time": 0.1,
            "collision_mode": "unobstructed",
        },
        "robot": [{
            "number": robots,
            "distribution": {"name": "manual"},
            "kinematics": {"name": "diff"},
            "shape": {"name": "circle", "radius": RADIUS_M},
            "vel_min": [-0.3, -3.0], "vel_max": [0.3, 3.0],
            "behavior": {"name": behavior},
            "state": states, "goal": goals,
        }],
    }
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "world.yaml"
        file.write_text(json.dumps(world))  # JSON is YAML
        env = irsim.make(str(file), display=False, disable_all_plot=True, log_level="ERROR")
        robot_count = len(env.robot_list)
        if robot_count != robots:
            sys.exit(f"error: ir-sim created {robot_count} robots, must be {robots}")
        for _ in range(max(1, steps // 10)):
            env.step()
        start_states = [robot.state.copy() for robot in env.robot_list]
        start_s = time.process_time()
        for _ in range(steps):
            env.step()
        used_s = time.process_time() - start_s
        end_states = [robot.state for robot in env.robot_list]
        moved_m = min(math.dist(a[:2, 0], b[:2, 0]) for a, b in zip(start_states, end_states))
        env.end(0)
        if moved_m == 0.0:
            sys.exit("error: a robot of ir-sim did not move: nothing was measured")
    return 1e6 * used_s / steps / robots


def phalanx_us(phalanx, robots, ticks):
    """Returns the processor time of all processes of a lockstep run per robot and step, us, from its summary."""
    circle_m = max(0.8, 0.6 * robots / math.tau)
    lines = [
        'name = "swap"', f"duration_s = {ticks * PERIOD_S:.6f}", f"period_s = {PERIOD_S}",
        "[avoidance]", 'kind = "guard"', "distance_min_m = 0.2", "speed_max_m_s = 0.3",
        "[robot_defaults]", "front_point_m = 0.045", 'law = "formation-unit"', "speed_m_s = 0.1",
    ]
    for k in range(robots):
        angle = math.tau * k / robots
        x_m, y_m = math.cos(angle), math.sin(angle)
        in_neighbors = f'"r{(k - 1) % robots + 1}", "r{(k + 1) % robots + 1}"'
        start_m = circle_m + 0.045
        heading = math.remainder(angle + math.pi, math.tau)
        lines += [
            "[[robot]]", f'name = "r{k + 1}"', f"hears = [{in_neighbors}]",
            f"place_m = [{-circle_m * x_m:.6f}, {-circle_m * y_m:.6f}]",
            f"pose = {{ x_m = {start_m * x_m:.6f}, y_m = {start_m * y_m:.6f}, "
            f"heading_rad = {heading:.6f} }}",
        ]
    with tempfile.TemporaryDirectory() as directory:
        file, out = Path(directory) / "swap.toml", Path(directory) / "run"
        file.write_text("\n".join(lines) + "\n")
        command = [phalanx, "run", file, "--pace", "lockstep", "--output=json", "--out", out]
        result = subprocess.run(command, capture_output=True, text=True, timeout=300)
        if result.returncode != 0:
            sys.exit(f"error: phalanx exited with code {result.returncode}\n{result.stderr}")
        summary = json.loads((out / "summary.json").read_text())
    # Idle-priority spinners, which keep cores awake, use only idle processor time and are not counted.
    counted = [process for process in summary["wall"]["processes"] if process["name"] != "awake"]
    used_s = sum(process["user_s"] + process["system_s"] for process in counted)
    return 1e6 * used_s / summary["ticks"] / robots


def format_spread(values):
    """Returns median, minimum and maximum as text."""
    return f"{statistics.median(values):.1f} ({min(values):.1f}-{max(values):.1f})"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--phalanx", default="target/dist/phalanx")
    parser.add_argument("--robots", type=int, nargs="+", default=[8, 20, 50])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--ticks", type=int, default=4000)
    parser.add_argument("--behavior", choices=["dash", "rvo"], default="rvo")
    args = parser.parse_args()
    print(f"{time.strftime('%Y-%m-%d')}, {os.cpu_count()} cores, ir-sim `{args.behavior}`, "
          f"{args.rounds} alternating rounds, load average {os.getloadavg()[0]:.2f}\n")
    print("| processor time per robot and step, us | ir-sim | Phalanx, all | ir-sim / Phalanx |")
    print("|---|---|---|---|")
    for robots in args.robots:
        ir_sim_values, phalanx_values = [], []
        for _ in range(args.rounds):
            ir_sim_values.append(ir_sim_us(robots, args.steps, args.behavior))
            phalanx_values.append(phalanx_us(args.phalanx, robots, args.ticks))
        ratio = [ir_sim / phalanx for ir_sim, phalanx in zip(ir_sim_values, phalanx_values)]
        print(f"| {robots} robots | {format_spread(ir_sim_values)} | {format_spread(phalanx_values)} | {format_spread(ratio)} |", flush=True)


if __name__ == "__main__":
    main()
