"""Folds of a real face: raised brows fold it, a smile and a frown hardly, and a capture calmly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from reference.stretch import log_stretch
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.stretch import StretchStage

pytestmark = [pytest.mark.face, pytest.mark.slow]
LIMIT = 0.5
# Places in cm, x to the left and y up, and their radius.
NASOLABIAL = (3.2, -2.7, 0.5)
FOREHEAD, GLABELLA, CHEEK, EYE = (2.0, 8.0, 1.0), (0.0, 5.4, 0.7), (4.6, -1.0, 1.0), (5.4, 3.0, 0.6)


@pytest.fixture(scope="module")
def mesh(face):
    return Mesh(face.positions, face.faces, face.uv, face.face_uv)


@pytest.fixture(scope="module")
def measured(device, mesh):
    """The compression around a place in a frame, and the share of it that folds take."""
    stage = StretchStage(device, mesh, "cm")
    middle = (mesh.positions[mesh.faces].astype(float) + mesh.centre).mean(axis=1)

    def of(positions, place):
        found = stage.run(positions, LIMIT, folds=1.0)
        pressed = np.maximum(-log_stretch(stage.read(found)[0], LIMIT), 0).sum(axis=1)
        shares = stage.read_taken(found)
        found.release()
        near = np.hypot(middle[:, 0] - place[0], middle[:, 1] - place[1]) < place[2]
        near &= middle[:, 2] > 5.0
        share = np.average(shares[near], weights=pressed[near] + 1e-9)
        return float(pressed[near].mean()), float(share)

    yield of
    stage.release()


@pytest.fixture(scope="module")
def taken(measured):
    return lambda positions, place: measured(positions, place)[1]


def test_raised_brows_fold_the_forehead(taken, face):
    assert taken(face.composite("brows_up"), FOREHEAD) > 0.35


@pytest.mark.parametrize(
    ("name", "place", "most"),
    [("smile", CHEEK, 0.05), ("smile", EYE, 0.12), ("brow_furrow", GLABELLA, 0.02)],
)
def test_a_smile_and_a_frown_keep_their_lines(taken, face, name, place, most):
    assert taken(face.composite(name), place) < most


def test_a_raise_has_no_jump(taken, face):
    up, down = face.composite("brows_up"), face.positions
    shares = [
        taken((down + k * (up - down)).astype(np.float32), FOREHEAD) for k in np.linspace(0, 1, 31)
    ]
    assert max(abs(b - a) for a, b in pairwise(shares)) < 0.08


@pytest.mark.parametrize(
    ("name", "place"), [("brows_up", FOREHEAD), ("smile", NASOLABIAL), ("big_smile", EYE)]
)
def test_lines_do_not_flash_on_the_way(measured, face, name, place):
    """What is left to them hardly falls while an expression goes on."""
    rest, end = face.positions, face.composite(name)
    left = []
    for way in np.linspace(0, 1, 31):
        pressed, share = measured((rest + way * (end - rest)).astype(np.float32), place)
        left.append(pressed * (1 - share))
    assert left[-1] > 0.85 * max(left)


def test_a_capture_moves_no_more_than_without_folds(device, mesh, face):
    stage = StretchStage(device, mesh, "cm")
    change = {}
    for folds in (0.0, 1.0):
        logs = []
        for index in range(1780, 1820):
            found = stage.run(face.captured(index), LIMIT, folds=folds)
            logs.append(device.read(found.logs, (len(mesh.faces) + 1, 2), np.float32))
            found.release()
        change[folds] = np.abs(np.diff(logs, axis=0))
    stage.release()
    assert change[0.0].max() > 0.1
    for of in (np.max, np.mean):
        assert of(change[1.0]) < 1.05 * of(change[0.0])
