"""The report as one HTML page beside its pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #202024; max-width: 1240px; margin: 2.5em auto;
       padding: 0 1.5em }
h1 { font-weight: 600; margin-bottom: .2em } h2 { font-weight: 600; margin-top: 2.2em }
img { max-width: 100%; display: block; margin: 1em 0 }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 1em 0 }
th, td { padding: .25em .9em; text-align: right; border-bottom: 1px solid #e4e4e8 }
th { font-weight: 600; border-bottom: 2px solid #202024 } td:first-child, th:first-child
{ text-align: left } tr.front td { background: #eef4ee } p.note { color: #606068; max-width: 60em }
"""


def page(figures: dict[str, Any]) -> str:
    """Return the page of a finished report.  figures: those of `Report`."""
    r_max, subject = figures["r_max"], escape(figures["subject"])
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>rhytid reproduce</title>",
        f"<style>{_STYLE}</style>",
        "<h1>Fast Dynamic Facial Wrinkles, reproduced</h1>",
        _note(
            f"Figures, times and claims of Weiss et al., Eurographics 2024, remade by rhytid from "
            f"{subject} and a sphere: {figures['resolution']}² texels on {figures['device']}. "
            f"The fast method is calibrated to r_max = {r_max:.3f}."
        ),
        _figure("Figure 1: a face by every method", "figure_1"),
        _figure("Figure 3: principal stretch", "figure_3"),
        _figure("Figure 4: precomputed maps", "figure_4"),
        _figure("Figure 5: a deforming sphere", "figure_5"),
        *_times(figures["times"], figures["resolution"]),
        *_accuracy(figures["accuracy"]),
        "</html>",
    ]
    return "\n".join(parts)


def _figure(title: str, name: str) -> str:
    return f"<h2>{title}</h2><a href='{name}.png'><img src='{name}.png' alt='{title}'></a>"


def _note(text: str) -> str:
    return f"<p class='note'>{escape(text)}</p>"


def _table(header: Sequence[str], rows: Iterable[tuple[bool, Sequence[str]]]) -> str:
    """Return a table.  rows: each with whether it is marked."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        f"<tr{' class=front' if marked else ''}>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in row)
        + "</tr>"
        for marked, row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _times(times: dict[str, Any], resolution: int) -> list[str]:
    factor = (16384 / resolution) ** 2
    header = ("case", "seconds", "map copies", "scaled to 16384²", "paper, RTX 3090")
    rows = [
        (
            False,
            (
                row["case"],
                f"{row['seconds']:.4f}",
                f"{row['map_copies']:.1f}",
                f"{row['scaled']:.3f} s",
                "" if row["paper"] is None else f"{row['paper']:g} s",
            ),
        )
        for row in times["rows"]
    ]
    return [
        "<h2>What a frame costs</h2>",
        _table(header, rows),
        _note(
            f"{resolution}² texels and {times['wrinkles']:,} wrinkles: as many per texel as the "
            f"paper's 16384² and 20 million. Scaled: times {factor:g}, as texels and wrinkles both "
            "are; stretch is not scaled, for it goes by triangles here and by texels in the paper. "
            "A map copy reads and writes every texel as float32, on the same device in the same "
            "run. redraw and binned include stretch."
        ),
    ]


def _accuracy(accuracy: dict[str, Any]) -> list[str]:
    subjects = list(accuracy["rows"][0]["errors"])
    header = (
        "bins", "merge", "depth",
        *(f"rms, {name}" for name in subjects), *(f"worst 0.1 %, {name}" for name in subjects),
        "map copies", "time, paper = 1", "bytes per texel",
    )  # fmt: skip
    rows = [(row["on_front"], _accuracy_row(row, subjects)) for row in accuracy["rows"]]
    best = accuracy["best"]
    sources = accuracy["sources"]
    causes = list(next(iter(sources.values())))
    return [
        "<h2>How close binned is to redraw</h2>",
        _figure("Error over time", "pareto"),
        _table(header, rows),
        _note(
            f"Measured at {accuracy['resolution']}² texels, mean over the frames of a subject. "
            "rms: of the difference over that of redraw. Worst: mean difference of the worst "
            "0.1 % of texels, in units of the depth of a wrinkle of strength 1. Marked rows are on "
            "the front of the plot. Closest at no more than twice the time of the first row: "
            f"N = {best['count']}, M = {_samples(best)}, {best['bits']} bits, merge "
            f"{best['merge']}, depth {_depth(best)}."
        ),
        "<h2>Where the error comes from</h2>",
        _table(
            ("source, alone", *sources),
            [
                (False, (cause, *(f"{100 * s[cause]:.1f} %" for s in sources.values())))
                for cause in causes
            ],
        ),
        _note(
            "Rms of the difference of two maps that differ in one thing, all else at N = 16, M = 7,"
            " 16 bits, mellow merge; over that of redraw. The rest is what the finest bins still "
            "miss: interpolation at M = 7, and stretch taken at each texel where redraw takes it "
            "at the middle of the wrinkle."
        ),
    ]


def _accuracy_row(row: dict[str, Any], subjects: list[str]) -> tuple[str, ...]:
    bins = row["bins"]
    return (
        f"N {bins['count']}, M {_samples(bins)}, {bins['bits']} bit",
        bins["merge"],
        _depth(bins),
        *(f"{100 * row['errors'][name]:.1f} %" for name in subjects),
        *(f"{row['worst'][name]:.2f}" for name in subjects),
        f"{row['map_copies']:.1f}",
        f"{row['relative_time']:.2f}",
        f"{row['memory']:g}",
    )


def _samples(bins: dict[str, Any]) -> str:
    pores = bins["pore_samples"]
    return f"{bins['samples']} and {pores} of pores" if pores else str(bins["samples"])


def _depth(bins: dict[str, Any]) -> str:
    words = ["factored" if bins["depth_factored"] else "drawn"]
    words += ["with tilts"] if bins["tilt"] else []
    words += [f"reach {bins['reach']:g}"] if bins["reach"] > 1.0 else []
    return ", ".join(words)
