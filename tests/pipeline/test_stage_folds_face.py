"""Where the real face folds, from its expressions and from captured frames."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import face_data
from rhytid.device.runtime import Device
from rhytid.domain.expressions import Expressions, Folds, axes_of
from rhytid.domain.mesh import Mesh
from rhytid.pictures.raster import vertex_normals
from rhytid.pipeline.folds import measured_folds
from rhytid.synthesis.workspace import directly

pytestmark = [pytest.mark.face, pytest.mark.slow]


@cache
def mesh() -> Mesh:
    face = face_data.load_face()
    return Mesh(face.positions, face.faces, face.uv.astype(np.float64), face.face_uv)


def measured(
    device: Device,
    positions: np.ndarray,
    names: tuple[str, ...] | None = None,
    anatomy: str = "fine",
) -> Folds:
    shapes = Expressions.checked(positions, len(mesh().positions), names)
    folds = measured_folds(device, mesh(), shapes, 0.5, "cm", lambda *_: None, directly, anatomy)
    assert folds is not None
    return folds


@cache
def by_expressions(device: Device, anatomy: str = "fine") -> Folds:
    face = face_data.load_face()
    names = face.expression_names
    return measured(device, np.stack([face.expression(name) for name in names]), names, anatomy)


def lines(folds: Folds) -> np.ndarray:
    """(V, 3) along the preferred lines."""
    return np.cross(vertex_normals(mesh().positions, mesh().faces), folds.axes()[2])


def near(x: float, y: float, radius: float) -> np.ndarray:
    """Vertices of the front about a place of both sides of the face, cm."""
    positions = mesh().positions
    gap = np.hypot(np.abs(positions[:, 0]) - x, positions[:, 1] - y)
    return np.flatnonzero((gap < radius) & (positions[:, 2] > 0))


def tilt(way: np.ndarray) -> np.ndarray:
    """Degrees from level, seen from the front, -90 to 90, up and outwards on both sides."""
    angle = np.degrees(np.arctan2(way[:, 1], way[:, 0]))
    return (angle + 90.0) % 180.0 - 90.0


def test_the_forehead_has_level_lines(device: Device, face: face_data.Face) -> None:
    folds = by_expressions(device)
    there = near(3.0, 6.8, 1.6)
    assert len(there) > 40
    found = tilt(lines(folds)[there])
    weight = folds.axes()[0][there]
    assert np.average(np.abs(found), weights=weight) < 15.0
    assert np.percentile(np.abs(found), 90) < 25.0


def test_crows_feet_fan_out(device: Device, face: face_data.Face) -> None:
    """From the corner of the eye: upwards above it, downwards below."""
    way = lines(by_expressions(device))
    way[:, 0] *= np.sign(mesh().positions[:, 0])
    level = [float(np.mean(tilt(way[near(6.3, y, 0.5)]))) for y in (4.0, 3.4, 2.8, 2.2, 1.6)]
    assert (np.diff(level) < -4.0).all()
    assert level[0] > 15.0
    assert level[-1] < -5.0


def test_lips_have_upright_rays(device: Device, face: face_data.Face) -> None:
    way = lines(by_expressions(device))
    for y in (-2.8, -3.8):
        found = tilt(way[near(0.0, y, 0.5)])
        assert np.median(90.0 - np.abs(found)) < 15.0


def test_captured_frames_say_much_the_same(device: Device, face: face_data.Face) -> None:
    frames = np.stack([face.captured(i) for i in range(0, 4030, 10)])
    captured = measured(device, frames)
    assert captured.moving == 400
    one, two = by_expressions(device).axes(), captured.axes()
    turn = np.degrees(np.arccos(np.clip(np.abs((one[2] * two[2]).sum(1)), 0.0, 1.0)))
    size = one[0] * two[0]
    assert np.average(turn, weights=size) < 26.0
    # Where skin is compressed alike in all directions there is no direction to agree on.
    assert np.average(turn, weights=size * one[1] * two[1]) < 16.0


# The middle of each region, cm.
INSIDE = {
    "forehead": (3.0, 6.8),
    "eye_corner": (4.8, 2.4),
    "lip": (0.0, -3.9),
    "nose": (0.0, 1.2),
    "cheek": (5.0, -3.0),
    "neck": (0.0, -13.0),
    "mouth": (0.0, -7.0),
}
# The masks at a border that is seen, within two edges.
SHARP = ("lip", "mouth")


@pytest.mark.parametrize("anatomy", ["fine", "coarse"])
def test_regions_come_by_themselves(device: Device, face: face_data.Face, anatomy: str) -> None:
    folds = by_expressions(device, anatomy)
    inside = {name: at for name, at in INSIDE.items() if name != "mouth" or anatomy == "fine"}
    assert set(folds.regions) == set(inside)
    for region, mask in folds.regions.items():
        assert mask.min() >= 0.0
        assert mask.max() <= 1.0
        for name, (x, y) in inside.items():
            there = mask[near(x, y, 0.4)].mean()
            # A cheek takes what the others leave, and a mouth what the lips do.
            own = folds.regions[name][near(x, y, 0.4)].mean()
            most = 1.0 - own if region in ("cheek", "mouth") else 0.05
            assert (there > 0.4) if name == region else (there <= most), (region, name, there)
        # The top of the forehead is of none, nor is the back of the head, nor a coarse chin.
        for x, y in ((0.0, 10.5), *([] if anatomy == "fine" else [(0.0, -7.2)])):
            assert mask[near(x, y, 0.5)].max() < 0.05
        back = mesh().positions[:, 2] < -2.0
        assert mask[back & (mesh().positions[:, 1] > -6.0)].max() < 0.05
        # Soft: hardly more than a third within one edge of 2 mm.
        edges = mesh().faces[:, :2]
        short = np.linalg.norm(np.diff(mesh().positions[edges], axis=1)[:, 0], axis=1) < 0.2
        most = 0.6 if region in SHARP and anatomy == "fine" else 0.35
        assert np.abs(np.diff(mask[edges[short]], axis=1)).max() < most


def test_lips_end_at_their_border(device: Device, face: face_data.Face) -> None:
    """On the real face the red begins 2.5 cm below the nose's tip and ends 4.5 cm below; it is
    2.5 cm wide on either side, and as full near the corners below as above."""
    fine = by_expressions(device).regions["lip"]
    for x, above, below, red, within in (
        (0.0, -1.9, -5.1, (-2.9, -3.9), 11.0),
        (1.2, -1.7, -5.0, (-2.9, -3.9), 11.0),
        (1.8, -2.2, -4.7, (-3.2, -3.8), 10.5),
    ):
        outside = mesh().positions[:, 2] > within  # not within the mouth
        for y in red:
            there = near(x, y, 0.25)
            assert fine[there[outside[there]]].mean() > 0.8, (x, y)
        for y in (above, below):
            assert fine[near(x, y, 0.25)].max() < 0.1, (x, y)
            assert by_expressions(device).regions["mouth"][near(x, y, 0.25)].mean() > 0.5, (x, y)


def test_the_nose_is_what_stands_out_between_sneers(device: Device, face: face_data.Face) -> None:
    mask = by_expressions(device).regions["nose"]
    outside = vertex_normals(mesh().positions, mesh().faces)[:, 2] > 0.3  # not in the nostrils
    for x, y in ((0.0, 0.2), (0.0, 1.2), (1.3, -0.6)):  # tip, bridge, wing
        there = near(x, y, 0.4)
        there = there[outside[there] & (mesh().positions[there, 2] > 10.5)]
        assert len(there) > 3
        assert mask[there].mean() > 0.7, (x, y)
    for x, y in ((0.0, 4.0), (3.0, 0.0), (0.0, -2.8)):  # between the brows, cheek, lip
        assert mask[near(x, y, 0.4)].max() < 0.05, (x, y)


def test_a_turned_head_has_the_same_nose(device: Device, face: face_data.Face) -> None:
    """Its up and its front are those of the sneer."""
    angle = np.radians(40.0)
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    turned = Mesh((face.positions @ turn.T).astype(np.float32), face.faces, mesh().uv, face.face_uv)
    both = np.stack([face.expression(name) for name in ("noseSneer_L", "noseSneer_R")])
    names = ("noseSneer_L", "noseSneer_R")
    shapes = Expressions.checked((both @ turn.T).astype(np.float32), len(turned.positions), names)
    found = measured_folds(device, turned, shapes, 0.5, "cm", lambda *_: None, directly)
    assert found is not None
    upright = measured(device, both, names).regions["nose"]
    np.testing.assert_allclose(found.regions["nose"], upright, atol=0.01)


def test_one_sneer_alone_shows_no_nose(device: Device, face: face_data.Face) -> None:
    left = np.stack([face.expression("noseSneer_L")])
    assert "nose" not in measured(device, left, ("noseSneer_L",)).regions
    # Both at once do.
    both = np.stack([face.evaluate({"noseSneer_L": 1.0, "noseSneer_R": 1.0})])
    assert "nose" in measured(device, both, ("sneer",)).regions


def test_the_floor_of_the_mouth_is_neck(device: Device, face: face_data.Face) -> None:
    place = mesh().positions
    under = np.flatnonzero(np.linalg.norm(place - (0.8, -8.3, 6.8), axis=1) < 0.6)
    assert by_expressions(device).regions["neck"][under].min() > 0.9
    assert by_expressions(device, "coarse").regions["neck"][under].max() < 0.1


def test_a_closing_jaw_shows_no_neck(device: Device, face: face_data.Face) -> None:
    opened, closed = (np.stack([face.expression("jawOpen", w)]) for w in (1.0, -1.0))
    assert "neck" in measured(device, opened, ("jawOpen",)).regions
    assert "neck" not in measured(device, closed, ("jawOpen",)).regions


def test_names_alone_make_regions(device: Device, face: face_data.Face) -> None:
    positions = np.stack([face.expression("browInnerUp_L"), face.expression("mouthPucker")])
    assert measured(device, positions).regions == {}
    assert set(measured(device, positions, ("browInnerUp_L", "kiss")).regions) == {
        "forehead",
        "lip",
        "mouth",
    }


def test_a_frown_has_its_pair_between_the_brows(device: Device, face: face_data.Face) -> None:
    folds = by_expressions(device)
    assert folds.frown is not None
    assert by_expressions(device, "coarse").frown is None
    both = mesh().positions + sum(
        face.expression(f"browDown_{side}") - mesh().positions for side in "LR"
    )
    single = measured(device, both[None].astype(np.float32), ("AU4",)).frown
    assert single is not None
    positions = mesh().positions
    for found in (folds.frown, single):
        for side in (1.0, -1.0):
            high = positions[side * found > 0.5]
            assert len(high) > 8
            assert (side * high[:, 0] > 0.25).all()
            assert (side * high[:, 0] < 1.5).all()
            assert np.ptp(high[:, 1]) == pytest.approx(1.4, abs=0.5)
        assert np.abs(found[near(0.75, 5.2, 0.2)]).min() > 0.4


def test_an_open_jaw_has_a_fan_below_each_corner_of_the_mouth(
    device: Device, face: face_data.Face
) -> None:
    folds = by_expressions(device)
    assert folds.fans is not None
    assert by_expressions(device, "coarse").fans is None
    size, one_way, axis = axes_of(folds.fans)
    positions = mesh().positions
    for side in (1.0, -1.0):
        corner = np.linalg.norm(positions - np.float32([side * 2.2, -3.5, 9.8]), axis=1)
        led = size > 0.1
        assert (size[(positions[:, 0] * side > 0) & (corner > 3.5)] < 0.05).all()
        below = led & (corner < 2.5) & (positions[:, 1] < -4.0) & (one_way > 0.2)
        assert np.count_nonzero(below) > 15
        assert (folds.regions["lip"][below & (size > 0.15)] < 0.5).all()
        # Lines leave the corner: what is pressed lies across the way from there.
        way = positions[below] - np.float32([side * 2.2, -3.5, 9.8])
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        assert np.median(np.abs(np.einsum("nx,nx->n", way, axis[below]))) < 0.35


def test_no_fan_where_no_jaw_opens_or_lips_are_not_known(
    device: Device, face: face_data.Face
) -> None:
    shapes = {name: face.expression(name) for name in ("jawOpen", "mouthPucker")}
    closed = np.stack([face.expression("jawOpen", -1.0), shapes["mouthPucker"]])
    both = np.stack(list(shapes.values()))
    assert measured(device, both, ("jawOpen", "mouthPucker")).fans is not None
    assert measured(device, both, ("jawLeft", "mouthPucker")).fans is None
    assert measured(device, both, ("jawOpen", "other")).fans is None
    assert measured(device, closed, ("jawOpen", "mouthPucker")).fans is None
