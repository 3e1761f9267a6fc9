"""A scatter plot on logarithmic axes with a front of the best points, drawn with Pillow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw

from rhytid.pictures.legends import INK, font

_WIDTH, _HEIGHT = 1240, 760
_LEFT, _RIGHT, _TOP, _BOTTOM = 92, 40, 46, 78
_SCALE = 2
_NAMES = 140  # room for the names of curves
_GRID, _FRONT = (226, 226, 230), (120, 120, 128)
COLOURS = (
    (196, 60, 50), (226, 148, 60), (58, 112, 186), (44, 140, 96), (122, 70, 160), (60, 170, 190),
    (150, 110, 70), (40, 40, 48),
)  # fmt: skip

Place = tuple[float, float]


@dataclass(frozen=True)
class Point:
    """x, y above 0; `series` picks a colour and has a row in the legend; `label` is beside it."""

    x: float
    y: float
    series: str
    label: str
    on_front: bool


@dataclass(frozen=True)
class Axis:
    """A logarithmic axis in pixels: values from `low` to `high` lie from `start` to `stop`."""

    low: float
    high: float
    start: float
    stop: float

    @classmethod
    def around(cls, values: Sequence[float], start: float, stop: float) -> Axis:
        """A tenth of a decade wider than the values."""
        return cls(min(values) / 1.25, max(values) * 1.35, start, stop)

    def at(self, value: float) -> float:
        """Pixel of a value."""
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return self.start + share * (self.stop - self.start)

    def ticks(self) -> list[float]:
        """1, 2 and 5 of each decade in between."""
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        found = [m * 10.0**d for d in decades for m in (1, 2, 5)]
        return [value for value in found if self.low <= value <= self.high]


def scatter(points: Sequence[Point], x_title: str, y_title: str) -> Image.Image:
    """A picture of the points; those on the front are labelled and joined by steps."""
    canvas, draw, across, up = _plane(points, _RIGHT, x_title, y_title)
    series = list(dict.fromkeys(p.series for p in points))
    colour = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(series)}
    places = [(across.at(p.x), up.at(p.y)) for p in points]
    _front(draw, sorted(at for p, at in zip(points, places, strict=True) if p.on_front))
    for point, at in zip(points, places, strict=True):
        _dot(draw, at, 8 if point.on_front else 5, colour[point.series])
    _labels(draw, [(at, p.label) for p, at in zip(points, places, strict=True) if p.on_front])
    _legend(draw, colour)
    return canvas.resize((_WIDTH, _HEIGHT), Image.Resampling.LANCZOS)


def curves(points: Sequence[Point], x_title: str, y_title: str) -> Image.Image:
    """A picture of series, the points of each joined in their order and named at the last."""
    canvas, draw, across, up = _plane(points, _NAMES, x_title, y_title)
    ends = []
    for index, name in enumerate(dict.fromkeys(p.series for p in points)):
        colour = COLOURS[index % len(COLOURS)]
        places = [(across.at(p.x), up.at(p.y)) for p in points if p.series == name]
        _line(draw, places, colour, 2)
        for at in places:
            _dot(draw, at, 5, colour)
        ends.append((places[-1], name))
    _labels_beside(draw, ends)
    return canvas.resize((_WIDTH, _HEIGHT), Image.Resampling.LANCZOS)


def _plane(
    points: Sequence[Point], right: float, x_title: str, y_title: str
) -> tuple[Image.Image, ImageDraw.ImageDraw, Axis, Axis]:
    """An empty picture with the axes of the points. right: pixels beyond the last of them."""
    canvas = Image.new("RGB", (_WIDTH * _SCALE, _HEIGHT * _SCALE), "white")
    draw = ImageDraw.Draw(canvas)
    across = Axis.around([p.x for p in points], _LEFT, _WIDTH - right)
    up = Axis.around([p.y for p in points], _HEIGHT - _BOTTOM, _TOP)
    _axes(draw, across, up, x_title, y_title)
    return canvas, draw, across, up


def _labels_beside(draw: ImageDraw.ImageDraw, ends: list[tuple[Place, str]]) -> None:
    """Right of each point, from the top down, each below the one before."""
    below = 0.0
    for (x, y), name in sorted(ends, key=lambda end: end[0][1]):
        below = max(y, below + 18)
        _text(draw, (x + 14, below), name, 15, "lm")


def _axes(draw: ImageDraw.ImageDraw, across: Axis, up: Axis, x_title: str, y_title: str) -> None:
    bottom, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
    for value in across.ticks():
        x = across.at(value)
        _line(draw, [(x, _TOP), (x, bottom)], _GRID, 1)
        _text(draw, (x, bottom + 8), f"{value:g}", 15, "ma")
    for value in up.ticks():
        y = up.at(value)
        _line(draw, [(_LEFT, y), (right, y)], _GRID, 1)
        _text(draw, (_LEFT - 8, y), f"{value:g}", 15, "rm")
    _line(draw, [(_LEFT, _TOP), (_LEFT, bottom), (right, bottom)], INK, 1.5)
    _text(draw, ((_LEFT + right) / 2, _HEIGHT - 18), x_title, 17, "ms")
    _text(draw, (_LEFT - 60, _TOP - 18), y_title, 17, "ls")


def _front(draw: ImageDraw.ImageDraw, places: list[Place]) -> None:
    steps: list[Place] = []
    for x, y in places:
        if steps:
            steps.append((x, steps[-1][1]))
        steps.append((x, y))
    if len(steps) > 1:
        _line(draw, steps, _FRONT, 2)


def _labels(draw: ImageDraw.ImageDraw, labels: list[tuple[Place, str]]) -> None:
    """Above and to the right of a point; below and to the left where another label is there."""
    taken: list[tuple[float, float, float]] = []
    for (x, y), label in sorted(labels):
        width = font(14).getlength(label)
        left, base = x + 11, y - 11
        crowded = any(
            abs(base - b) < 16 and left < stop and left + width > start for start, stop, b in taken
        )
        if crowded or left + width > _WIDTH - 8:
            left, base = x - 11 - width, y + 22
        taken.append((left, left + width, base))
        _text(draw, (left, base), label, 14, "ls")


def _legend(draw: ImageDraw.ImageDraw, colours: dict[str, tuple[int, int, int]]) -> None:
    left = _WIDTH - _RIGHT - 300
    for row, (name, colour) in enumerate(colours.items()):
        y = _TOP + 16 + 24 * row
        _dot(draw, (left, y), 6, colour)
        _text(draw, (left + 16, y), name, 15, "lm")


def _dot(draw: ImageDraw.ImageDraw, at: Place, radius: float, colour: tuple[int, int, int]) -> None:
    centre = (at[0] * _SCALE, at[1] * _SCALE)
    draw.circle(centre, (radius + 1.5) * _SCALE, fill="white")
    draw.circle(centre, radius * _SCALE, fill=colour)


def _line(
    draw: ImageDraw.ImageDraw, places: Sequence[Place], colour: tuple[int, int, int], width: float
) -> None:
    draw.line(
        [(x * _SCALE, y * _SCALE) for x, y in places], fill=colour, width=round(width * _SCALE)
    )


def _text(draw: ImageDraw.ImageDraw, at: Place, text: str, size: int, anchor: str) -> None:
    place = (at[0] * _SCALE, at[1] * _SCALE)
    draw.text(place, text, fill=INK, font=font(size * _SCALE), anchor=anchor)
