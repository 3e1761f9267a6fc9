"""Patches of relief that is compared: of the right place of a map, whichever way v points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from bench.relief_figures import patch
from formats.writers import SQUARE, SQUARE_FACES, SQUARE_UV, glb, gltf


def test_a_glb_whose_v_points_up_is_turned_back(tmp_path: Path) -> None:
    """As that of the scanned head: else the relief of another place lies on the cheek."""
    arrays = {"positions": SQUARE, "faces": SQUARE_FACES, "uv": SQUARE_UV, "face_uv": SQUARE_FACES}
    np.savez(tmp_path / "true.npz", **arrays)
    index = SQUARE_FACES.reshape(-1, 1).astype(np.uint16)
    file = {"POSITION": SQUARE, "TEXCOORD_0": SQUARE_UV.astype(np.float32), "indices": index}
    (tmp_path / "up.glb").write_bytes(glb(gltf(file)))
    grey = np.full((64, 64), 128, np.uint8)
    grey[34:46, 30:46] = 228
    Image.fromarray(grey).save(tmp_path / "map.png")
    middle = SQUARE.mean(axis=0).astype(np.float64)

    def heights(mesh: str, turned: bool = False) -> np.ndarray:
        given = (tmp_path / mesh, 1.0, tmp_path / "map.png", middle, 0.6)
        return patch("a@1", *given, turned).heights

    wanted = heights("true.npz")
    assert np.ptp(wanted) > 50
    np.testing.assert_allclose(heights("up.glb", True), wanted, atol=1e-3)
    assert np.abs(heights("up.glb") - wanted).max() > 50
