"""Compares the messages of a recording with the tables of the same run.

A reader gives (topic, stamp in ns, message) of every message; `check` fails on the first that
differs from samples.csv, events.csv and scenario.toml, and on every row without a message.
Numbers must be equal bit by bit. Only values that are recomputed here may differ in the last digit:
the quaternion of a heading, the distance of two front points.
"""

import csv
import json
import math
import tomllib
from collections import Counter
from pathlib import Path

ROBOT_TOPICS = ("odom", "pose", "cmd_vel")
LAST_DIGIT = 1e-15


class Tables:
    def __init__(self, run_dir: Path):
        manifest = json.loads((run_dir / "manifest.json").read_text())
        self.start_ns = manifest["epoch_unix_ns"]
        lines = (run_dir / "samples.csv").read_text().splitlines(keepends=True)
        # A kill may have cut the last line.
        rows = list(csv.DictReader(line for line in lines if line.endswith("\n")))
        self.robots = list(dict.fromkeys(row["robot"] for row in rows))
        self.samples = {(float(row["t_s"]), row["robot"]): row for row in rows}
        with open(run_dir / "events.csv", newline="") as file:
            self.events = list(csv.DictReader(file))
        scenario = tomllib.loads((run_dir / "scenario.toml").read_text())
        default = scenario["robot_defaults"].get("front_point_m")
        self.front_point_m = {
            robot["name"]: robot.get("front_point_m", default) for robot in scenario["robot"]
        }
        # Discs as center and radius, the rest as the points of a line.
        self.walls = []
        for wall in scenario.get("wall", []):
            points = wall["points_m"] + wall["points_m"][:1] * wall.get("closed", False)
            self.walls += [list(pair) for pair in zip(points, points[1:])]
        for obstacle in scenario.get("obstacle", []):
            if obstacle["kind"] == "disc":
                self.walls.append((obstacle["center_m"], obstacle["radius_m"]))
            else:
                self.walls.append(obstacle["corners_m"] + obstacle["corners_m"][:1])

    def t_s(self, stamp_ns: int) -> float:
        return (stamp_ns - self.start_ns) / 1e9

    def front_point(self, t_s: float, robot: str) -> tuple[float, float]:
        row = self.samples[t_s, robot]
        heading, ahead = float(row["heading_rad"]), self.front_point_m[robot]
        x, y = float(row["x_m"]), float(row["y_m"])
        return x + ahead * math.cos(heading), y + ahead * math.sin(heading)


def same(found: float, expected: str, what: str):
    assert found == float(expected), f"{what} is {found}, samples.csv says {expected}"


def close(found: float, expected: float, what: str):
    assert abs(found - expected) <= LAST_DIGIT, f"{what} is {found}, expected {expected}"


def is_pose(position, orientation, row):
    same(position.x, row["x_m"], "x")
    same(position.y, row["y_m"], "y")
    heading = float(row["heading_rad"])
    close(orientation.z, math.sin(heading / 2), "z of the quaternion")
    close(orientation.w, math.cos(heading / 2), "w of the quaternion")
    assert (position.z, orientation.x, orientation.y) == (0, 0, 0), "the pose is outside of the plane"


def is_twist(twist, row):
    same(twist.linear.x, row["v_m_s"], "v")
    same(twist.angular.z, row["w_rad_s"], "w")
    rest = (twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y)
    assert rest == (0, 0, 0, 0), "a unicycle only drives and turns"


def is_stamp(stamp, stamp_ns: int):
    assert stamp.sec * 10**9 + stamp.nanosec == stamp_ns, f"{stamp} is not {stamp_ns}"


def are_walls(markers, walls):
    assert len(markers) == len(walls), f"{len(markers)} markers of {len(walls)} walls"
    for marker, wall in zip(markers, walls):
        assert (marker.header.frame_id, marker.action) == ("map", 0)
        if isinstance(wall, tuple):
            (x, y), radius = wall
            position, scale = marker.pose.position, marker.scale
            assert (marker.type, position.x, position.y) == (3, x, y)
            assert scale.x == scale.y == 2 * radius
        else:
            assert marker.type == 4 and marker.scale.x > 0
            assert [[point.x, point.y] for point in marker.points] == wall
        assert marker.color.a == 1 and marker.pose.orientation.w == 1


