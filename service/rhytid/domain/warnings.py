"""Warnings: what is probably wrong with a mesh, a frame or settings that can be used all the same.

Here are the codes, the limits beyond which each is reported, and what each means. The tables of
docs/warnings.md say the same, word for word.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from rhytid.errors import QueryError, StrictError

UV_OVERLAP = "uv-overlap"
UV_MIRRORED = "uv-mirrored"
NORMALS_INWARD = "normals-inward"
TEXEL_SIZE = "texel-size"
MESH_SIZE = "mesh-size"
FAR_FROM_ORIGIN = "far-from-origin"
STRETCH_AT_CLAMP = "stretch-at-clamp"
FRAME_SCALED = "frame-scaled"
CALIBRATION_STILL = "calibration-still"
SETTINGS_CHANGED = "settings-changed"
SETTINGS_UNUSED = "settings-unused"
ARRAYS_UNUSED = "arrays-unused"
FILES_REPLACED = "files-replaced"
DEVICES_MIXED = "devices-mixed"
METHODS_MIXED = "methods-mixed"
PATCH_SIZE = "patch-size"
SCAN_DEPTH = "scan-depth"
SCAN_BITS = "scan-bits"
SCAN_BLOCKS = "scan-blocks"
SCAN_MIDLEVEL = "scan-midlevel"
SCAN_FLAT = "scan-flat"
SCAN_MIRRORED = "scan-mirrored"
SCAN_SEAMS = "scan-seams"
SCAN_LINES = "scan-lines"
SCAN_FILL = "scan-fill"
CODES = (
    UV_OVERLAP,
    UV_MIRRORED,
    NORMALS_INWARD,
    TEXEL_SIZE,
    MESH_SIZE,
    FAR_FROM_ORIGIN,
    STRETCH_AT_CLAMP,
    FRAME_SCALED,
    CALIBRATION_STILL,
    SETTINGS_CHANGED,
    SETTINGS_UNUSED,
    ARRAYS_UNUSED,
    FILES_REPLACED,
    DEVICES_MIXED,
    METHODS_MIXED,
    PATCH_SIZE,
    SCAN_DEPTH,
    SCAN_BITS,
    SCAN_BLOCKS,
    SCAN_MIDLEVEL,
    SCAN_FLAT,
    SCAN_MIRRORED,
    SCAN_SEAMS,
    SCAN_LINES,
    SCAN_FILL,
)

# uv-overlap: share of the covered UV area that lies under two triangles or more. Layouts have
# slivers that overlap by rounding; a hundredth of a face is a nostril.
OVERLAP_SHARE = 0.01
# uv-mirrored: share of the UV area that runs against the rest of a layout seen from outside. The
# same hundredth: single triangles are turned over where charts are tight.
MIRRORED_SHARE = 0.01
# normals-inward: mean cosine between the normals and the way out from the middle. Faces, heads and
# hemispheres have 0.5 to 0.9, turned inside out the same below 0, a flat sheet 0.
INWARD_COSINE = -0.25
# texel-size: side of a texel on the surface, its largest over its smallest where half a hundredth
# of the area at either end is left out, so that slivers do not count. 1.4 on the built-in face, 3
# to 4 on a game's mask, which is what is called usual; beyond 10 pores of one place are a texel
# wide or those of another waste most of the map.
TEXEL_USUAL = 4.0
TEXEL_RATIO = 10.0
TEXEL_TAIL = 0.005
# texel-size: share of the area from which on a place is counted among those that are too coarse or
# too fine; slivers at ears and lids are not.
TEXEL_PLACE = 0.001
# mesh-size: longest side of the box around the mesh, mm. A newborn's face is about 90 mm tall, a
# head with shoulders 500 mm. A factor of 10 in the unit leaves this range on one side or the other.
LEAST_SIZE, MOST_SIZE, USUAL_SIZE = 90.0, 1000.0, 230.0
# far-from-origin: the step of the numbers as they were sent over the length of the median edge. A
# stretch that is wrong by 0.001 makes a pore 1 % deeper or shallower (beta_d is 10).
STEP_OF_EDGE = 1e-3
# stretch-at-clamp: median |log stretch|. 0.8 of the usual clamp: half the skin stretched or
# compressed by half. Strong expressions have a median of 0.1, shuffled vertices one above 1.
CLAMP_MEDIAN = 0.4
# frame-scaled: the median log stretch, at least this and this many times the distance from the
# 10th to the 90th percentile. Skin does not grow by 5 % everywhere; where expressions stretch it by
# so much, they stretch some of it and leave the rest.
SCALED_MEDIAN, SCALED_SPREADS = 0.05, 3.0
# frame-scaled: how near the factor must be to that of two units for these to be named.
UNIT_TOLERANCE = 0.05
# calibration-still: the 90th percentile of |log stretch| up to which `bins.r_max` becomes the least
# that there is. Expressions of a whole face have 0.09 to 0.3; an eye that shuts, by itself, 0.003.
STILL_STRETCH = 0.01
# scan-depth: between what 95 % of a relief lie, mm: from fine pores of smooth skin to folds of a
# neck that the mesh does not have. And the gradient that a twentieth of it exceeds: 0.06 to 0.2 of
# a cheek at 0.1 mm a texel; ten times that is a scale in cm for one in mm.
SHALLOWEST, DEEPEST, STEEPEST = 0.01, 5.0, 1.0
# scan-bits: different values of a map. 16 bits of which a relief uses so few are no better.
FEW_LEVELS = 256
# scan-blocks: mean difference across borders of 8 x 8 texels over the median of those within. Maps
# that were never JPEG have 0.97 to 1.03; a JPEG of ordinary quality has 1.2 to 3.
BLOCK_RATIO = 1.12
# scan-mirrored: correlation of how much varies in a place of the map and whether a chart lies
# there, and by how much it must be better for a turned map.
FLIP_MATCH, FLIP_MARGIN = 0.25, 0.12
# scan-seams: rms of the difference of both sides over the standard deviation of heights along
# seams. Sides that have nothing to do with one another have 1.4.
SEAM_SHARE = 0.5
# scan-lines: rms of what traced lines and pores leave of the relief that is narrower than 33 texels
# over that of this relief: they draw less than a tenth of its square. Grown skin has 0.3 to 0.6.
LINES_LEFT = 0.95


@dataclass(frozen=True)
class InputWarning:
    """Something that is probably wrong.

    code: one of CODES.  detail: what is wrong, in plain text.  where: the mesh, the frame or the
    asset, and the place on it where there is one.
    """

    code: str
    detail: str
    where: str

    def __str__(self) -> str:
        return f"{self.code}: {self.where}: {self.detail}"


@dataclass(frozen=True)
class Meaning:
    """The meaning of a code, in Markdown, a line each.

    of: what a warning is about.  when: from where on it is reported.  remedy: what to do.
    """

    of: str
    when: str
    remedy: str


def refuse(warnings: Iterable[InputWarning], allow: Collection[str] = ()) -> None:
    """Raise StrictError naming the warnings whose codes are not allowed, where there are any."""
    wrong = not_allowed(warnings, allow)
    if wrong:
        listed = "; ".join(str(warning) for warning in wrong)
        raise StrictError(f"refused, because strict was asked for: {listed}", wrong)


def not_allowed(
    warnings: Iterable[InputWarning], allow: Collection[str]
) -> tuple[InputWarning, ...]:
    """The warnings that are errors where strict is asked for."""
    return tuple(warning for warning in warnings if warning.code not in allow)


def check_codes(allow: Iterable[str]) -> None:
    """Raise QueryError for the first code that is unknown, naming all that are known."""
    for code in allow:
        if code not in CODES:
            raise QueryError(f"allow is {code!r}: must be one of {', '.join(CODES)}")


# What each code means, in the order of the docs.
WARNINGS: dict[str, Meaning] = {
    STRETCH_AT_CLAMP: Meaning(
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
    FRAME_SCALED: Meaning(
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
    CALIBRATION_STILL: Meaning(
        "the frame of a calibration",
        (
            "it hardly stretches the skin: the 90th percentile of abs(log stretch) is 0.01 or "
            "less, and precomputed maps that end there are wrong wherever skin moves further"
        ),
        "calibrate with the frame that stretches the skin most, not with the neutral",
    ),
    FAR_FROM_ORIGIN: Meaning(
        "a mesh, a frame",
        (
            "the numbers come in steps of more than 0.001 of the median edge: pores are off by "
            "more than 1 % of their depth"
        ),
        "send doubles (npy or npz of float64, OBJ), or move neutral and frames to the origin",
    ),
    MESH_SIZE: Meaning(
        "a mesh",
        "its longest side is not 9 cm to 1 m in its unit",
        (
            "set `unit` (`--unit`), also to a number and a unit, `5.5cm`, or scale neutral and"
            " frames; of a bust or a body measure the head alone"
        ),
    ),
    NORMALS_INWARD: Meaning(
        "a mesh",
        (
            "the faces are wound inside out: the mean cosine between normals and the way out from"
            " the middle is below -0.25 (heads and faces have 0.5 to 0.9, a flat sheet 0)"
        ),
        "turn the faces over, for furrows would stand out as ridges",
    ),
    UV_MIRRORED: Meaning(
        "a mesh",
        "more than 1 % of the UV area is mirrored, seen from outside",
        (
            "flip these charts, where directions or turns are painted or pictures shall read the "
            "right way"
        ),
    ),
    UV_OVERLAP: Meaning(
        "a mesh, by UDIM",
        "more than 1 % of the covered UV area lies under two triangles or more",
        (
            "lay charts side by side or in UDIMs of their own; where halves share UV on purpose, "
            "both get the skin of the first"
        ),
    ),
    TEXEL_SIZE: Meaning(
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
    SETTINGS_CHANGED: Meaning(
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
    SETTINGS_UNUSED: Meaning(
        "settings",
        (
            "`graph` has settings of how skin is grown, beside a graph that is given; "
            "`graph.spacing` and `graph.seed` are used all the same"
        ),
        "leave them out, or leave the graph out",
    ),
    ARRAYS_UNUSED: Meaning(
        "an npz that is sent as a mesh",
        (
            "it has arrays that are not read, whose names are nearly those of some that are not "
            "there, or which have three numbers for each vertex several times, as expressions have"
        ),
        (
            "call them as the text has it, `frames` or `shapes` with `names`; offsets are first "
            "added to the positions of the mesh"
        ),
    ),
    FILES_REPLACED: Meaning(
        "a bake",
        (
            "files are there under the names of its own, and were baked by another method, with "
            "other settings or frames, or changed since, or no record of a bake beside them has "
            "them; told before the first is replaced, with `--strict` before any file is written"
        ),
        "bake into another folder, or under another `--name`, to keep them",
    ),
    DEVICES_MIXED: Meaning(
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
    METHODS_MIXED: Meaning(
        "a bake",
        (
            "its maps are by several methods: some frames were baked before by another one, and "
            "differ in more than last bits; told whether files are written or not, with `--strict` "
            "before any is; the text names the frames of each, and `NAME.bake.json` says for each "
            "map which"
        ),
        "bake the other frames by the same `--method`, or into another folder",
    ),
    PATCH_SIZE: Meaning(
        "a patch of `measure`, beside others",
        "part of it lies beside the mesh or in another UDIM: it is left out",
        "measure it by itself with the `--size` that the text has, or at another place",
    ),
    SCAN_DEPTH: Meaning(
        "a map of scanned displacement",
        (
            "95 % of it on the surface is not 0.01 to 5 mm deep, or a twentieth of it is steeper "
            "than 1 to 1"
        ),
        (
            "set the scale, or its unit (`--scale`, `--scan-unit`), to what the program that made "
            "the map says; the text has the unit that it looks like"
        ),
    ),
    SCAN_BITS: Meaning(
        "a map of scanned displacement",
        "it has 256 different values or fewer, whatever the bits of its file",
        "export 16 bits or floats from the scan or the sculpt; to convert the file adds nothing",
    ),
    SCAN_BLOCKS: Meaning(
        "a map of scanned displacement",
        (
            "differences across the borders of squares of 8 x 8 texels are more than 1.12 times "
            "those within: it was a JPEG once"
        ),
        "export PNG, TIFF or EXR from the scan or the sculpt",
    ),
    SCAN_MIDLEVEL: Meaning(
        "a map of scanned displacement",
        (
            "its midlevel lies beyond 95 % of the values on the surface, or the value outside of "
            "the charts is another by a tenth of the depth"
        ),
        (
            "set `--midlevel` to what the program that made the map says, 0, 0.5 or `auto`; where "
            "the whole surface is meant to move it may stay"
        ),
    ),
    SCAN_FLAT: Meaning(
        "a map of scanned displacement",
        "where the mesh is, all of it is one value",
        "give the map of this UDIM, or leave it out; of eyes and teeth it may stay",
    ),
    SCAN_MIRRORED: Meaning(
        "a map of scanned displacement",
        (
            "what varies in the map lies in the charts of the mesh when it is turned over, or by "
            "quarter turns, better than as it is: the correlation is higher by more than 0.12"
        ),
        (
            "turn the map over (`--flip`), or the UV of the mesh; some glTF files have v upward, "
            "which is down for readers"
        ),
    ),
    SCAN_SEAMS: Meaning(
        "scanned displacement",
        (
            "heights on the two sides of UV seams differ by more than 0.5 of how much they vary "
            "along them (rms)"
        ),
        (
            "bake the map from the mesh whose UV this is, with padding around charts (16 texels); "
            "check that it is the map of this mesh and not turned"
        ),
    ),
    SCAN_LINES: Meaning(
        "a traced scan",
        (
            "lines and pores leave more than 0.95 of the relief that is narrower than 33 texels "
            "(rms), or of all of it as much as there was: hardly anything will move"
        ),
        (
            "look at `trace.png`; trace at more texels (`--resolution`), from 16 bits or floats, "
            "and see that scale and `--flip` are right; a scan of broad forms alone has no lines"
        ),
    ),
    SCAN_FILL: Meaning(
        "a traced scan",
        (
            "grown skin is to fill in (`--fill`, `scan.fill`), and the scan is flat, masked out or "
            "missing nowhere: none has grown"
        ),
        (
            "black out what the scan shall not give (`--scan-mask`), leave out the map of a UDIM, "
            "or leave the setting out"
        ),
    ),
}
