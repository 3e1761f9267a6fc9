"""Lines in space for other programs: OBJ polylines, and USD BasisCurves as text.

Both come in pieces of bounded size, for graphs of millions of wrinkles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph_geometry import Curves
from rhytid.domain.mesh import add_centre
from rhytid.domain.wording import plural
from rhytid.errors import InputError, QueryError
from rhytid.exports.usda import usda_header

# Rows of an array that become text at once.
_ROWS = 1 << 16


@dataclass(frozen=True)
class CurveFormat:
    """The media type of a file of curves, and the function that writes it: from curves and a unit
    of length, in pieces."""

    media_type: str
    write: Callable[[Curves, str], Iterator[bytes]]


def obj_curves(curves: Curves, unit: str) -> Iterator[bytes]:
    """OBJ in pieces: vertices in `unit`, and a line element for each wrinkle. OBJ has no place for
    widths."""
    yield f"# {plural(len(curves.lines), 'wrinkle')}, in {unit}\n".encode()
    # A float32 has 7 digits; far from the origin they go on behind those of the centre.
    item = "v %.13g %.13g %.13g\n" if curves.centre.any() else "v %.7g %.7g %.7g\n"
    yield from _rows(item, add_centre(curves.points, curves.centre))
    yield from _rows("l %d %d\n", curves.lines + 1)


def usda_curves(curves: Curves, unit: str) -> Iterator[bytes]:
    """USD as text, in pieces: a linear BasisCurves prim in `unit` with widths and the primvar
    `strength`, one value per curve."""
    head = "\n".join(usda_header(unit, ['defaultPrim = "Wrinkles"']))
    yield (
        f'{head}\n\ndef BasisCurves "Wrinkles"\n{{\n    uniform token type = "linear"\n'
        '    uniform token wrap = "nonperiodic"\n'
    ).encode()
    count, uniform = len(curves.lines), '(\n        interpolation = "uniform"\n    )'
    points = curves.points[curves.lines.ravel()]
    yield from _array("float3[] extent", "(%.7g, %.7g, %.7g)", _extent(curves))
    yield from _array("int[] curveVertexCounts", "%d", np.full((count, 1), 2))
    yield from _array("point3f[] points", "(%.7g, %.7g, %.7g)", points)
    yield from _array("float[] widths", "%.7g", curves.widths[:, None], uniform)
    strengths = curves.strengths[:, None]
    yield from _array("float[] primvars:strength", "%.7g", strengths, uniform)
    if curves.centre.any():
        place = ", ".join(repr(float(x)) for x in curves.centre)
        yield f"    double3 xformOp:translate = ({place})\n".encode()
        yield b'    uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    yield b"}\n"


CURVE_FORMATS = {
    "obj": CurveFormat("model/obj", obj_curves),
    "usda": CurveFormat("model/vnd.usda", usda_curves),
}


def curve_format(name: str) -> CurveFormat:
    """The format of that name; raises QueryError naming the formats that are known."""
    if name not in CURVE_FORMATS:
        raise QueryError(f"format {name!r}: one of safetensors, {', '.join(CURVE_FORMATS)}")
    return CURVE_FORMATS[name]


def curve_file(name: str) -> CurveFormat:
    """The format of a file by its extension; raises InputError naming the extensions that are
    known."""
    found = CURVE_FORMATS.get(name.rpartition(".")[2].lower())
    if found is None:
        known = ", ".join(f".{extension}" for extension in CURVE_FORMATS)
        raise InputError(f"{name}: curves are written as {known}")
    return found


def _extent(curves: Curves) -> NDArray[np.float32]:
    """(2, 3) corners of the box around the curves, their widths included; (0, 3) for none."""
    if not len(curves.points):
        return curves.points
    reach = 0.5 * curves.widths.max(initial=0.0)
    corners = [curves.points.min(axis=0) - reach, curves.points.max(axis=0) + reach]
    return np.array(corners, np.float32)


def _array(name: str, item: str, values: NDArray[Any], after: str = "") -> Iterator[bytes]:
    yield f"    {name} = [".encode()
    yield from _rows(item, values, ", ")
    yield f"] {after}".rstrip().encode() + b"\n"


def _rows(item: str, values: NDArray[Any], between: str = "") -> Iterator[bytes]:
    """`item` filled with each row of `values` (K, n)."""
    for start in range(0, len(values), _ROWS):
        part = values[start : start + _ROWS]
        numbers: Sequence[Any] = part.ravel().tolist()
        text = between.join([item] * len(part)) % tuple(numbers)
        yield (between * (start > 0) + text).encode()
