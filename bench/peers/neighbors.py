#!/usr/bin/env python3
"""From a neighbor's publication to its use: Phalanx, bare iceoryx2, Unix datagrams, zenoh.

What is compared: N processes on a ring, each of which hears the next four (or all others), wakes by
its own absolute timer at 100 Hz or 1 kHz, and publishes 120 bytes, as a beacon has. All have the
same graph, rates and phases.
- Phalanx: a real run (`beacon_delivery`), with brains, plant, recording and supervisor.
- iceoryx2, datagrams, zenoh: the same loop without brains. zenoh 1.10 from Rust, for a client in
  Python would measure Python: peers over TCP on the loopback interface, no multicast, no gossip,
  express, dropping; it pays for a network stack that reaches other machines, and ours does not.
"Polled": taken when the receiver's timer looks; most of it is the phase between two timers, for
all alike. "Woken": taken when it comes, in zenoh's callback or a thread in recv; Phalanx has no
such mode. Means over all edges; medians (least-most) of rounds, in which all take turns.

Rust alone is needed, and some minutes to build zenoh and what it pulls in, once:
    bench/peers/neighbors.py
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RATES_HZ = [100, 1000]
SHOWN = ["p50", "p99", "p99.9"]
PEERS = [("datagram", "polled"), ("zenoh", "polled"), ("datagram", "woken"), ("zenoh", "woken")]


def built(words, name, release):
    """Builds a binary; where it is."""
    command = ["cargo", "build", "--locked", "--message-format=json", *words]
    command += ["--profile", "dist"] if release else []
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"error: {' '.join(command)} ended with {done.returncode}")
    messages = map(json.loads, done.stdout.splitlines())
    found = [m["executable"] for m in messages
             if m.get("executable") and m["target"]["name"] == name]
    return found[-1]


def output(command, limit_s):
    done = subprocess.run(command, stdout=subprocess.PIPE, timeout=limit_s)
    if done.returncode != 0:
        sys.exit(f"error: {' '.join(map(str, command))} ended with {done.returncode}")
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robots", type=int, nargs="+", default=[2, 8])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=int, default=3)
    parser.add_argument("--debug", action="store_true", help="debug builds, to try it out")
    args = parser.parse_args()
    phalanx = built(["-p", "bench"], "phalanx-bench", not args.debug)
    target = os.environ.get("CARGO_TARGET_DIR", str(ROOT / "target"))
    peers = built(
        ["--manifest-path", "bench/peers/neighbors/Cargo.toml", "--target-dir", f"{target}/peers-rust"],
        "neighbors", not args.debug)
    load = os.getloadavg()[0]
    figures = {}

    def told(robots, rate_hz, who, quantile, value_us):
        figures.setdefault((robots, rate_hz, who, quantile), []).append(value_us)

    for _ in range(args.rounds):
        for robots in args.robots:
            command = [phalanx, "--only", "neighbor", "--rounds", "1", "--robots", robots,
                       "--seconds", args.seconds / 3, "--output", "json"]
            rows = output(list(map(str, command)), 60 + 10 * args.seconds)["rows"]
            for rate_hz in RATES_HZ:
                for quantile in SHOWN:
                    what = f"{robots} robots at {rate_hz} Hz, published to used {quantile}, us"
                    row = next(row for row in rows if row["what"] == what
                               and row["floor_name"].startswith("iceoryx2"))
                    told(robots, rate_hz, "Phalanx, polled", quantile, row["ours"]["median"])
                    told(robots, rate_hz, "iceoryx2, polled", quantile, row["floor"]["median"])
                for transport, how in PEERS:
                    words = [peers, transport, how, robots, rate_hz, args.seconds]
                    seen = output(list(map(str, words)), 120 + args.seconds)
                    for quantile in SHOWN:
                        who = f"{transport}, {how}"
                        told(robots, rate_hz, who, quantile, seen[f"{quantile}_us"])

    print(f"{time.strftime('%Y-%m-%d')}, {os.cpu_count()} cores, load average {load:.2f} before, "
          f"{args.rounds} rounds of {args.seconds} s{', debug builds' if args.debug else ''}\n")
    print("| published to used, us | " + " | ".join(SHOWN) + " | p50 of Phalanx / it |")
    print("|---|" + "---|" * (len(SHOWN) + 1))
    for robots, rate_hz, who in dict.fromkeys(key[:3] for key in figures):
        cells = []
        for quantile in SHOWN:
            of = figures[robots, rate_hz, who, quantile]
            cells.append(f"{statistics.median(of):.0f} ({min(of):.0f}-{max(of):.0f})")
        ours = figures[robots, rate_hz, "Phalanx, polled", "p50"]
        theirs = figures[robots, rate_hz, who, "p50"]
        ratio = statistics.median(one / other for one, other in zip(ours, theirs))
        cells.append(f"{ratio:.3f}" if who.endswith("polled") else "-")
        print(f"| {robots} at {rate_hz} Hz: {who} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
