"""Tiles of a frame before all of its wrinkles and pores have answered to it: the bits of the map,
in any order."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import BINNED, REDRAW, built, running
from engine.test_engine_grain import asset_of
from meshes import deform
from pipeline.scenes import random_graph, settings_of, sheet
from pipeline.stiff_scenes import painted
from pipeline.test_stage_folding import pressed
from rhytid.device.runtime import Device
from rhytid.domain.events import MOST_KIND
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.engine.device_assets import frames
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.engine import Engine
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.errors import DeviceError
from rhytid.pipeline.work import Place

LINES, COPIES, TILE = 600, 20, 64
# More than have memory for r of lines at a time; the last has folds.
FRAMES = [Frame.of(deform(sheet().positions, seed, 0.15)) for seed in range(3, 8)]
FRAMES.append(Frame.of(pressed(sheet())))
ADDRESSES = [TileAddress(1001, 0, row, column) for row in range(4) for column in range(4)]
BEST = {"preset": "best", "unit": "1.5cm", "bins": {"r_max": 0.15}}
CHOICES = {"best": BEST, "paper": {"shape": {"cushion": 0.7}, "bins": {"r_max": 0.15}}}
CHOICES["flat"] = {"shape": {"cushion": 0.0}, "bins": {"r_max": 0.15}}


def orderly(span: float = 1.0) -> WrinkleGraph:
    """Short lines, those that follow one another side by side, which continue others at random that
    are not far in that order; some of the last are copies of the first. Some nodes are events."""
    graph = random_graph(5, LINES, (0.003, 0.008), (0.01, 0.05), span)
    across, up = (4 * graph.node_uv[:LINES] / span).T
    order = np.lexsort((across % 1, up.astype(int), across.astype(int)))
    random, pores = np.random.default_rng(6), np.concatenate([order, order + LINES])
    near = np.arange(LINES)[:, None] + random.integers(-40, 40, (LINES, 2))
    copy_of = np.full(LINES, ORIGINAL, np.int32)
    copy_of[-COPIES:] = np.arange(COPIES)
    kind = np.zeros(len(pores), np.int32)
    kind[::20] = random.integers(1, MOST_KIND + 1, len(kind[::20]))
    return replace(
        graph,
        node_uv=graph.node_uv[pores],
        edge_weight=np.maximum(graph.edge_weight, 0.3),
        edge_slopes=random.uniform(-0.3, 0.3, (LINES, 2)).astype(np.float32),
        edge_end_half_widths=np.repeat(graph.edge_half_width[:, None], 2, 1),
        edge_end_weights=random.uniform(0.3, 1.0, (LINES, 2)).astype(np.float32),
        edge_partners=np.where((near >= 0) & (near < LINES), near, -1).astype(np.int32),
        edge_share=random.uniform(0.5, 2.0, LINES).astype(np.float32),
        edge_copy_of=copy_of,
        node_kind=kind,
    )


def tile_of(asset: DeviceAsset, frame: Frame, query: MapQuery, at: TileAddress) -> bytes:
    return asset.finest.tiles(frame, query, [at])[0].tobytes()


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any number of squares is few."""
    monkeypatch.setattr(frames, "_SQUARE", 1)


@pytest.fixture(scope="module", params=list(CHOICES))
def choice(request: pytest.FixtureRequest) -> dict[str, Any]:
    found: dict[str, Any] = CHOICES[request.param]
    return found


@pytest.fixture(scope="module")
def wanted(device: Device, choice: dict[str, Any]) -> dict[tuple[int, str], np.ndarray[Any, Any]]:
    """Maps of one tile, whose elements answer all at once."""
    asset = asset_of(device, lines=orderly(), tile_size=256, **choice)
    at = TileAddress(1001, 0, 0, 0)
    found = {
        (n, query.method): asset.finest.tiles(frame, query, [at])[0]
        for n, frame in enumerate(FRAMES)
        for query in (REDRAW, BINNED)
    }
    asset.release()
    return found


