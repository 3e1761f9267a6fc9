"""Curves as OBJ and as USD text, read back with plain regular expressions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.domain.graph_geometry import Curves
from rhytid.domain.wording import plural
from rhytid.errors import InputError, QueryError
from rhytid.exports import curves as formats
from rhytid.exports.curves import CURVE_FORMATS, curve_file, curve_format, obj_curves, usda_curves


def made(count: int, seed: int = 1) -> Curves:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count + 1, 3)) * 10.0 ** rng.integers(-6, 6, (count + 1, 1))
    return Curves(
        points.astype(np.float32),
        np.stack([np.arange(count), rng.permutation(count) + 1], axis=1),
        rng.uniform(0, 1, count).astype(np.float32),
        rng.uniform(0, 1, count).astype(np.float32),
    )


def text(pieces: Iterator[bytes]) -> str:
    return b"".join(pieces).decode("ascii")


def numbers(values: str) -> np.ndarray:
    return np.array([float(v) for v in re.findall(r"[-+.e\d]+", values)])


def attribute(written: str, name: str) -> np.ndarray:
    (found,) = re.findall(rf"^    \S+ {re.escape(name)} = \[(.*)\]", written, re.MULTILINE)
    return numbers(found)


@given(st.integers(0, 40), st.integers(1, 9))
def test_obj_has_every_point_and_line(count: int, seed: int) -> None:
    curves = made(count, seed)
    lines = text(obj_curves(curves, "cm")).splitlines()
    assert lines[0] == f"# {plural(count, 'wrinkle')}, in cm"
    points = np.array([numbers(line) for line in lines if line.startswith("v ")])
    np.testing.assert_allclose(points, curves.points, rtol=1e-6)
    joined = [numbers(line) for line in lines if line.startswith("l ")]
    np.testing.assert_array_equal(np.reshape(joined, (-1, 2)), curves.lines + 1)


@given(st.integers(0, 40), st.integers(1, 9))
def test_usda_has_two_points_a_width_and_a_strength_for_every_curve(count: int, seed: int) -> None:
    curves = made(count, seed)
    written = text(usda_curves(curves, "mm"))
    assert "metersPerUnit = 0.001" in written
    points = attribute(written, "points").reshape(-1, 2, 3)
    np.testing.assert_allclose(points, curves.points[curves.lines], rtol=1e-6)
    np.testing.assert_array_equal(attribute(written, "curveVertexCounts"), np.full(count, 2))
    np.testing.assert_allclose(attribute(written, "widths"), curves.widths, rtol=1e-6)
    strengths = attribute(written, "primvars:strength")
    np.testing.assert_allclose(strengths, curves.strengths, rtol=1e-6)
    low, high = attribute(written, "extent").reshape(2, 3)
    reach = curves.widths.max(initial=0) / 2
    assert (low <= curves.points.min(axis=0) - reach + 1e-6 * np.abs(low)).all()
    assert (high >= curves.points.max(axis=0) + reach - 1e-6 * np.abs(high)).all()


@pytest.mark.parametrize("kind", CURVE_FORMATS)
def test_pieces_change_no_byte(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    curves = made(100)
    whole = text(CURVE_FORMATS[kind].write(curves, "cm"))
    monkeypatch.setattr(formats, "_ROWS", 7)
    pieces = list(CURVE_FORMATS[kind].write(curves, "cm"))
    assert b"".join(pieces).decode() == whole
    assert len(pieces) > 30


def test_an_unknown_unit_is_left_out() -> None:
    assert "metersPerUnit" not in text(usda_curves(made(1), "span"))


def test_formats_are_known_by_extension_and_by_name() -> None:
    assert curve_file("a.b.OBJ") is curve_format("obj")
    assert curve_file("x.usda") is curve_format("usda")
    for name in ("x.usd", "obj.", "usda.png", ""):
        with pytest.raises(InputError, match=r"written as \.obj, \.usda"):
            curve_file(name)
    with pytest.raises(QueryError, match="'ply': one of safetensors, obj, usda"):
        curve_format("ply")


def test_curves_far_away_are_where_the_mesh_was_sent() -> None:
    """OBJ has the sums; USD points are single, so that they stay as they are and are moved."""
    near = replace(made(9), points=made(9).points.astype(np.float32) % np.float32(7))
    far = replace(near, centre=np.array([1e6, -2e6, 512.0]))
    lines = text(obj_curves(far, "cm")).splitlines()
    points = np.array([numbers(line) for line in lines if line.startswith("v ")])
    np.testing.assert_allclose(points, near.points.astype(float) + far.centre, atol=2e-6, rtol=0)
    moved, plain = text(usda_curves(far, "cm")), text(usda_curves(near, "cm"))
    assert "    double3 xformOp:translate = (1000000.0, -2000000.0, 512.0)\n" in moved
    assert '    uniform token[] xformOpOrder = ["xformOp:translate"]\n' in moved
    np.testing.assert_array_equal(attribute(moved, "points"), attribute(plain, "points"))
    assert "xformOp" not in plain
