"""`--patch`: the preview looks where it is told to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import main, preview
from rhytid.cli.preview import touched_squares
from rhytid.cli.preview_spots import spot_at
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError
from rhytid.pictures.surface_patch import Frame, surface_patch
from rhytid_lab.samples.sphere import sphere

# A sheet of two squares beside one another, the second of them in UDIM 1012; x = 4u - 2 there.
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 1], [0, 2, 1], [4, 0, 0], [4, 2, 1]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]], np.int32)
UV = np.array([[0, 0], [0.5, 0], [0.5, 0.5], [0, 0.5], [1, 1], [1.5, 1], [1.5, 1.5], [1, 1.5]])
FACE_UV = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)


def sheet(offset: float = 0.0) -> Mesh:
    return Mesh.centred(CORNERS.astype(np.float64) + offset, FACES, UV, FACE_UV)


def at(mesh: Mesh, spots: Any) -> NDArray[np.float64]:
    """Where the only spot lies, as the file has it."""
    (spot,) = spots.spots
    return np.asarray(spot.frame.origin + mesh.centre)


@pytest.mark.parametrize("offset", [0.0, 1e6 + 0.3])
@pytest.mark.parametrize(
    ("place", "udim", "x", "y"), [((0.1, 0.2), 1001, 0.4, 0.8), ((1.25, 1.1), 1012, 3.0, 0.4)]
)
def test_a_place_in_uv(
    offset: float, place: tuple[float, float], udim: int, x: float, y: float
) -> None:
    mesh = sheet(offset)
    found = spot_at(mesh, place, 3.0)
    assert (found.udim, found.side) == (udim, 3.0)
    np.testing.assert_allclose(at(mesh, found) - offset, [x, y, y / 2], atol=1e-6)
    np.testing.assert_allclose(found.spots[0].uv, np.array(place) % 1.0, atol=1e-9)
    normal = np.array([0.0, -1.0, 2.0]) / np.sqrt(5)
    np.testing.assert_allclose(found.spots[0].frame.axes[2], normal, atol=1e-6)
    assert found.spots[0].scale == pytest.approx((0.25 / (4 * np.sqrt(1.25))) ** 0.5)


@pytest.mark.parametrize("offset", [0.0, 1e6 + 0.3])
def test_a_point_lands_on_the_surface(offset: float) -> None:
    mesh = sheet(offset)
    above = np.array([3.0, 0.4, 0.2]) + 0.05 * np.array([0.0, -1.0, 2.0]) + offset
    found = spot_at(mesh, above.tolist(), 1.0)
    assert found.udim == 1012
    np.testing.assert_allclose(at(mesh, found) - offset, [3.0, 0.4, 0.2], atol=1e-6)
    np.testing.assert_allclose(found.spots[0].uv, [0.25, 0.1], atol=1e-6)


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ((0.7, 0.2), r"--patch 0.7 0.2: no triangle of the mesh is there in UV"),
        ((3.0, 0.4, 2.0), r"--patch 3 0.4 2: it is 1.6\d+ mesh units away from the mesh, 4 across"),
        ((float("nan"), 0.4, 2.0), "--patch nan 0.4 2: not a place"),
        ((float("nan"), 0.4), "--patch nan 0.4: not a place"),
    ],
)
def test_no_skin_is_told(place: tuple[float, ...], told: str) -> None:
    with pytest.raises(InputError, match=told):
        spot_at(Mesh(CORNERS, FACES, UV, FACE_UV), place, 1.0)


def test_the_border_of_a_chart_is_of_its_udim() -> None:
    square = UV[:4] * 2
    mesh = Mesh(CORNERS[:4], FACES[:2], square, FACES[:2])
    found = spot_at(mesh, (1.0, 0.5), 1.0)
    assert found.udim == 1001
    assert found.spots[0].uv.tolist() == [1.0, 0.5]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--patch", "0.5", "0.5"], "--patch needs --preview"),
        (["--preview", "{out}.png", "--patch", "0.5"], "--patch has 1 number: U V or X Y Z"),
        (["--preview", "{out}.png", "--patch", "7", "7"], "no triangle"),
    ],
)
def test_mistakes_are_told_before_work(
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    told: str,
) -> None:
    mesh = write_neutral(tmp_path / "mesh.npz", small_mesh)
    out = tmp_path / "g.safetensors"
    given = [option.format(out=out) for option in options]
    assert main(["synthesize", str(mesh), "--out", str(out), "--wrinkles", "300", *given]) == 1
    assert told in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_the_picture_shows_the_place(tmp_path: Path, small_mesh: SmallMesh) -> None:
    mesh = str(write_neutral(tmp_path / "mesh.npz", small_mesh))
    graph = str(tmp_path / "g.safetensors")
    base = ["synthesize", mesh, "--out", graph, "--wrinkles", "300", "-q", "--unit", "dm"]
    assert main([*base, "--preview", str(tmp_path / "0.png")]) == 0
    for number, place in enumerate((["0.27", "0.5"], ["0.73", "0.5"]), 1):
        picture = ["--preview", str(tmp_path / f"{number}.png"), "--patch", *place]
        assert main(["graph", mesh, graph, "-q", *picture]) == 0
    pictures = {(tmp_path / f"{number}.png").read_bytes() for number in range(3)}
    assert len(pictures) == 3


@pytest.mark.slow
def test_whole_maps_are_drawn_coarsely_and_progress_moves(
    tmp_path: Path, small_mesh: SmallMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    resident, drawn = preview.resident, list[int]()
    shares: list[float] = []
    begun: list[int] = []

    def recorded(*given: Any) -> Any:
        drawn.append(given[3].resolution)
        begun.append(len(shares))
        return resident(*given)

    @contextmanager
    def bar(_: str) -> Iterator[Callable[[float, str], None]]:
        yield lambda share, _: shares.append(share)

    monkeypatch.setattr(preview, "resident", recorded)
    monkeypatch.setattr(preview, "share_bar", bar)
    monkeypatch.setattr(preview, "resolution_for", lambda *_: 4096)
    mesh = str(write_neutral(tmp_path / "mesh.npz", small_mesh))
    base = ["synthesize", mesh, "--out", str(tmp_path / "g.safetensors"), "--wrinkles", "300"]
    picture = ["--preview", str(tmp_path / "p.png"), "--patch", "0.27", "0.5"]
    assert main([*base, "-q", "--unit", "dm", *picture]) == 0
    assert drawn == [2048, 4096]
    wholes, patches = shares[begun[0] : begun[1]], shares[begun[1] :]
    # The last of whole maps says that patches are uploaded.
    assert wholes[-1] == min(patches) == 0.5 > max(wholes[:-1])
    assert shares == sorted(shares)
    assert len(set(patches)) > 2


def test_a_patch_reads_no_texel_that_is_not_drawn() -> None:
    mesh = sphere(24)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    whole = np.random.default_rng(3).normal(size=(256, 256))
    for t in np.argsort(-corners.mean(axis=1)[:, 2])[:200:10]:
        surface = surface_patch(corners, mesh.triangle_uv(), Frame.of(corners[t]), 0.3, 64)
        drawn = np.full_like(whole, np.nan)
        squares = touched_squares([surface], 256, 4)
        assert 1 < len(squares) < 100
        for row, column in squares:
            drawn[row : row + 4, column : column + 4] = whole[row : row + 4, column : column + 4]
        np.testing.assert_array_equal(surface.heights(drawn), surface.heights(whole))
        np.testing.assert_array_equal(surface.gradient(drawn), surface.gradient(whole))
