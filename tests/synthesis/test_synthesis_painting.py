"""Fields against their meaning in double: maps, regions and settings at single points."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray

from reference import controls as reference
from reference.stiffness import bilinear
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import REGIONS
from rhytid.synthesis.fields import Fields, level_directions
from rhytid.synthesis.painted_fields import PaintedFields, fields_of
from rhytid.synthesis.painting import PaintedMaps, normals_at
from rhytid.synthesis.pore_density import effective_area
from rhytid.synthesis.surface import Surface
from rhytid_lab.samples.face import procedural_face
from synthesis import sheets

RNG = np.random.default_rng(3)
COUNT = 300


def noise(*shape: int, low: float = 0.0) -> NDArray[np.float32]:
    return RNG.uniform(low, 1, shape).astype(np.float32)


@pytest.fixture(scope="module")
def wide() -> Surface:
    """Over two UDIMs, 1001 and 1002, with triangles that end on their border."""
    return Surface.of(sheets.sheet(lambda xy: xy * [2.0, 1.0]))


def inside(surface: Surface) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Points in triangles."""
    triangle = RNG.choice(np.flatnonzero(surface.carries), COUNT)
    share = RNG.dirichlet([1, 1, 1], COUNT)
    return triangle, np.einsum("nc,ncx->nx", share, surface.uv[triangle])


def at(one: dict[int, NDArray[np.float32]], uv: NDArray[np.float64]) -> list[float]:
    return list(reference.grey_at(one, uv, 0.5))


def test_lookups_are_bilinear_in_their_udim(wide: Surface) -> None:
    maps = {1002: noise(5, 9)}
    triangle, uv = inside(wide)
    found = PaintedMaps(wide, maps).at(triangle, uv, neutral=0.25)
    np.testing.assert_allclose(found, reference.grey_at(maps, uv, 0.25), atol=3e-7, rtol=0)


def test_a_corner_on_the_border_belongs_to_its_triangle(wide: Surface) -> None:
    maps = {1001: np.zeros((2, 2), np.float32), 1002: np.ones((2, 2), np.float32)}
    index, corner = np.nonzero(wide.uv[..., 0] == 1.0)
    found = PaintedMaps(wide, maps).at(index, wide.uv[index, corner])
    assert len(index) > 20
    assert (found == (wide.uv[index].mean(axis=1)[:, 0] > 1)).all()


@pytest.mark.parametrize(
    ("name", "method", "meaning"),
    [
        ("strength", "strength", reference.linear),
        ("anisotropy", "anisotropy", reference.linear),
        ("scale", "width", reference.sized),
        ("pore_radius", "pore_radius", reference.sized),
        ("turn", "turn", lambda grey: np.pi / 2 * reference.signed(grey)),
    ],
)
def test_greys_mean_what_the_table_says(
    wide: Surface, name: str, method: str, meaning: reference.Array
) -> None:
    maps, (triangle, uv) = {1001: noise(7, 6), 1002: noise(3, 3)}, inside(wide)
    fields = PaintedFields(wide, GraphSettings(), Controls({name: maps}))
    wanted = [meaning(grey) for grey in at(maps, uv)]
    np.testing.assert_allclose(getattr(fields, method)(triangle, uv), wanted, atol=1e-5, rtol=1e-5)
    even = Fields().spacing(triangle, uv)
    assert (fields.spacing(triangle, uv) == even).all()


def test_density_sets_spacing_size_and_depth_and_bares(wide: Surface) -> None:
    maps, (triangle, uv) = {1001: noise(7, 6)}, inside(wide)
    fields = PaintedFields(wide, GraphSettings(), Controls({"density": maps}))
    density = np.array([reference.density(grey) for grey in at(maps, uv)])
    spacing = np.maximum(density, 1 / 6) ** -0.5
    for found, wanted in (
        (fields.spacing, spacing),
        (fields.width, spacing),
        (fields.pore_radius, spacing),
        (fields.strength, np.minimum(spacing, 1)),
    ):
        np.testing.assert_allclose(found(triangle, uv), wanted, rtol=2e-5)
    clear = np.abs(density - 0.25) > 1e-3
    bare = fields.bare(triangle, uv)
    assert (bare == (density < 0.25))[clear].all()
    assert 0 < bare.mean() < 1
    drawn = spacing[~bare]
    assert fields.least_spacing <= drawn.min() * (1 + 1e-5)
    assert fields.most_spacing >= drawn.max() * (1 - 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("corner", [(40, 70), (101, 33), (120, 121)])
def test_a_speck_on_large_triangles_has_the_room_that_it_covers(corner: tuple[int, int]) -> None:
    surface, grey = Surface.of(sheets.sheet(n=1)), np.zeros((256, 256), np.float32)
    row, column = corner
    grey[row : row + 3, column : column + 3] = 1.0
    fields = PaintedFields(surface, GraphSettings(), Controls({"density": {1001: grey}}))
    # Over the speck and what its edge fades over, one point at a time; the sheet is 0.8 wide.
    fine = (np.arange(100) + 0.5) / 100 * 8
    x, y = np.meshgrid((column - 2.5 + fine) / 256, 1 - (row - 2.5 + fine) / 256)
    greys = reference.grey_at({1001: grey}, np.stack([x.ravel(), y.ravel()], axis=-1), 0.0)
    density = np.array([reference.density(g) for g in greys])
    wanted = np.where(density < 0.25, 0.0, density).mean() * (8 / 256 / 0.8) ** 2
    assert effective_area(surface, fields) == pytest.approx(wanted, rel=0.05)


def test_regions_mix_by_their_masks(wide: Surface) -> None:
    nose, lip = {1001: noise(4, 4)}, {1001: noise(5, 5), 1002: noise(3, 3)}
    triangle, uv = inside(wide)
    fields = PaintedFields(
        wide, GraphSettings(region="neck", strength=0.5),
        Controls({"region_nose": nose, "region_lip": lip}),
    )  # fmt: skip
    weights = [reference.grey_at(maps, uv, 0.0) for maps in (nose, lip)]
    assert (sum(weights) > 1).any()

    def mixed(name: str) -> NDArray[np.float64]:
        base, *others = (getattr(REGIONS[r], name) for r in ("neck", "nose", "lip"))
        pairs = np.stack(weights, axis=-1)
        return np.array(
            [reference.mixed_factor(base, list(zip(p, others, strict=True))) for p in pairs]
        )

    spacing = mixed("density") ** -0.5
    strength = 0.5 * mixed("strength") * np.minimum(spacing, 1)
    for found, wanted in (
        (fields.spacing, spacing),
        (fields.width, spacing * mixed("scale")),
        (fields.pore_radius, spacing * mixed("pore_radius")),
        (fields.anisotropy, np.minimum(mixed("anisotropy"), 2.0)),
        (fields.bend, mixed("bend")),
        (fields.strength, strength),
        (fields.pore_strength, strength * mixed("pore_strength")),
    ):
        np.testing.assert_allclose(found(triangle, uv), wanted, rtol=2e-5)
    share = weights[1] / np.maximum(sum(weights), 1)
    np.testing.assert_allclose(fields.turn(triangle, uv), np.radians(90 * share), atol=1e-5)


def test_painted_directions_lie_on_the_surface_as_they_do_in_uv() -> None:
    surface = Surface.of(procedural_face(24).mesh)
    maps = {1001: noise(1, 1)}
    triangle, uv = inside(surface)
    fields = PaintedFields(surface, GraphSettings(), Controls({"direction": maps}))
    turn = fields.turn(triangle, uv).astype(float)[:, None]
    normal = normals_at(surface, triangle, uv)
    level = level_directions(normal)
    found = np.cos(turn) * level + np.sin(turn) * np.cross(normal, level)
    for i in range(COUNT):
        wanted = reference.direction_on_surface(maps[1001][0, 0], surface.jacobian[triangle[i]])
        wanted -= normal[i] * (wanted @ normal[i])
        assert abs(found[i] @ wanted) > (1 - 1e-5) * np.linalg.norm(wanted)


def test_large_maps_are_looked_at_as_they_are(wide: Surface) -> None:
    triangle, uv = inside(wide)
    codes = RNG.integers(0, 256, (2048, 2048)).astype(np.uint8)
    controls = Controls({name: {1001: codes} for name in ("direction", "density", "region_lip")})
    tracemalloc.start()
    fields = PaintedFields(wide, GraphSettings(), controls)
    for method in (fields.turn, fields.bend, fields.spacing, fields.bare):
        method(triangle, uv)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < codes.nbytes / 4


def test_nearly_black_and_white_are_one_direction_and_between_them_there_is_no_other(
    wide: Surface,
) -> None:
    maps = {1001: np.array([[1e-4, 1.0]], np.float32), 1002: np.array([[0.95, 0.05]], np.float32)}
    triangle, uv = inside(wide)
    turn = PaintedFields(wide, GraphSettings(), Controls({"direction": maps})).turn(triangle, uv)
    across = np.abs(np.sin(turn))
    assert across[uv[:, 0] < 1].max() < 1e-3
    # 9° in UV, whose u is twice as long as the sheet.
    assert across[uv[:, 0] > 1].max() < 1.001 * np.sin(np.arctan(2 * np.tan(np.radians(9))))


def test_black_leaves_the_preferred_lines_and_fades_into_them(wide: Surface) -> None:
    triangle, uv = inside(wide)
    maps = {1001: np.array([[0.0, 0.25]], np.float32)}
    fields = PaintedFields(wide, GraphSettings(region="lip"), Controls({"direction": maps}))
    sure = reference.grey_at(maps, uv, 0.0) * 4
    # 45° in UV is atan(2) on this sheet; the lip has its lines upright.
    both = sure * np.exp(2j * np.arctan(2)) + (1 - sure) * np.exp(1j * np.pi)
    off = fields.turn(triangle, uv) - np.angle(both) / 2
    assert np.abs(np.sin(off)).max() < 1e-5
    assert (fields.turn(triangle, uv)[sure == 0] == np.float32(np.pi / 2)).all()
    np.testing.assert_allclose(fields.bend(triangle, uv), 0.2 + 0.1 * sure, atol=1e-6)
    assert 0 < np.mean(sure == 0) < 1


def test_a_turn_goes_on_top_of_a_direction(wide: Surface) -> None:
    triangle, uv = inside(wide)
    maps = {"direction": {1001: np.ones((1, 1), np.float32)}, "turn": {1001: noise(4, 4)}}
    found = PaintedFields(wide, GraphSettings(turn=30.0), Controls(maps)).turn(triangle, uv)
    grey = at(maps["turn"], uv)
    wanted = np.pi / 6 + np.pi / 2 * np.array([reference.signed(g) for g in grey])
    # Direction 0 is +u, which on this sheet is level already.
    assert np.abs(np.sin(found - wanted)).max() < 1e-5


def test_nothing_set_is_even_skin(wide: Surface) -> None:
    assert type(fields_of(wide, GraphSettings(wrinkles=7000, density=2.0), None)) is Fields


def test_mid_grey_changes_nothing(wide: Surface) -> None:
    triangle, uv = inside(wide)
    for code, most in ((127, 255), (128, 255), (32767, 65535), (32768, 65535)):
        grey = np.full((3, 3), np.float32(code) / np.float32(most), np.float32)
        names = ("density", "strength", "turn", "anisotropy", "scale", "pore_radius")
        maps = {name: {1001: grey, 1002: grey} for name in names}
        fields = PaintedFields(wide, GraphSettings(), Controls(maps))
        for name in ("spacing", "strength", "turn", "anisotropy", "width", "pore_radius", "bend"):
            found, even = (getattr(f, name)(triangle, uv) for f in (fields, Fields()))
            assert (found == even).all(), (name, code)
        assert fields.least_spacing == fields.most_spacing == 1.0
        assert not fields.some_bare


def test_the_reference_meets_the_ends() -> None:
    assert [reference.density(g) for g in (0, 0.5, 1)] == [0, 1, 4]
    assert [round(reference.sized(g), 9) for g in (0, 0.5, 1)] == [0.25, 1, 4]
    assert bilinear(np.array([[0.0, 1.0]]), [[0.5, 0.5]])[0] == 0.5
