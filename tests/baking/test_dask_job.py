"""What a worker checks of its files."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshes import bumpy_grid
from rhytid.baking.farm.bake_session import (
    SharedFile,
    UnprintedWarnings,
    WorkerJob,
    mesh_digest,
)
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import MapQuery
from rhytid.errors import InputError, StrictError
from rhytid.exports.textures import Shine
from rhytid.formats.frame_set import Clip
from rhytid.support.build_identity import drawing_version


def test_a_file_that_is_the_same_is_taken(tmp_path: Path) -> None:
    (tmp_path / "face.obj").write_bytes(b"v 0 0 0")
    sent = pickle.dumps(SharedFile.of(tmp_path / "sub" / ".." / "face.obj"))

    assert pickle.loads(sent).check() == tmp_path / "face.obj"


@pytest.mark.parametrize(
    ("there", "message"),
    [
        (None, "no such file: {}; paths of a cluster are the same"),
        (b"v 0 0", "{} has 5 bytes, not 7"),
    ],
)
def test_a_file_that_is_not_is_named(there: bytes | None, message: str, tmp_path: Path) -> None:
    file = tmp_path / "face.obj"
    file.write_bytes(b"v 0 0 0")
    shared = SharedFile.of(file)
    file.unlink() if there is None else file.write_bytes(there)

    with pytest.raises(InputError, match=re.escape(message.format(file))):
        shared.check()


@pytest.mark.parametrize("name", ["positions", "faces", "uv", "face_uv"])
def test_each_array_of_a_mesh_counts(name: str) -> None:
    arrays = bumpy_grid(4, seed=1)._asdict()
    before = mesh_digest(Mesh(**arrays))
    changed = np.array(arrays[name])
    changed[0] = changed[0][::-1] if changed.dtype.kind == "i" else changed[0] / 2 + 0.25

    assert mesh_digest(Mesh(**arrays)) == before
    assert mesh_digest(Mesh(**{**arrays, name: changed})) != before


def job(tmp_path: Path) -> WorkerJob:
    file = tmp_path / "file"
    file.write_bytes(b"x")
    there = SharedFile.of(file)
    return WorkerJob(
        mesh=there,
        mesh_digest="",
        frames=(),
        files=(),
        clip=Clip(),
        snapshot=there,
        asset="a" * 16,
        out=str(tmp_path),
        name="face",
        profiles=("float",),
        compression="zip",
        blood_seconds=0.15,
        shine=Shine(3, 0.4),
        geometry=None,
        subdivide=2,
        query=MapQuery(),
        strict=False,
        allow=(),
        drawing=drawing_version(),
    )


def test_a_worker_that_draws_otherwise_refuses_the_job(tmp_path: Path) -> None:
    """Its version may be the same, and one kernel another."""
    here = job(tmp_path)
    here.check()
    other = replace(here, drawing=f"{here.drawing[:-1]}~")
    with pytest.raises(InputError, match=f"{re.escape(other.drawing)}: install the same rhytid"):
        other.check()


def test_errors_of_a_worker_do_not_say_that_nothing_was_done(tmp_path: Path) -> None:
    with pytest.raises(StrictError, match="1 warning, and files of other frames may be written"):
        UnprintedWarnings("bake", True).replaces(tmp_path / "face.1001.0003.exr", True)
