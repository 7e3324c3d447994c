"""Top view of the plane as a numpy array, which ``render`` of an environment returns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["TopView"]

Point = tuple[float, float]
Color = tuple[int, int, int]

SIDE_PX = 480
"""Width and height of a picture, px."""
_SAMPLES = 2
"""Samples per pixel along each axis; the picture is their mean, so that edges are smooth."""
_RIM_PX = 24.0
"""Margin between the shown area and the edge of the picture, px."""
_BODY_PX_MIN = 5.0
"""Minimum drawn distance of the front point from the axle, px."""
_WHITE, _PALE, _GRAY = (255, 255, 255), (232, 235, 239), (128, 128, 128)
_COLORS: tuple[Color, ...] = (
    (0x00, 0x72, 0xB2),
    (0x92, 0x41, 0x7B),
    (0x00, 0x80, 0x60),
    (0x1A, 0x1D, 0x21),
    (0xA6, 0x6A, 0x00),
    (0xD8, 0x5F, 0x9C),
    (0x6B, 0x7A, 0x00),
    (0x6A, 0x51, 0xC9),
    (0x7A, 0x4B, 0x2A),
)
"""Colors of robots, in scenario order, the same as in the report."""


class TopView:
    """Draws robots, walls and desired points. The shown area grows with the points that are included."""

    def __init__(self) -> None:
        """Creates a view with an empty area."""
        self._low = np.full(2, np.inf)
        self._high = np.full(2, -np.inf)

    def include(self, points: Iterable[Point]) -> None:
        """Extends the shown area to these points, m."""
        for point in points:
            at = np.asarray(point, float)
            if np.isfinite(at).all():
                self._low, self._high = np.minimum(self._low, at), np.maximum(self._high, at)

    def draw(
        self,
        robots: Sequence[tuple[float, float, float, float, bool]],
        wanted: Sequence[Point | None],
        trails: Sequence[Sequence[Point]],
        walls: Sequence[tuple[Sequence[Point], float]],
        distance_min_m: float,
    ) -> NDArray[np.uint8]:
        """Returns a picture, ``SIDE_PX`` by ``SIDE_PX`` by 3.

        ``robots``: x, y in m and heading in rad of the axle's middle, front_point_m, and whether it is alive; dead
        robots are gray. ``wanted``: desired point of each robot, m, drawn as a cross; None draws none. ``trails``: past front points of each, m.
        A ring of radius ``distance_min_m`` / 2 is around each front point.
        """
        fronts = [
            (x + ahead * math.cos(a), y + ahead * math.sin(a)) for x, y, a, ahead, _ in robots
        ]
        canvas = _Canvas(self._low, self._high, distance_min_m)
        canvas.grid()
        for corners, radius_m in walls:
            canvas.wall(corners, radius_m)
        for place, trail in enumerate(trails):
            canvas.path(trail, _mixed(_color(place), 0.4))
        for place, point in enumerate(wanted):
            if point is not None:
                canvas.cross(point, _color(place))
        for place, ((_, _, heading, ahead, alive), front) in enumerate(zip(robots, fronts)):
            color = _color(place) if alive else _GRAY
            canvas.ring(front, distance_min_m / 2.0, _mixed(color, 0.6))
            canvas.body(front, heading, ahead, color)
        return canvas.picture()


def _color(place: int) -> Color:
    return _COLORS[place % len(_COLORS)]


def _mixed(color: Color, share: float) -> Color:
    """Returns the color mixed with white: 1 is the color itself."""
    red, green, blue = (round(share * c + (1.0 - share) * 255.0) for c in color)
    return red, green, blue


class _Canvas:
    """The samples of one picture, and the map from the plane to them."""

    def __init__(self, low: NDArray[np.float64], high: NDArray[np.float64], d: float) -> None:
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            low, high = np.zeros(2), np.zeros(2)
        size = SIDE_PX * _SAMPLES
        self.pixels = np.full((size, size, 3), _WHITE, np.uint8)
        rim = _RIM_PX * _SAMPLES
        reach = max(float((high - low).max()) + 2.0 * d, 1e-9)
        self.scale = (size - 2.0 * rim) / reach  # samples per m
        self.middle = (low + high) / 2.0
        self.reach = size / self.scale

    def pixel_of(self, point: ArrayLike) -> NDArray[np.float64]:
        """Returns column and row of a point of the plane, in samples."""
        x, y = (np.asarray(point, float) - self.middle) * self.scale
        half = self.pixels.shape[0] / 2.0
        return np.array([half + x, half - y])

    def fill(self, low: NDArray[np.float64], high: NDArray[np.float64], inside, color: Color) -> None:
        """Fills the samples of a box for which ``inside(columns, rows)`` is true."""
        size = self.pixels.shape[0]
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            return
        x0, y0 = np.clip(np.floor(low), 0, size).astype(int)
        x1, y1 = np.clip(np.ceil(high) + 1, 0, size).astype(int)
        if x0 >= x1 or y0 >= y1:
            return
        rows, columns = np.mgrid[y0:y1, x0:x1] + 0.5
        self.pixels[y0:y1, x0:x1][inside(columns, rows)] = color

    def segment(self, a, b, width: float, color: Color) -> None:
        """Draws a segment between two points, given in samples, ``width`` px wide."""
        half = width * _SAMPLES / 2.0
        along = b - a
        square = max(float(along @ along), 1e-12)

        def inside(x, y):
            share = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square, 0.0, 1.0)
            return np.hypot(x - a[0] - share * along[0], y - a[1] - share * along[1]) <= half

        self.fill(np.minimum(a, b) - half, np.maximum(a, b) + half, inside, color)

    def polygon(self, corners: Sequence[NDArray[np.float64]], color: Color) -> None:
        """Fills a convex polygon with corners in samples."""

        def inside(x, y):
            sides = [
                (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
                for a, b in zip(corners, [*corners[1:], corners[0]])
            ]
            return np.all([s >= 0 for s in sides], 0) | np.all([s <= 0 for s in sides], 0)

        self.fill(np.min(corners, 0), np.max(corners, 0), inside, color)

    def grid(self) -> None:
        """Draws lines at round coordinates."""
        least = self.reach / 8.0
        power = 10.0 ** math.floor(math.log10(least))
        step = next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= least * 0.999)
        size = self.pixels.shape[0]
        for axis in (0, 1):
            first = math.ceil((self.middle[axis] - self.reach / 2.0) / step)
            for line in range(first, first + 10):
                value = self.middle.copy()
                value[axis] = line * step
                place = int(self.pixel_of(value)[axis])
                if 0 <= place < size - 1:
                    lines = self.pixels[:, place : place + 2] if axis == 0 else self.pixels[place : place + 2]
                    lines[...] = _PALE

    def wall(self, corners: Sequence[Point], radius_m: float) -> None:
        """Draws a wall: a disc, a segment or a convex polygon."""
        places = [self.pixel_of(corner) for corner in corners]
        if len(places) == 1:
            middle, radius = places[0], radius_m * self.scale
            self.fill(
                middle - radius,
                middle + radius,
                lambda x, y: np.hypot(x - middle[0], y - middle[1]) <= radius,
                _GRAY,
            )
        elif len(places) == 2:
            self.segment(places[0], places[1], 3.0, _GRAY)
        else:
            self.polygon(places, _GRAY)

    def path(self, points: Sequence[Point], color: Color) -> None:
        """Draws a line through points of the plane."""
        places = [self.pixel_of(point) for point in points]
        for a, b in zip(places, places[1:]):
            self.segment(a, b, 1.5, color)

    def cross(self, point: Point, color: Color) -> None:
        """Draws a cross of fixed size around a point of the plane."""
        middle, half = self.pixel_of(point), 5.0 * _SAMPLES
        for way in (np.array([half, half]), np.array([half, -half])):
            self.segment(middle - way, middle + way, 2.0, color)

    def ring(self, point: Point, radius_m: float, color: Color) -> None:
        """Draws a circle around a point of the plane."""
        middle, radius, half = self.pixel_of(point), radius_m * self.scale, _SAMPLES * 0.75
        self.fill(
            middle - radius - half,
            middle + radius + half,
            lambda x, y: np.abs(np.hypot(x - middle[0], y - middle[1]) - radius) <= half,
            color,
        )

    def body(self, front: Point, heading: float, ahead: float, color: Color) -> None:
        """Draws a robot: an arrowhead whose tip is the front point."""
        tip = self.pixel_of(front)
        size = max(ahead * self.scale, _BODY_PX_MIN * _SAMPLES)
        forward = np.array([math.cos(heading), -math.sin(heading)]) * size
        left = np.array([forward[1], -forward[0]])
        notch = tip - 1.25 * forward
        for side in (0.75, -0.75):
            self.polygon([tip, tip - 1.7 * forward + side * left, notch], color)

    def picture(self) -> NDArray[np.uint8]:
        """Returns the mean of the samples of each pixel."""
        shape = (SIDE_PX, _SAMPLES, SIDE_PX, _SAMPLES, 3)
        mean = self.pixels.reshape(shape).mean(axis=(1, 3))
        return (mean + 0.5).astype(np.uint8)
