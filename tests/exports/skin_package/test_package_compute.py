"""Stretch by the compute shaders of a package, beside float64. Run by `pytest -m peers`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import face_data
from engine.engines import built, running
from exports.skin_package.conftest import Written, write_package
from meshes import deform
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import NewAsset
from rhytid.exports.skin_package.runtime import stretch

pytestmark = pytest.mark.peers
log = logging.getLogger(__name__)
LANGUAGES = ("glsl-430", "hlsl", "wgsl")
# Of log ratios in single precision, and of axes where the ratios differ by a hundredth or more.
LOGS, AXES, APART = 2e-6, 2e-5, 0.01


def errors(
    package: Path, language: str, positions: NDArray[np.float32], faces: NDArray[Any]
) -> tuple[float, float]:
    """The largest difference from double of log ratios, and the largest sine between axes."""
    from exports.skin_package.computing import (
        computed,  # the plain run has neither moderngl nor wgpu
    )

    got = computed(package, language, positions, faces).reshape(-1, 8)
    rest = stretch.read_rest(package / "triangles.bin")
    want = stretch.log_stretch(positions.astype(float), faces, rest)
    count = len(faces)
    assert got[count].tolist() == [1, 0, 0, 1, 0, 0, 0, 0]
    logs = np.abs(got[:count, 4:6] - want[:, 4:6]).max()
    apart = want[:, 4] - want[:, 5] > APART
    u, v = (each[:, :4].reshape(-1, 2, 2)[apart] for each in (got[:count], want))
    sines = np.abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
    assert apart.any()
    return float(logs), float(sines.max())


@pytest.mark.parametrize("language", LANGUAGES)
def test_it_is_that_of_double(written: Written, language: str) -> None:
    moved = deform(written.mesh.positions, 5, 0.1)
    logs, axes = errors(written.folder, language, moved, written.mesh.faces)
    assert logs < LOGS
    assert axes < AXES


@pytest.mark.parametrize("language", LANGUAGES)
def test_pressed_triangles_are_finite(written: Written, language: str) -> None:
    from exports.skin_package.computing import computed

    moved, faces = deform(written.mesh.positions, 5, 0.1), written.mesh.faces
    moved[faces[0, 1]] = moved[faces[0, 0]]
    moved[faces[-1]] = moved[faces[-1, 0]]
    got = computed(written.folder, language, moved, faces).reshape(-1, 8)
    assert np.isfinite(got).all()
    assert got[0, 5] == got[len(faces) - 1, 4] == got[len(faces) - 1, 5] == stretch.LEAST_LOG


@pytest.mark.face
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_real_face(tmp_path: Path, face: face_data.Face, language: str) -> None:
    mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
    settings = AssetSettings.parse({"resolution": 512, "graph": {"wrinkles": 2000}})
    with running(tmp_path / "store") as engine:
        write_package(engine, built(engine, NewAsset(mesh, settings)), tmp_path / "skin")
    for name in ("smile", "jaw_open", "brow_furrow"):
        logs, axes = errors(tmp_path / "skin", language, face.composite(name), mesh.faces)
        log.info("%s, %s: log ratios within %.1e, axes within %.1e", language, name, logs, axes)
        assert logs < LOGS
        assert axes < 5e-4
