"""`rhytid controls`: what each control does, and that the usual values do nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.cli.control_samples import samples
from rhytid.cli.control_skins import ControlSkins
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError
from rhytid.pictures.sheet import PATCH

pytestmark = pytest.mark.release

MIDDLE = [0.3, 0.0, 0.0]


@pytest.fixture(scope="module")
def skins(device: object) -> ControlSkins:
    """Of a sheet, 3 by 3 cm, that bulges a little."""
    at = np.linspace(-1.5, 1.5, 31)
    x, y = np.meshgrid(at, at)
    positions = np.stack([x, y, 0.05 * np.cos(x) * np.cos(y)], -1).reshape(-1, 3)
    i = np.arange(31 * 31).reshape(31, 31)
    a, b, c, d = (part.ravel() for part in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh = Mesh(positions, faces, positions[:, :2] / 4 + 0.5, faces)
    return ControlSkins(device, mesh, "cm", MIDDLE)  # type: ignore[arg-type]


def pictures(skins: ControlSkins, name: str) -> list[np.ndarray]:
    return [skins.patch(sample).picture for sample in samples(name, 10.0)]


def contrast(picture: np.ndarray) -> float:
    return float(picture.astype(np.float64).std())


@pytest.mark.slow
def test_a_mask_of_strength_makes_skin_flat_or_rough(skins: ControlSkins) -> None:
    black, usual, white = map(contrast, pictures(skins, "strength"))
    assert black < 0.7 * usual
    assert white > 1.1 * usual


@pytest.mark.slow
def test_the_usual_value_of_anything_is_the_same_skin(skins: ControlSkins) -> None:
    names = ("strength", "turn", "region_lip", "graph.age", "graph.spacing", "depth")
    usual = [
        skins.patch(sample).picture
        for name in (*names, "shape.cushion", "shape.grain")
        for sample in samples(name, 10.0)
        if sample.label.startswith("[")
    ]
    assert len(usual) == 8
    assert usual[0].shape == (PATCH, PATCH, 3)
    assert all((picture == usual[0]).all() for picture in usual)


@pytest.mark.slow
def test_every_other_value_is_another_skin(skins: ControlSkins) -> None:
    for name in ("turn", "region_lip", "graph.age", "shape.cushion", "depth"):
        low, middle, high = pictures(skins, name)
        assert not (low == middle).all(), name
        assert not (middle == high).all(), name


@pytest.mark.slow
def test_pressed_skin_shows_what_answers_to_stretch(skins: ControlSkins) -> None:
    black, grey, white = pictures(skins, "stiffness")
    usual = [s for s in samples("response.alpha_d", 10.0) if s.label.startswith("[")]
    assert (skins.patch(usual[0]).picture == white).all()
    differs = [float(np.abs(p.astype(int) - black).mean()) for p in (grey, white)]
    assert 0 < differs[0] < differs[1]
    deeper = pictures(skins, "response.alpha_d")
    assert contrast(deeper[0]) < contrast(deeper[1]) < contrast(deeper[2])


@pytest.mark.slow
@pytest.mark.parametrize("names", [("depth",), ("cushion", "strength")])
def test_the_picture_has_what_was_asked_for(
    names: tuple[str, ...], tmp_path: Path, small_mesh: SmallMesh
) -> None:
    mesh = write_neutral(tmp_path / "sheet.npz", small_mesh)
    out = tmp_path / "new" / "controls.png"
    given = ["--only", *names, "--patch", "0.27", "0.5", "--unit", "cm", "-q"]
    assert main(["controls", str(mesh), "--out", str(out), *given]) == 0
    with Image.open(out) as picture:
        # A panel of three patches each.
        panels = len(names)
        assert picture.size[0] == 2 * 28 + (panels - 1) * 18 + panels * (3 * PATCH + 8)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--out", "a.jpg"], "a.jpg: the picture is written as .png"),
        (["--out", "a.png", "--patch", "1"], "--patch has 1 numbers: U V or X Y Z"),
        (["--out", "a.png", "--patch", "9", "9"], "no triangle of the mesh is there in UV"),
        (["--out", "a.png", "--unit", "mm"], "no place of the mesh is flat over 10 mm"),
    ],
)
def test_what_cannot_be_drawn_is_told(
    tmp_path: Path,
    small_mesh: SmallMesh,
    given: list[str],
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = write_neutral(tmp_path / "sheet.npz", small_mesh)
    assert main(["controls", str(mesh), *given]) == 1
    assert told in capsys.readouterr().err
    assert not (tmp_path / "a.png").exists()


def test_skin_without_room_is_told(device: object) -> None:
    one = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    mesh = Mesh(one, [[0, 1, 2]], one[:, :2], [[0, 1, 2]])
    with pytest.raises(InputError, match="no place of the mesh is flat over 10 mm"):
        ControlSkins(device, mesh, "mm")  # type: ignore[arg-type]
