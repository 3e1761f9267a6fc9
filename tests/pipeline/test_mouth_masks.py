"""Lips up to their border, and the mouth around them, on a strip of skin from nose to chin."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.mesh import Mesh
from rhytid.pipeline import region_masks
from rhytid.pipeline.diffusion import Diffusion
from rhytid.pipeline.region_masks import RegionMasks, full_share, lip_share, mouth_share

LENGTH = 0.35
# Half the height of both lips, and of the mouth around them, cm; half the width of the mouth.
RED, AROUND, WIDE = 0.9, 2.4, 2.5


def strip(full: float = 0.0, slit: bool = False) -> Mesh:
    """A square of 8 cm in the plane z = 0, whose lips meet at y = 0 and stand out so far, cm.

    slit: whether they part there, each with vertices of its own.
    """
    line = np.linspace(-4.0, 4.0, 81)
    # Closer rows above, so that the lips are not alike.
    x, y = np.meshgrid(line, np.concatenate([line[:40], np.linspace(0.0, 4.0, 61)]))
    red = np.maximum(border(x), 1e-3)
    across = np.clip(np.abs(y) / red, 0.0, 1.0)
    z = full * (red / RED) * 4.0 * across * (1.0 - across)
    positions = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(80), np.arange(100))
    a = (j * 81 + i).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 82], 1), np.stack([a, a + 82, a + 81], 1)])
    if slit:
        torn = np.flatnonzero(
            (np.abs(positions[:, 1]) < 1e-6) & (np.abs(positions[:, 0]) < WIDE - 0.05)
        )
        upper = np.arange(len(positions))
        upper[torn] = len(positions) + np.arange(len(torn))
        above = positions[faces, 1].mean(axis=1) > 0.0
        faces = np.where(above[:, None], upper[faces], faces)
        positions = np.concatenate([positions, positions[torn]])
    return Mesh(positions.astype(np.float32), faces, positions[:, :2] / 10 + 0.5, faces)


def border(x: np.ndarray) -> np.ndarray:
    """Half the height of both lips, which end in corners."""
    return RED * np.sqrt(np.clip(1.0 - (x / WIDE) ** 2, 0.0, 1.0))


MESH = strip()
X, Y = MESH.positions[:, 0].astype(float), MESH.positions[:, 1].astype(float)


def along() -> np.ndarray:
    """How far the lips move along their width: less towards the corners."""
    return np.sqrt(np.clip(1 - (X / 3.2) ** 2, 0, 1))


def roll(side: float) -> np.ndarray:
    """A lip that turns in about its border: three quarters there, less beyond."""
    y = np.abs(Y)
    inside = 1 - 0.25 * y / RED
    beyond = np.maximum(0.75 - 0.6 * (y - RED), 0)
    return np.where(side * Y >= 0, np.where(y < RED, inside, beyond), 0.0) * along()


def pucker() -> np.ndarray:
    """All around the mouth, flat on the red."""
    return np.clip(1.0 - 0.6 * np.maximum(np.abs(Y) - 0.7 * RED, 0), 0, 1)


def pursed(mesh: Mesh) -> np.ndarray:
    """All around a mouth with corners: three quarters at the border and at these."""
    x, y = mesh.positions[:, 0].astype(float), mesh.positions[:, 1].astype(float)
    return np.clip(1.0 - 0.25 * ((x / WIDE) ** 6 + (y / RED) ** 2), 0.0, 1.0)


def masks(anatomy: str, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    found = RegionMasks(MESH, anatomy)
    motions = {
        "mouthRollUpper": roll(1.0),
        "mouthRollLower": roll(-1.0),
        "mouthPucker": pucker(),
        "jawOpen": np.clip(-Y / 3.0, 0, 1),
    }
    no_folds = np.zeros((len(MESH.faces), 3), np.float32)
    for name in names:
        positions = MESH.positions.copy()
        positions[:, 2 if name != "jawOpen" else 1] -= motions[name].astype(np.float32)
        found.add(name, positions, no_folds)
    return found.masks(Diffusion(MESH, LENGTH, np.arange(len(MESH.positions))))


EVERY = ("mouthPucker", "mouthRollUpper", "mouthRollLower", "jawOpen")


def test_the_lip_ends_at_the_border_of_what_rolls_in() -> None:
    lip = lip_share(MESH.positions, [roll(1.0), roll(-1.0)], pucker(), LENGTH)
    for x in (0.0, 1.0, 2.0):
        column = np.abs(X - x) < 0.01
        y = np.abs(Y[column])
        assert (lip[column][y < RED - 0.25] == 1.0).all(), x
        assert (lip[column][y > RED + 0.35] == 0.0).all(), x
        assert RED - 0.1 < y[lip[column] > 0.5].max() < RED + 0.3, x
    assert (lip[np.abs(X) > 3.3] == 0.0).all()


def by_form(mesh: Mesh) -> np.ndarray | None:
    surface = Diffusion(mesh, LENGTH, np.arange(len(mesh.positions)))
    return full_share(mesh, surface, pursed(mesh))


@pytest.mark.parametrize("full", [0.2, 0.4])
@pytest.mark.parametrize("slit", [False, True])
def test_full_lips_end_where_their_form_does(full: float, slit: bool) -> None:
    mesh = strip(full, slit)
    lip = by_form(mesh)
    assert lip is not None
    across, height = mesh.positions[:, 0], mesh.positions[:, 1]
    for x in (0.0, 0.8, -1.5, 2.0):
        column = np.abs(across - x) < 0.01
        y, share = np.abs(height[column]), lip[column]
        ends = border(np.array(x))
        assert (share[y < ends - 0.3] > 0.95).all(), x
        assert (share[y > ends + 0.1] == 0.0).all(), x
        assert ends - 0.3 < y[share > 0.5].max() < ends + 0.05, x
    assert (lip[np.abs(across) > WIDE + 0.2] == 0.0).all()


def test_flat_lips_show_no_border() -> None:
    assert by_form(strip()) is None
    assert by_form(strip(0.02)) is None


def test_fine_masks_follow_the_form_before_what_rolls_in() -> None:
    mesh = strip(0.3)
    found = RegionMasks(mesh)
    no_folds = np.zeros((len(mesh.faces), 3), np.float32)
    # It rolls half of the lip alone, and carries the other.
    for name, motion in (("mouthPucker", pursed(MESH)), ("mouthRollUpper", roll(1.0) * (X > 0))):
        positions = mesh.positions.copy()
        positions[:, 2] -= motion.astype(np.float32)
        found.add(name, positions, no_folds)
    lip = found.masks(Diffusion(mesh, LENGTH, np.arange(len(X))))["lip"]
    left = np.abs(X + 1.0) < 0.01
    assert lip[left & (np.abs(Y) < 0.6 * border(-1.0))].min() > 0.9
    assert lip[left & (np.abs(Y) > 1.2 * border(-1.0))].max() < 0.05


def test_vertices_that_are_one_are_no_gap_in_a_border() -> None:
    mesh = strip(0.3)
    # Torn along x = 0.5, as an exporter does at a seam.
    torn = np.flatnonzero(np.abs(X - 0.5) < 0.01)
    twin = np.arange(len(X), len(X) + len(torn))
    of = np.zeros(len(X), np.intp)
    of[torn] = twin
    right = X[mesh.faces].mean(axis=1) > 0.5
    faces = np.where(right[:, None] & (of[mesh.faces] > 0), of[mesh.faces], mesh.faces)
    uv = np.concatenate([mesh.uv, mesh.uv[torn]])
    split = Mesh(np.concatenate([mesh.positions, mesh.positions[torn]]), faces, uv, faces)
    one = np.concatenate([np.arange(len(X)), torn])
    whole = full_share(mesh, Diffusion(mesh, LENGTH, np.arange(len(X))), pursed(mesh))
    found = full_share(split, Diffusion(split, LENGTH, one), pursed(mesh)[one])
    assert whole is not None
    assert found is not None
    np.testing.assert_allclose(found, whole[one], atol=1e-6)


def test_vertices_are_taken_in_parts_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = lip_share(MESH.positions, [roll(1.0)], pucker(), LENGTH)
    monkeypatch.setattr(region_masks, "_ROWS", 7)
    parts = lip_share(MESH.positions, [roll(1.0)], pucker(), LENGTH)
    np.testing.assert_array_equal(parts, whole)


def test_without_rolls_a_pucker_shows_the_lip() -> None:
    lip = lip_share(MESH.positions, [], pucker(), LENGTH)
    middle = np.abs(X) < 0.01
    assert (lip[middle & (np.abs(Y) < 0.6 * RED)] == 1.0).all()
    assert (lip[middle & (np.abs(Y) > 1.4 * RED)] == 0.0).all()


def test_fine_masks_have_a_sharper_lip_and_a_mouth_around_it() -> None:
    fine, coarse = masks("fine", EVERY), masks("coarse", EVERY)
    middle = np.abs(X) < 0.01
    over = middle & (np.abs(Y) > 1.3 * RED) & (np.abs(Y) < 1.6 * RED)
    assert fine["lip"][over].max() < 0.08 < coarse["lip"][over].max()
    assert fine["mouth"][over].min() > 0.6
    assert fine["lip"][middle & (np.abs(Y) < 0.5 * RED)].min() > 0.9
    assert (fine["lip"] + fine["mouth"]).max() <= 1.0 + 1e-6
    chin = middle & (Y > -3.4) & (Y < -2.9)
    assert fine["mouth"][chin].min() > 0.5
    assert "mouth" not in coarse


def test_coarse_masks_know_nothing_of_rolls() -> None:
    with_rolls, without = masks("coarse", EVERY), masks("coarse", ("mouthPucker", "jawOpen"))
    assert with_rolls.keys() == without.keys()
    for name, mask in with_rolls.items():
        np.testing.assert_array_equal(mask, without[name])


def test_without_a_jaw_the_mouth_is_what_a_pucker_carries() -> None:
    one, both = mouth_share(pucker(), None), mouth_share(pucker(), np.clip(-Y / 3.0, 0, 1))
    assert (both >= one).all()
    assert one[np.abs(Y) < 1.0] == pytest.approx(1.0)
    assert one[Y < -3.0].max() < both[Y < -3.0].max()
