"""What is said of scanned displacement on its mesh: facts, and what is probably wrong."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from meshes import bumpy_grid
from rhytid.domain.mesh import Mesh
from rhytid.domain.scan import Scan, ScanMap, ScanSettings
from rhytid.meshes.scan_check import MapFacts, ScanCheck
from rhytid.meshes.scan_samples import Seams, SurfaceSamples
from rhytid.meshes.scan_values import TURNS, best_turn
from rhytid.meshes.scans import charts, scan_of
from rhytid.pictures.raster import rasterize_uv

SIDE = 512
MESH = Mesh(*bumpy_grid())
FULL = ScanSettings((1.0,), unit="mm")


def relief(mesh: Mesh = MESH, side: int = SIDE, padding: int = 16) -> NDArray[np.float64]:
    """Heights in mm that depend on the place in space alone, 0.1 deep, padded around charts."""
    seen = rasterize_uv(mesh.triangle_uv(), side)
    place = seen.smooth(mesh.positions[mesh.faces].astype(np.float64))
    x, y = place[..., 0], place[..., 1]
    found = 0.05 * np.sin(40 * x + 3 * y) * np.cos(31 * y - x) + 0.02 * np.sin(11 * x * y)
    far, near = ndimage.distance_transform_edt(~seen.covered, return_indices=True)
    return np.where(far <= padding, found[tuple(near)], 0.0)


RELIEF = relief()


def coded(heights: NDArray[np.float64], kind: type = np.uint16) -> NDArray[Any]:
    """Codes of a scale of 1 mm around the middle."""
    most = np.iinfo(kind).max
    return np.rint((heights + 0.5) * most).clip(0, most).astype(kind)


def checked(
    texels: NDArray[Any], settings: ScanSettings = FULL, mesh: Mesh = MESH, unit: str = "cm"
) -> ScanCheck:
    maps = {1001: ScanMap(1001, "d.1001.x", (texels,))}
    return ScanCheck(scan_of(maps, settings, mesh, unit), mesh, unit, settings)


def told(check: ScanCheck) -> dict[str, str]:
    return {warning.code: str(warning) for warning in check.warnings()}


def facts(check: ScanCheck) -> MapFacts:
    (one,) = check.maps
    return one


def test_a_good_map_is_not_warned_of() -> None:
    check = checked(coded(RELIEF))
    assert told(check) == {}
    one = facts(check)
    assert (one.bits, one.kind, one.turn, one.flat) == (16, "16 bits", "as it is", False)
    assert one.step == pytest.approx(0.1 / 65535)
    assert one.outside == pytest.approx(0.5, abs=1e-4)
    inside = RELIEF[charts(MESH, 1001)]
    assert 10 * one.low == pytest.approx(np.percentile(inside, 2.5), abs=0.004)
    assert 10 * one.high == pytest.approx(np.percentile(inside, 97.5), abs=0.004)
    assert check.seams is not None
    assert check.seams.share < 0.3
    assert [row[0] for row in check.rows()][-1] == "scan, seams differ"
    assert told(checked((0.1 * RELIEF).astype(np.float32), ScanSettings())) == {}


def jpeg(texels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    out = io.BytesIO()
    Image.fromarray(texels).save(out, "JPEG", quality=75)
    return np.asarray(Image.open(out))


WRONG: dict[str, tuple[Callable[[], ScanCheck], str, str]] = {
    "cm for mm": (
        lambda: checked(coded(RELIEF), ScanSettings((10.0,), unit="cm")),
        "scan-depth",
        r"95 % of it is 11 mm deep.*is the scale in mm, not in cm\? Then it is 1\.1 mm",
    ),
    "metres for mm": (
        lambda: checked(coded(RELIEF), ScanSettings((1.0,), unit="m")),
        "scan-depth",
        "is the scale in mm, not in m",
    ),
    "micrometres": (
        lambda: checked(coded(RELIEF), ScanSettings((1.0,), unit="um")),
        "scan-depth",
        "95 % of it is 0.00011 mm deep; .* is the scale in mm, not in um",
    ),
    "metres, which feet fit no worse": (
        lambda: checked(coded(RELIEF), ScanSettings((0.004,), unit="mm")),
        "scan-depth",
        r"95 % of it is 0\.00044 mm deep; .* is the scale in m, not in mm",
    ),
    "walls": (
        lambda: checked(coded(RELIEF), ScanSettings((40.0,), unit="mm")),
        "scan-depth",
        "a twentieth of it is steeper than .* is the scale, in mm, right",
    ),
    "cm for mm, not too deep": (
        lambda: checked(coded(0.8 * RELIEF), ScanSettings((1.0,))),
        "scan-depth",
        r"95 % of it is 0\.8\d* mm deep, and a twentieth of it is steeper .* in mm, not in cm",
    ),
    "8 bits": (
        lambda: checked(coded(RELIEF, np.uint8)),
        "scan-bits",
        r"it has 8 bits, in steps of 0\.0039 mm",
    ),
    "8 bits in 16": (
        lambda: checked(coded(RELIEF, np.uint8).astype(np.uint16) * 257),
        "scan-bits",
        r"it has 8 bits, in steps of 0\.0039 mm",
    ),
    "8 bits in floats": (
        lambda: checked((coded(RELIEF, np.uint8) / 2550 - 0.05).astype(np.float32), ScanSettings()),
        "scan-bits",
        r"in steps of 0\.0039 mm",
    ),
    "JPEG": (
        lambda: checked(jpeg(coded(RELIEF, np.uint8)).astype(np.uint16) * 257),
        "scan-blocks",
        r"squares of 8 x 8 texels stand out",
    ),
    "black for the midlevel": (
        lambda: checked(coded(RELIEF), replace(FULL, midlevel=0.0)),
        "scan-midlevel",
        r"the whole surface moves by 0\.5 mm: the midlevel is 0, the middle value 0\.\d+",
    ),
    "another midlevel outside": (
        lambda: checked(coded(RELIEF + 0.015)),
        "scan-midlevel",
        r"outside of the charts the map is 0\.515, the midlevel is 0\.5: .* moves by 0\.015 mm",
    ),
    "flat": (
        lambda: checked(np.full((64, 64), 32768, np.uint16)),
        "scan-flat",
        "the map is flat where the mesh is",
    ),
    "upside down": (
        lambda: checked(coded(TALL_RELIEF[::-1]), mesh=TALL),
        "scan-mirrored",
        "fits the charts of the mesh better turned, top to bottom: .* --flip v turns it over",
    ),
    "another's seams": (
        lambda: checked(coded(0.05 * NOISE)),
        "scan-seams",
        r"worst at \(.*\), uv \(.*\) and \(.*\): the two sides of UV seams differ by .* will show",
    ),
}
NOISE = ndimage.gaussian_filter(np.random.default_rng(3).normal(0, 20, (SIDE, SIDE)), 6)


def tall() -> Mesh:
    """The grid with its charts in the upper part of the UDIM, the left one smaller."""
    uv = MESH.uv * (0.9, 0.7) + (0.0, 0.28)
    uv[:, 1] -= 0.25 * (uv[:, 0] < 0.4) * (uv[:, 1] - 0.6)
    return replace(MESH, uv=uv)


TALL = tall()
TALL_RELIEF = relief(TALL)


@pytest.mark.parametrize("what", WRONG)
def test_what_is_probably_wrong_is_told_with_its_cause(what: str) -> None:
    make, code, text = WRONG[what]
    check = make()
    assert code in told(check)
    assert re.search(text, told(check)[code]), told(check)[code]
    if code != "scan-seams":
        assert "d.1001.x, UDIM 1001" in told(check)[code]
    expected = {"JPEG": {"scan-bits", "scan-blocks"}}.get(what, {code})
    assert set(told(check)) <= expected | {"scan-seams"}


def test_every_band_is_looked_at() -> None:
    """The second one has 8 bits, the third was a JPEG."""
    coarse = coded(RELIEF, np.uint8).astype(np.uint16) * 257
    fine = coded(NOISE / 400)
    blocky = jpeg(coded(NOISE / 50, np.uint8)).astype(np.uint16) * 257 + fine % 64
    maps = {1001: ScanMap(1001, "d.1001.x", (fine, coarse, blocky))}
    settings = ScanSettings((0.1, 2.0, 0.1), unit="mm")
    one = facts(ScanCheck(scan_of(maps, settings, MESH, "cm"), MESH, "cm", settings))
    assert (one.channels, one.bits) == (3, 8)
    assert one.step == pytest.approx(0.2 / 255)
    assert one.blocks > 1.12


def test_a_first_band_that_is_left_out_moves_no_surface() -> None:
    """Its scale is 0, and the midlevel of the others is off."""
    bands = tuple(coded(0.2 + one) for one in (NOISE / 50, RELIEF, NOISE / 400))
    maps = {1001: ScanMap(1001, "d.1001.x", bands)}
    settings = ScanSettings((0.0, 1.0, 0.1), unit="mm")
    text = told(ScanCheck(scan_of(maps, settings, MESH, "cm"), MESH, "cm", settings))
    assert re.search(
        r"whole surface moves by 0\.2\d* mm: the midlevel is 0\.5", text["scan-midlevel"]
    )


@pytest.mark.parametrize("turn", TURNS)
def test_how_a_map_was_turned_is_found(turn: str) -> None:
    """And what is named turns it back."""
    covered = charts(TALL, 1001)
    quarters, mirrored = TURNS[turn]
    map = coded(TALL_RELIEF)
    wrong = np.rot90(map[:, ::-1] if mirrored else map, -quarters)
    assert best_turn(wrong, covered) == turn


def test_a_map_that_is_turned_back_is_right() -> None:
    wrong, right = coded(TALL_RELIEF[::-1]), checked(coded(TALL_RELIEF), mesh=TALL)
    back = checked(wrong, replace(FULL, flip="v"), mesh=TALL)
    assert back.figures() == right.figures()


def test_what_lies_outside_of_the_charts_is_listed() -> None:
    for texels, outside in ((coded(RELIEF), "0.5"), (coded(NOISE / 400), "many values")):
        rows = {name: found for name, found, _ in checked(texels).rows()}
        assert rows["scan 1001, midlevel"] == f"0.5, outside of the charts: {outside}"


@pytest.mark.parametrize(
    ("given", "right", "said"),
    [
        ("v", None, "; leave --flip v out, if"),
        ("uv", "v", "; give --flip v instead, if"),
        ("u", "v", "; give --flip v instead, if"),
        ("v", "u", "; give --flip u instead, if"),
        ("v", "uv", "; give --flip uv instead, if"),
        (None, "uv", "; --flip uv turns it over, if"),
    ],
)
def test_the_flip_that_was_given_is_thought_of(
    given: str | None, right: str | None, said: str
) -> None:
    (map,) = ScanMap(1001, "d", (coded(TALL_RELIEF),)).flipped(right).channels
    check = checked(map, replace(FULL, flip=given), mesh=TALL)
    assert said in told(check)["scan-mirrored"]


def test_what_is_alike_everywhere_tells_nothing_of_turns() -> None:
    covered = charts(TALL, 1001)
    assert best_turn(coded(0.02 * NOISE), covered) == "as it is"
    assert best_turn(np.zeros((64, 64), np.float32), covered) == "as it is"


def test_samples_are_even_on_the_surface_and_steep_where_it_is() -> None:
    """A plane twice as long as wide in space, square in UV, with a ramp of 0.3 along u."""
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    points = np.pad(uv * (2.0, 1.0), ((0, 0), (0, 1))).astype(np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(points, faces, uv, faces)
    samples = SurfaceSamples.of(mesh)
    counts = np.histogram2d(*samples.uv.T, bins=8, range=[[0, 1], [0, 1]])[0]
    assert counts.min() > 0.97 * counts.mean()
    ramp = np.broadcast_to(0.3 * (np.arange(256) + 0.5) / 256, (256, 256)).astype(np.float32)
    scan = Scan({1001: ScanMap(1001, "d", (ramp,))}, (1.0,), {1001: (0.0,)})
    heights, steep = samples.heights(scan, 1001)
    middle = np.abs(samples.uv[:, 0] - 0.5) < 0.49
    assert heights[middle] == pytest.approx(0.3 * samples.uv[middle, 0], abs=1e-6)
    assert steep[middle] == pytest.approx(0.15, rel=1e-3)


def test_seams_are_edges_with_two_places_in_uv() -> None:
    seams = Seams.of(MESH)
    assert len(seams) == 10
    uv, space = seams.places
    assert uv.shape == (10, 4, 2, 2)
    assert space[..., 0] == pytest.approx(0.0, abs=1e-6)
    at = {tuple(MESH.uv[t]): MESH.positions[v] for v, t in zip(
        MESH.faces.reshape(-1), MESH.face_uv.reshape(-1), strict=True)}  # fmt: skip
    for side in (0, 1):
        for end in (0, 1):
            places = np.stack([at[tuple(one)] for one in seams.uv[:, side, end]])
            assert np.array_equal(places, seams.ends[:, end])
    flipped = replace(MESH, faces=MESH.faces[:, ::-1], face_uv=MESH.face_uv[:, ::-1])
    other = Seams.of(flipped)
    assert np.array_equal(other.uv, seams.uv)
    assert np.array_equal(other.ends, seams.ends)


def test_what_is_flat_or_masked_out_is_left_out() -> None:
    """A square of 100 texels a side in a sharp map, of 8 bits as of 16; fainter noise is not flat,
    nor is a square less wide than the border."""
    map = np.random.default_rng(2).normal(0.0, 0.05, (SIDE, SIDE))
    map[200:300, 100:200] = 0.1
    map[20:24, 20:24] = 0.1
    wide = 10 * SIDE * 0.4 * checked(coded(map)).maps[0].texel  # 0.4 of the square, in mm
    for kind in (np.uint8, np.uint16):
        check = checked(coded(map, kind), replace(FULL, fill=0.1 * wide))
        found = check.relief(SIDE)
        assert found.border == pytest.approx(0.01 * wide)
        [denied] = found.denied.values()
        assert denied.reshape(SIDE, 2, SIDE, 2).mean((1, 3))[202:298, 102:198].min() == 1.0
        assert denied.mean() == pytest.approx((100 / SIDE) ** 2, rel=0.1)
    noise = coded(np.random.default_rng(3).normal(0.0, 0.05, (128, 128)))
    for fill in (1e-6, 1e6):
        assert checked(noise, replace(FULL, fill=fill)).relief(SIDE).denied == {}
    grey = np.full((4, 2), 255, np.uint8)
    grey[0] = 0
    check = replace(checked(coded(map)), masks={1001: grey})
    assert check.relief(SIDE).border == 0.0
    rows = check.relief(SIDE).denied[1001].mean(axis=1)
    assert rows[:128].min() == 1.0
    assert rows[300:].max() == 0.0


def test_detail_counts_from_the_file_or_from_its_spectrum() -> None:
    """Sharp noise, and the same blurred by two texels, whose density, as it was
    level, falls with the power -7 where waves are 6.7 texels long; bands without relief
    say nothing."""
    sharp = np.random.default_rng(2).normal(0.0, 0.02, (SIDE, SIDE))
    blurred = 4 * ndimage.gaussian_filter(sharp, 2.0)
    for map, side in ((sharp, SIDE), (blurred, pytest.approx(SIDE * 2 / 6.7, rel=0.1))):
        for detail, ends in ((None, SIDE), (0.5, side)):
            found = checked(coded(map), replace(FULL, detail=detail)).relief(1024)
            assert (found.ends, found.detail) == ({1001: ends}, detail or 1.0)
    nothing = np.full(blurred.shape, 32768, np.uint16)
    for bands, scale in (
        ((coded(blurred), nothing, nothing), (1.0, 2.0, 3.0)),
        ((coded(blurred), coded(sharp), nothing), (1.0, 0.0, 2.0)),
    ):
        maps, how = {1001: ScanMap(1001, "d.1001.x", bands)}, ScanSettings(scale, detail=0.5)
        check = ScanCheck(scan_of(maps, how, MESH, "cm"), MESH, "cm", how)
        assert check.relief(1024).ends == {1001: pytest.approx(SIDE * 2 / 6.7, rel=0.1)}
    for detail, side in ((None, SIDE), (0.0, 1024)):
        found = checked(coded(sharp), replace(FULL, detail=detail)).relief(side)
        assert (dict(found.ends), found.detail) == ({}, 0.0)