@pytest.mark.usefixtures("unknown")
@pytest.mark.parametrize("query", [REDRAW, BINNED], ids=["redraw", "binned"])
def test_tiles_in_any_order_are_those_of_the_map(device, choice, wanted, query):
    asset = asset_of(device, lines=orderly(), tile_size=TILE, **choice)
    random = np.random.default_rng(7)
    order = [(n, at) for at in ADDRESSES for n in range(len(FRAMES))]
    for n, at in [order[i] for i in random.permutation(len(order))]:
        rows, columns = (slice(TILE * i, TILE * i + TILE) for i in (at.row, at.column))
        crop = wanted[n, query.method][rows, columns]
        assert tile_of(asset, FRAMES[n], query, at) == crop.tobytes()
    asset.release()


@pytest.mark.usefixtures("unknown")
@pytest.mark.parametrize("query", [REDRAW, BINNED], ids=["redraw", "binned"])
def test_a_tile_is_the_same_again_after_others(device, query):
    """Of lines that no one else continues, and whose number is no multiple of sixteen: the last of
    them share a group with the none behind them, which every tile needs."""
    lines = replace(orderly(), edge_copy_of=None, edge_partners=np.full((LINES, 2), -1, np.int32))
    asset = asset_of(device, lines=lines, tile_size=TILE, **BEST)
    first = [tile_of(asset, FRAMES[0], query, at) for at in ADDRESSES]
    tile_of(asset, FRAMES[1], query, ADDRESSES[0])  # no tile of the frame before is kept
    assert [tile_of(asset, FRAMES[0], query, at) for at in ADDRESSES] == first
    asset.release()


