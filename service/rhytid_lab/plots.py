"""Plots on logarithmic axes, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

from rhytid.domain.wording import install_hint
from rhytid.errors import RhytidError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Said before there is anything to plot; imported when there is, for it takes half a second.
if find_spec("matplotlib") is None:
    raise RhytidError(f"plots need matplotlib; {install_hint('lab')}")

_INCHES, _DPI = (12.4, 7.6), 100


@dataclass(frozen=True)
class Point:
    """x, y above 0; `series` picks a colour and has a row in the legend; `label` is beside it."""

    x: float
    y: float
    series: str
    label: str = ""
    on_front: bool = False


def scatter(points: Sequence[Point], x_title: str, y_title: str) -> Figure:
    """The points; those on the front are labelled and joined by steps."""
    figure, axes = _plane(x_title, y_title)
    front = sorted((p for p in points if p.on_front), key=lambda p: p.x)
    axes.step([p.x for p in front], [p.y for p in front], where="post", color="grey", zorder=1)
    for name in _names(points):
        mine = [p for p in points if p.series == name]
        sizes = [70 if p.on_front else 30 for p in mine]
        axes.scatter([p.x for p in mine], [p.y for p in mine], sizes, label=name, zorder=2)
    for point in front:
        axes.annotate(
            point.label, (point.x, point.y), (7, 7), textcoords="offset points", fontsize=8
        )
    axes.legend()
    return figure


def curves(points: Sequence[Point], x_title: str, y_title: str) -> Figure:
    """One line per series, through its points in their order."""
    figure, axes = _plane(x_title, y_title)
    for name in _names(points):
        mine = [p for p in points if p.series == name]
        axes.plot([p.x for p in mine], [p.y for p in mine], marker="o", label=name)
    axes.legend()
    return figure


def _names(points: Sequence[Point]) -> list[str]:
    return list(dict.fromkeys(p.series for p in points))


def _plane(x_title: str, y_title: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogFormatter

    figure = Figure(figsize=_INCHES, dpi=_DPI, layout="constrained")
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlabel=x_title, ylabel=y_title)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.5)))
    axes.grid(alpha=0.4, which="both")
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes
