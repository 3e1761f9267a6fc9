"""What settings and painted maps do to the skin that grows: measured on graphs."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import REGIONS
from rhytid.errors import InputError, LimitError, MeshError
from rhytid.synthesis.capacity import check_amount
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.painted import Half, halves, painted, right

COUNT = 8000
MESH = sheets.sheet()
MEMORY = 1 << 32


def grown(device: Device, controls: Controls | None = None, **settings: object) -> WrinkleGraph:
    even = {"wrinkles": COUNT, "patches": 0.0, "events": 0.0}
    chosen = GraphSettings(**{**even, **settings})  # type: ignore[arg-type]
    return synthesize(MESH, chosen, device, controls=controls).graph


@cache
def even(device: Device) -> Half:
    return halves(MESH, grown(device))[1]


def sides(device: Device, **maps: object) -> tuple[Half, Half]:
    return halves(MESH, grown(device, painted(**maps)))  # type: ignore[arg-type]


def test_white_density_halves_the_spacing_there_and_nowhere_else(device: Device) -> None:
    left, there = sides(device, density=right(1.0))
    assert left.spacing == pytest.approx(even(device).spacing, rel=0.01)
    assert there.spacing == pytest.approx(even(device).spacing / 2, rel=0.01)
    assert there.pores == pytest.approx(4 * left.pores, rel=0.02)
    # All that is drawn there is half as large, and half as deep; the rest stays.
    assert left.half_width == pytest.approx(even(device).half_width, rel=0.02)
    assert there.half_width == pytest.approx(even(device).half_width / 2, rel=0.02)
    assert there.weight == pytest.approx(even(device).weight / 2, rel=0.05)


def test_density_makes_for_as_many_wrinkles_more(device: Device) -> None:
    graph = grown(device, painted(density=right(1.0)))
    assert graph.wrinkles == pytest.approx(2.5 * COUNT, rel=0.01)
    assert grown(device, density=0.5).wrinkles == COUNT // 2
    assert grown(device, region="nose").wrinkles == round(COUNT * REGIONS["nose"].density)


def test_black_density_bares(device: Device) -> None:
    graph = grown(device, painted(density=right(0.0)))
    assert graph.node_uv[:, 0].max() < 0.508  # a texel is 1/64, a quarter of mid grey is in it
    # As many as would be between these pores without the map.
    plain = grown(device)
    left = (plain.node_uv[plain.edge_nodes, 0] < graph.node_uv[:, 0].max()).all(axis=1)
    assert graph.wrinkles == pytest.approx(np.count_nonzero(left), rel=0.01)
    assert graph.edge_weight.min() > 0


@pytest.mark.slow
def test_a_mask_finer_than_triangles_keeps_its_shape(device: Device) -> None:
    coarse = sheets.sheet(n=1)
    disc = np.hypot(*(np.indices((256, 256)) - 127.5)) < 40
    grey = np.where(disc, 1.0, 0.0).astype(np.float32)
    settings = GraphSettings(wrinkles=COUNT, patches=0.0, events=0.0)
    graph = synthesize(coarse, settings, device, controls=painted(density=grey)).graph
    off = np.hypot(*((graph.node_uv - 0.5) * 256).T)
    assert 38 < off.max() < 41
    # Density 4 on the share of the square that the disc has; even in there.
    share = np.pi * (40 / 256 / 0.8) ** 2
    assert graph.wrinkles == pytest.approx(4 * share * COUNT, rel=0.05)
    assert np.mean(off < 20) == pytest.approx(0.25, abs=0.03)
    # As far apart as in a whole sheet of density 4.
    at = graph.node_uv / 0.8
    whole = grown(device, density=4.0).node_uv / 0.8
    gaps = [np.sort(np.hypot(*(p[:, None] - p[None]).transpose(2, 0, 1)), 1)[:, 1] for p in
            (at, whole[np.hypot(*(whole - 0.625).T) < 0.2])]  # fmt: skip
    assert gaps[0].mean() == pytest.approx(gaps[1].mean(), rel=0.03)


@pytest.mark.parametrize(("grey", "factor"), [(1.0, 2.0), (0.25, 0.5)])
def test_strength_scales_weights_there(device: Device, grey: float, factor: float) -> None:
    left, there = sides(device, strength=right(grey))
    assert there.weight == pytest.approx(factor * even(device).weight, rel=0.05)
    assert left.weight == pytest.approx(even(device).weight, rel=0.02)


def test_black_strength_leaves_nothing_to_see(device: Device) -> None:
    graph = grown(device, painted(strength=right(0.0)))
    there = graph.node_uv[graph.edge_nodes, 0].min(axis=1) > 0.52
    assert there.sum() > COUNT / 3
    assert graph.edge_weight[there].max() <= 1e-4
    assert graph.node_weight[graph.node_uv[:, 0] > 0.52].max() <= 1e-4


def test_scale_and_pore_radius_size_what_is_drawn(device: Device) -> None:
    wide, large = sides(device, scale=right(1.0)), sides(device, pore_radius=right(0.0))
    assert wide[1].half_width == pytest.approx(4 * even(device).half_width, rel=0.02)
    assert wide[0].half_width == pytest.approx(even(device).half_width, rel=0.02)
    assert large[1].radius == pytest.approx(even(device).radius / 4, rel=0.02)


@pytest.mark.parametrize("degrees", [0, 45, 90, 135])
def test_wrinkles_turn_to_the_painted_direction(device: Device, degrees: int) -> None:
    left, there = sides(device, direction=right((degrees or 180) / 180, 90 / 180))
    for half, wanted in ((left, 90), (there, degrees)):
        off = (half.axis - wanted + 90) % 180 - 90
        assert abs(off) < 12, (half.axis, wanted)
        assert abs(half.order) > 0.4


def test_turn_turns_and_anisotropy_gathers(device: Device) -> None:
    loose, one = sides(device, anisotropy=right(1.0, 0.0))
    assert abs(loose.order) < 0.1
    assert abs(even(device).order) < 0.3
    assert abs(one.order) > 0.4
    turned = halves(MESH, grown(device, turn=90.0, anisotropy=2.0))[1]
    assert 70 < (turned.axis - one.axis) % 180 < 110


def test_regions_differ(device: Device) -> None:
    """Their nets: creases of a lip, which rank 0 leaves out, have pores of their own."""
    found = {name: halves(MESH, grown(device, region=name, rank=0.0))[0] for name in REGIONS}
    sizes = {name: half.radius for name, half in found.items()}
    assert max(sizes, key=sizes.__getitem__) == "nose"
    assert sizes["cheek"] > 1.2 * sizes["face"] > 1.8 * sizes["eye_corner"] > sizes["lip"]
    weights = {name: half.weight for name, half in found.items()}
    assert max(weights, key=weights.__getitem__) == "lip"
    assert weights["forehead"] > weights["face"] > weights["cheek"]
    assert weights["nose"] < 0.5 * weights["face"]
    ordered = {name: abs(half.order) for name, half in found.items()}
    assert ordered["nose"] < ordered["cheek"] < ordered["face"] < ordered["forehead"]
    assert min(ordered["lip"], ordered["eye_corner"]) > 0.35
    assert abs((found["lip"].axis - found["eye_corner"].axis) % 180 - 90) < 25
    spacing = {name: half.spacing for name, half in found.items()}
    for name, region in REGIONS.items():
        wanted = spacing["face"] * region.density**-0.5
        assert spacing[name] == pytest.approx(wanted, rel=0.02)


def test_a_mask_is_the_region_where_it_is_white(device: Device) -> None:
    left, there = sides(device, region_cheek=right(1.0, 0.0))
    cheek = halves(MESH, grown(device, region="cheek"))[1]
    for name in ("spacing", "weight", "half_width", "radius"):
        assert getattr(there, name) == pytest.approx(getattr(cheek, name), rel=0.04)
        assert getattr(left, name) == pytest.approx(getattr(halves(MESH, grown(device))[0], name),
                                                    rel=0.04)  # fmt: skip


def test_the_same_maps_give_the_same_bits(device: Device) -> None:
    noise = np.random.default_rng(5).uniform(0.3, 1, (2, 16, 16)).astype(np.float32)
    maps = painted(density=noise[0], direction=noise[1], region_lip=noise[1])
    one, two = (grown(device, maps).arrays() for _ in range(2))
    assert all(one[name].tobytes() == two[name].tobytes() for name in one)
    plain, grey = grown(device), grown(device, painted(density=np.full((3, 3), 0.5, np.float32)))
    pairs = zip(plain.arrays().values(), grey.arrays().values(), strict=True)
    assert all(a.tobytes() == b.tobytes() for a, b in pairs)


def test_an_empty_mask_is_refused(device: Device) -> None:
    empty = painted(density=np.zeros((4, 4), np.float32))
    for ask in (
        lambda: grown(device, empty),
        lambda: check_amount(MESH, GraphSettings(wrinkles=COUNT), empty, MEMORY),
    ):
        with pytest.raises(InputError, match="density: the map leaves no room for pores"):
            ask()


def test_too_small_a_rest_is_refused_with_what_would_do() -> None:
    speck = np.zeros((40, 40), np.float32)
    speck[20, 20] = 0.5
    with pytest.raises(InputError, match=r"graph\.wrinkles of (\d+) or more") as told:
        check_amount(MESH, GraphSettings(wrinkles=1000), painted(density=speck), MEMORY)
    enough = int(str(told.value).split("graph.wrinkles of ")[1].split()[0])
    check_amount(MESH, GraphSettings(wrinkles=enough), painted(density=speck), MEMORY)
    with pytest.raises(InputError, match="or more"):
        check_amount(
            MESH, GraphSettings(wrinkles=int(0.99 * enough)), painted(density=speck), MEMORY
        )


@pytest.mark.parametrize(("grey", "density"), [(None, 1.0), (None, 3.0), (1.0, 2.0)])
def test_more_than_memory_is_refused_with_what_fits(grey: float | None, density: float) -> None:
    controls = None if grey is None else painted(density=right(grey))
    memory = 200_000_000

    def ask(wrinkles: int) -> None:
        check_amount(MESH, GraphSettings(wrinkles=wrinkles, density=density), controls, memory)

    with pytest.raises(LimitError, match="200000000 bytes of device memory can hold") as told:
        ask(30_000_000)
    fit = int(str(told.value).rsplit(" ", 1)[1])
    assert 100_000 < fit < 2_000_000
    ask(fit)
    with pytest.raises(LimitError):
        ask(fit + 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mesh", "side", "wrinkles"), [(sheets.sheet(n=1), 12, 200_000), (sheets.sheet(n=300), 0, 1000)]
)
def test_no_more_memory_is_taken_than_was_asked_for(
    device: Device, monkeypatch: pytest.MonkeyPatch, mesh: Mesh, side: int, wrinkles: int
) -> None:
    """A speck on a mesh of two triangles, and a mesh of very many."""
    speck = np.full((256, 256), 0.0 if side else 0.5, np.float32)
    speck[100 : 100 + side, 100 : 100 + side] = 1.0
    settings, taken = GraphSettings(wrinkles=wrinkles), [0]
    reserve, before = device.budget.reserve, device.budget.used

    def counted(nbytes: int, *, reuse: bool = False) -> Any | None:
        spare = reserve(nbytes, reuse=reuse)
        taken.append(device.budget.used - before)
        return spare

    monkeypatch.setattr(device.budget, "reserve", counted)
    synthesize(mesh, settings, device, controls=painted(density=speck))
    with pytest.raises(LimitError, match="can hold"):
        check_amount(mesh, settings, painted(density=speck), max(taken) - 1)


def test_the_density_of_a_region_counts_before_work_too() -> None:
    few = GraphSettings(wrinkles=120, region="mouth")
    with pytest.raises(InputError, match=r"60 in all: .* graph.wrinkles of 200 or more"):
        check_amount(MESH, few, None, MEMORY)


def test_more_than_a_graph_holds_is_refused() -> None:
    with pytest.raises(LimitError, match=r"density 4 on the mean .* 80000000 .* can hold 10000000"):
        check_amount(MESH, GraphSettings(wrinkles=20_000_000, density=4.0), None, 1 << 40)


def test_a_map_too_small_for_float32_is_refused_before_work(device: Device) -> None:
    tiny = sheets.sheet(lambda xy: 9.5 + 1e-3 * xy)
    fit = refused(device, tiny, 100_000, "float32")
    assert synthesize(tiny, GraphSettings(wrinkles=fit), device).graph.wrinkles == fit


def refused(device: Device, mesh: Mesh, wrinkles: int, why: str) -> int:
    """How many would fit, of wrinkles that are refused before any pore is scattered."""
    seen: list[float] = []
    with pytest.raises(MeshError, match=rf"graph\.wrinkles is {wrinkles}: .* {why}") as told:
        synthesize(
            mesh, GraphSettings(wrinkles=wrinkles), device, lambda share, _: seen.append(share)
        )
    assert seen == [0.0]
    return int(str(told.value).rsplit(" ", 1)[1])


def test_parts_too_far_apart_for_the_lattice_are_refused_before_work(device: Device) -> None:
    one, two = (sheets.sheet(lambda xy, by=by: 0.4 * xy + by, n=4) for by in (0.05, 0.55))
    far = two.positions * 2.0 + np.float32([2.0**21, 0, 0])
    both = Mesh(
        np.concatenate([one.positions, far]),
        np.concatenate([one.faces, two.faces + len(far)]),
        np.concatenate([one.uv, two.uv]),
        np.concatenate([one.face_uv, two.face_uv + len(two.uv)]),
    )
    fit = refused(device, both, 20_000, "so far apart that float32")
    assert 100 < fit < 10_000
    made = synthesize(both, GraphSettings(wrinkles=fit, patches=0.0), device)
    at = sheets.places(Surface.of(both), made.graph)
    nearest = cKDTree(at).query(at, k=2)[0][:, 1]
    assert nearest.std() < 0.12 * nearest.mean()
