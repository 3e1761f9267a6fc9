"""What each code of a warning or a notice means: what it is about, when it comes, what to do.

The tables of docs/warnings.md say the same, word for word.
"""

from __future__ import annotations

from dataclasses import dataclass

from rhytid.domain import warnings as codes
from rhytid.domain.notices import FEW_TEXELS, GRAIN_NOT_DRAWN, LARGE_BUILD


@dataclass(frozen=True)
class Meaning:
    """of: what it is about.  when: from where on.  remedy: what to do. Markdown, a line each."""

    of: str
    when: str
    remedy: str


WARNINGS = {
    codes.STRETCH_AT_CLAMP: Meaning(
        "a frame",
        (
            "half of the triangles are stretched or compressed by 1.5 times or more: the median "
            "of abs(log stretch) is above 0.4 (strong expressions of a real face have 0.06)"
        ),
        (
            "send the vertices in the order of the neutral mesh file, and frames of this very "
            "mesh; switch off what reorders vertices on export"
        ),
    ),
    codes.FRAME_SCALED: Meaning(
        "a frame",
        (
            "the neutral made larger or smaller everywhere: the median log stretch is 0.05 or "
            "more and 3 times the distance from its 10th to its 90th percentile"
        ),
        (
            "export neutral and frames in one unit; the text has the factor, and the two units "
            "that it looks like"
        ),
    ),
    codes.FAR_FROM_ORIGIN: Meaning(
        "a mesh, a frame",
        (
            "the numbers come in steps of more than 0.001 of the median edge: pores are off by "
            "more than 1 % of their depth"
        ),
        "send doubles (npy or npz of float64, OBJ), or move neutral and frames to the origin",
    ),
    codes.MESH_SIZE: Meaning(
        "a mesh",
        "its longest side is not 9 cm to 1 m in its unit",
        (
            "set `unit` (`--unit`), also to a number and a unit, `5.5cm`, or scale neutral and"
            " frames; of a bust or a body measure the head alone"
        ),
    ),
    codes.NORMALS_INWARD: Meaning(
        "a mesh",
        (
            "the faces are wound inside out: the mean cosine between normals and the way out from"
            " the middle is below -0.25 (heads and faces have 0.5 to 0.9, a flat sheet 0)"
        ),
        "turn the faces over, for furrows would stand out as ridges",
    ),
    codes.UV_MIRRORED: Meaning(
        "a mesh",
        "more than 1 % of the UV area is mirrored, seen from outside",
        (
            "flip these charts, where directions or turns are painted or pictures shall read the "
            "right way"
        ),
    ),
    codes.UV_OVERLAP: Meaning(
        "a mesh, by UDIM",
        "more than 1 % of the covered UV area lies under two triangles or more",
        (
            "lay charts side by side or in UDIMs of their own; where halves share UV on purpose, "
            "both get the skin of the first"
        ),
    ),
    codes.TEXEL_SIZE: Meaning(
        "a mesh",
        (
            "the side of a texel on the surface varies more than 10 times, half a hundredth of "
            "the area at either end left out"
        ),
        (
            "give the place that is named more room in UV, or less; inside nostrils and mouth it "
            "may stay"
        ),
    ),
    codes.SETTINGS_CHANGED: Meaning(
        "an asset that was sent again",
        (
            "its settings were changed since the same content was sent before: by `PATCH`, or "
            "`bins.r_max` where a range was sent"
        ),
        (
            "send the PATCH that the text names, to have it as sent; or send what is meant as "
            "another asset, with these settings"
        ),
    ),
    codes.SETTINGS_UNUSED: Meaning(
        "settings",
        (
            "`graph` has settings of how skin is grown, beside a graph that is given; "
            "`graph.spacing` and `graph.seed` are used all the same"
        ),
        "leave them out, or leave the graph out",
    ),
    codes.DEVICES_MIXED: Meaning(
        "a bake",
        (
            "its maps were drawn by several devices, drivers or versions of the drawing, whose "
            "last bits differ: by parts, by tasks of a farm or by workers"
        ),
        (
            "bake all frames by one kind of device: name it with `--device` or `RHYTID_DEVICE`, "
            "and install the same rhytid on all machines"
        ),
    ),
}

NOTICES = {
    GRAIN_NOT_DRAWN: Meaning(
        "an asset",
        (
            "the largest wave of the grain is shorter than two texels on half of the skin or "
            "more, so that none of it is drawn there"
        ),
        (
            "raise `resolution` for the final maps, or `shape.grain_size`; `shape.grain` 0 is "
            "without grain. In a draft it may stay"
        ),
    ),
    FEW_TEXELS: Meaning(
        "an asset, a mesh that is checked",
        "fewer than four texels lie between pores on half of the skin or more",
        (
            "raise `resolution` for the final maps to what the text says, or `graph.spacing`; "
            "give skin more room in UV, or UDIMs. In a draft it may stay"
        ),
    ),
    LARGE_BUILD: Meaning(
        "an asset that builds, a mesh that is checked",
        "there will be more than 5 million wrinkles (a face has about half a million)",
        (
            "mask the face: paint `density` 0 elsewhere; or raise `graph.spacing`. If all of it "
            "is wanted it may stay"
        ),
    ),
}