@pytest.mark.usefixtures("unknown")
def test_elements_that_are_far_from_a_tile_have_not_answered(device):
    asset = asset_of(device, lines=orderly(), tile_size=TILE, **BEST)
    at, elements = ADDRESSES[5], asset.mesh.elements[1001]
    square = asset.mesh.square(at)
    scales = asset.frames.scales(FRAMES[0], REDRAW, 1001, square)
    counts = (4 * elements.wrinkles, 2 * elements.pores)
    for buffer, count in zip((scales.wrinkles, scales.pores), counts, strict=True):
        assert 0.05 < np.isfinite(device.read(buffer, (count,), np.float32)).mean() < 0.7
    tile = at, asset.bins.tile(at)
    factors = asset.frames.coefficients(FRAMES[0], "tensor", tile).own
    assert 0.05 < np.isfinite(device.read(factors, (factors.nbytes // 4,), np.float32)).mean() < 0.7
    asset.frames.coefficients(FRAMES[0], "tensor")
    assert np.isfinite(device.read(factors, (factors.nbytes // 4,), np.float32)).all()
    asset.frames.scales(FRAMES[0], REDRAW, 1001)
    for buffer, count in zip((scales.wrinkles, scales.pores), counts, strict=True):
        assert np.isfinite(device.read(buffer, (count,), np.float32)).all()
    asset.release()


@pytest.mark.usefixtures("unknown")
@pytest.mark.parametrize("stiffness", [None, painted()], ids=["even", "stiff"])
def test_lines_that_own_samples_of_a_tile_answer_as_among_all_lines(device, stiffness):
    """Copies and lines that continue others among them, whatever frame was asked for before."""
    asset = asset_of(device, lines=orderly(), tile_size=TILE, stiffness=stiffness, **BEST)
    lines, counts = asset.mesh.elements[1001].wrinkles, set()
    for frame, at in zip(FRAMES * 3, ADDRESSES, strict=False):
        tile = asset.bins.tile(at).cushion
        own = asset.frames.owner_lines(frame, BINNED, at, tile)
        every = asset.frames.line_stretches(frame, BINNED, 1001)
        wanted = device.read(every, (lines + 1, 2), np.float32)[tile.read_owners(device)]
        ends = device.read(own.ends, (own.count + 1, 2), np.float32)
        numbers = device.read(own.owners, (tile.side, tile.side), np.int32)
        numbers = np.where(numbers < 0, ~numbers, numbers)  # clear
        assert ends[numbers].tobytes() == wanted.tobytes()
        assert not ends[-1].any()
        counts.add(own.count)
    assert 0 < max(counts) < lines / 4
    asset.release()


@pytest.mark.usefixtures("unknown")
def test_of_triangles_that_no_element_of_a_tile_answers_to_nothing_is_found(device):
    asset = asset_of(device, lines=orderly(), tile_size=TILE, **BEST)
    frame, squares = FRAMES[-1], [asset.mesh.square(at) for at in ADDRESSES[4:6]]
    shares = []
    for square in (*squares, None):
        alone = None if square is None else Place(1001, square)
        stretch = asset.frames.stretch(frame, "tensor", alone)
        buffers = (stretch.logs, stretch.taken, stretch.axes)
        found = [device.read(b, (b.nbytes // 4,), np.float32) for b in buffers]
        shares.append([np.isfinite(values).mean() for values in found])
    assert all(0.1 < share < 0.9 for share in shares[0])
    assert all(one < other < 1.0 for one, other in zip(*shares[:2], strict=True))
    assert shares[2] == [1.0] * 3
    assert asset.frames.measured(frame).folds.max() > 0.1
    asset.release()


@pytest.mark.usefixtures("unknown")
def test_a_tile_of_the_fast_method_needs_the_stretch_of_fewer_triangles(device, choice):
    asset = asset_of(device, sheet(80), orderly(), tile_size=TILE, **choice)
    frame, at = Frame.of(deform(sheet(80).positions, 3, 0.15)), ADDRESSES[5]
    counts = []
    for query in (BINNED, REDRAW):
        tile_of(asset, frame, query, at)
        place = Place(1001, asset.mesh.square(at), query is BINNED)
        logs = asset.frames.stretch(frame, "tensor", place).logs
        counts.append(int(np.isfinite(device.read(logs, (logs.nbytes // 4,), np.float32)).sum()))
    assert 2 * len(sheet(80).faces) / len(ADDRESSES) <= counts[0] < 0.9 * counts[1]
    asset.release()


@pytest.mark.usefixtures("unknown")
def test_elements_may_sample_any_triangle(device, choice):
    """Where the texels of a tile were not located before, too."""
    mesh, random = sheet(40), np.random.default_rng(9)
    lines, faces = orderly(), len(mesh.faces)
    lines = replace(
        lines,
        node_triangle=random.integers(0, faces, len(lines.node_uv), np.int32),
        edge_triangle=random.integers(0, faces, LINES, np.int32),
    )
    frame = Frame.of(deform(mesh.positions, 3, 0.15))
    whole, tiled = (asset_of(device, mesh, lines, tile_size=side, **choice) for side in (256, TILE))
    methods, first = (REDRAW, BINNED), [TileAddress(1001, 0, 0, 0)]
    wanted = {query: whole.finest.tiles(frame, query, first)[0] for query in methods}
    for at in ADDRESSES[3:15:4]:
        rows, columns = (slice(TILE * i, TILE * i + TILE) for i in (at.row, at.column))
        for query in methods:
            tile = wanted[query][rows, columns]
            assert tile_of(tiled, frame, query, at) == tile.tobytes()
        tiled.mesh.cache.clear()  # no tile has the stretch of another
    for asset in (whole, tiled):
        asset.release()


@pytest.mark.usefixtures("unknown")
def test_of_a_frame_of_which_many_tiles_are_asked_for_all_answers_at_once(device, monkeypatch):
    monkeypatch.setattr(frames, "_SQUARE", LINES // 2)  # two squares are few
    asset = asset_of(device, lines=orderly(), tile_size=TILE, **BEST)

    def complete(frame, addresses):
        """Whether lines, scales and factors of all are there after each of some tiles."""
        for at in addresses:
            square, tile = asset.mesh.square(at), (at, asset.bins.tile(at))
            buffers = (
                asset.frames.scales(frame, REDRAW, 1001, square).pores,
                asset.frames.coefficients(frame, "tensor", tile).own,
            )
            found = [device.read(b, (b.nbytes // 4,), np.float32) for b in buffers]
            found = [np.isfinite(values).all() for values in found]
            own = asset.frames.owner_lines(frame, BINNED, at, tile[1].cushion)
            found.append(own is None)
            assert len(set(found)) == 1
            yield found[0]

    shown = [
        list(complete(frame, ADDRESSES[::step][:count]))
        for frame, step, count in zip(FRAMES, (5, 5, 5, 5, 5), (2, 3, 1, 1, 2), strict=False)
    ]
    assert shown == [[False] * 2, [False, False, True], [True], [False], [False] * 2]
    asset.release()


@pytest.mark.usefixtures("unknown")
def test_a_client_on_another_frame_changes_nothing_of_that(device, monkeypatch):
    monkeypatch.setattr(frames, "_SQUARE", LINES // 2)  # two squares are few
    asset = asset_of(device, lines=orderly(), tile_size=TILE, **BEST)
    squares = [asset.mesh.square(at) for at in ADDRESSES]
    shown = []
    for square in squares[1:5]:
        asset.frames.scales(FRAMES[0], REDRAW, 1001, squares[0])
        pores = asset.frames.scales(FRAMES[1], REDRAW, 1001, square).pores
        found = device.read(pores, (pores.nbytes // 4,), np.float32)
        shown.append(bool(np.isfinite(found).all()))
    assert shown == [False, False, True, True]
    asset.release()


def test_where_a_kernel_fails_nothing_counts_as_found(device, monkeypatch):
    asset = asset_of(device, lines=orderly(), tile_size=TILE, **BEST)
    squares = [asset.mesh.square(at) for at in ADDRESSES[:2]]
    found = asset.frames.scales(FRAMES[0], REDRAW, 1001, squares[0])
    assert found.filled == {Place(1001, squares[0])}

    def fail(*given: Any) -> None:
        raise DeviceError("no more")

    with monkeypatch.context() as patch:
        patch.setattr(frames, "respond_nearby", fail)
        with pytest.raises(DeviceError):
            asset.frames.scales(FRAMES[0], REDRAW, 1001, squares[1])
    assert found.filled == set()
    asset.frames.scales(FRAMES[0], REDRAW, 1001, squares[1])
    assert found.filled == {Place(1001, squares[1])}
    asset.release()


@pytest.mark.usefixtures("unknown")
@pytest.mark.parametrize("query", [REDRAW, BINNED], ids=["redraw", "binned"])
def test_a_tile_is_the_same_again_where_its_stretch_was_dropped(device, query):
    """As where memory is short, or where its kernels fail half-way; what follows from it stays."""
    copy_of = np.full(2 * LINES, ORIGINAL, np.int32)
    copy_of[-10 * COPIES :] = np.arange(10 * COPIES)
    lines = replace(orderly(), node_copy_of=copy_of)
    asset = asset_of(device, lines=lines, tile_size=TILE, **BEST)
    first = tile_of(asset, FRAMES[-1], query, ADDRESSES[5])
    for at in (*ADDRESSES[:5], *ADDRESSES[6:]):
        asset.mesh.cache.discard("stretch", "tensor", FRAMES[-1].digest)
        tile_of(asset, FRAMES[-1], query, at)
        tile_of(asset, FRAMES[0], query, at)  # no tile of the frame is kept
        assert tile_of(asset, FRAMES[-1], query, ADDRESSES[5]) == first
        tile_of(asset, FRAMES[0], query, at)
    asset.release()


@pytest.fixture
def engines(tmp_path: Path) -> Iterator[tuple[Engine, Engine]]:
    with running(tmp_path / "one") as one, running(tmp_path / "other") as other:
        yield one, other


@pytest.mark.usefixtures("unknown")
def test_clients_at_once_get_tiles_of_every_udim_and_level(engines: tuple[Engine, Engine]) -> None:
    mesh = sheet(udims=2)
    new = NewAsset(mesh, settings_of(**CHOICES["best"]), orderly(2.0))
    first, second = (built(engine, new) for engine in engines)
    bent = [Frame.of(deform(mesh.positions, seed, 0.15)) for seed in (1, 2)]
    asked = [
        (frame, query, TileAddress(udim, level, row, column))
        for frame in bent
        for query in (REDRAW, BINNED)
        for udim in (1001, 1012)
        for level in (0, 1)
        for row in range(4 >> level)
        for column in range(4 >> level)
    ]
    wanted = {
        (frame.digest, query, udim, level): engines[0]
        .tiles.draw(first, frame, query, MapAddress(udim, level))
        .tile
        for frame in bent
        for query in (REDRAW, BINNED)
        for udim in (1001, 1012)
        for level in (0, 1)
    }
    order = np.random.default_rng(8).permutation(len(asked))
    with ThreadPoolExecutor(8) as pool:
        found = pool.map(lambda i: engines[1].tiles.draw(second, *asked[i]).tile, order)
        for i, tile in zip(order, found, strict=True):
            frame, query, at = asked[i]
            rows, columns = (slice(TILE * n, TILE * n + TILE) for n in (at.row, at.column))
            whole = wanted[frame.digest, query, at.udim, at.level]
            assert tile.tobytes() == whole[rows, columns].tobytes()