def check(run_dir: Path, messages, partial=False):
    """Compares messages with the tables. `partial`: the recording was cut, and may have fewer records than the tables."""
    tables = Tables(run_dir)
    seen = Counter()
    events = []
    for topic, stamp_ns, message in messages:
        t_s = tables.t_s(stamp_ns)
        if topic == "/walls":
            seen[topic] += 1
            are_walls(message.markers, tables.walls)
            continue
        row_of = lambda robot: tables.samples[t_s, robot]  # noqa: E731
        if partial and topic != "/rosout" and (t_s, tables.robots[-1]) not in tables.samples:
            continue
        seen[topic] += 1
        if topic == "/tf":
            assert len(message.transforms) == len(tables.robots)
            for robot, transform in zip(tables.robots, message.transforms):
                is_stamp(transform.header.stamp, stamp_ns)
                assert transform.header.frame_id == "map"
                assert transform.child_frame_id == f"{robot}/base_link"
                inner = transform.transform
                is_pose(inner.translation, inner.rotation, row_of(robot))
        elif topic == "/metrics":
            is_stamp(message.stamp, stamp_ns)
            assert list(message.robot) == tables.robots
            for place, robot in enumerate(tables.robots):
                row = row_of(robot)
                alive = message.alive[place]
                assert bool(alive) == (row["alive"] == "1"), f"{robot} at {t_s} s"
                for column in ("error_m", "ideal_error_m", "error_x_m", "error_y_m"):
                    found = getattr(message, column)[place]
                    if row[column]:
                        same(found, row[column], column)
                    else:
                        assert math.isnan(found)
            places = [tables.front_point(t_s, robot) for robot in tables.robots]
            apart = {
                (a, b): math.dist(places[a], places[b])
                for b in range(len(places))
                for a in range(b)
            }
            pair = tuple(int(place) for place in message.min_distance_pair)
            close(message.min_distance_m, apart[pair], "the smallest distance")
            close(message.min_distance_m, min(apart.values()), "the smallest distance")
        elif topic == "/rosout":
            is_stamp(message.stamp, stamp_ns)
            name = "" if message.name == "supervisor" else message.name
            kind = message.function
            detail = message.msg.removeprefix(kind).removeprefix(": ")
            events.append((t_s, kind, name, detail))
            assert message.level in (20, 30, 40), f"{kind} has the level {message.level}"
        else:
            _, robot, what = topic.split("/")
            row = row_of(robot)
            if what == "odom":
                is_stamp(message.header.stamp, stamp_ns)
                assert message.header.frame_id == "map"
                assert message.child_frame_id == f"{robot}/base_link"
                is_pose(message.pose.pose.position, message.pose.pose.orientation, row)
                is_twist(message.twist.twist, row)
                assert not any(message.pose.covariance) and not any(message.twist.covariance)
            elif what == "pose":
                is_stamp(message.header.stamp, stamp_ns)
                assert message.header.frame_id == "map"
                is_pose(message.pose.position, message.pose.orientation, row)
            else:
                assert what == "cmd_vel", f"unknown topic {topic}"
                is_twist(message, row)
    told = [(float(e["t_s"]), e["kind"], e["robot"], e["detail"]) for e in tables.events]
    # Readers may sort by stamps; an event is recorded when it is detected, perhaps after later ones.
    unknown, missing = Counter(events) - Counter(told), Counter(told) - Counter(events)
    assert not unknown, f"events.csv has no {unknown}"
    assert partial or not missing, f"/rosout has no {missing}"
    instants = len(tables.samples) // len(tables.robots)
    if partial:
        # A chunk may have ended within the last instant.
        instants = seen["/tf"]
        assert instants > 0, "the recording is empty"
        for topic in seen.keys() - {"/rosout", "/walls"}:
            seen[topic] += seen[topic] == instants - 1
    expected = {"/tf": instants, "/metrics": instants, "/rosout": len(events)}
    if tables.walls:
        expected["/walls"] = 1
    for robot in tables.robots:
        expected |= {f"/{robot}/{what}": instants for what in ROBOT_TOPICS}
    found = {topic: count for topic, count in seen.items() if count}
    assert found == {topic: count for topic, count in expected.items() if count}, found
    print(f"{sum(seen.values())} messages on {len(found)} topics agree with the tables")
