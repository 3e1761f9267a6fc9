"""What a bake on a cluster removes beside its maps, without a cluster."""

from __future__ import annotations

import os
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from uuid import uuid4

import pytest

from rhytid.baking.farm import dask_bake
from rhytid.baking.farm.dask_bake import DaskBake
from rhytid.baking.frame_names import FramePlace, FrameRange
from rhytid.baking.output import Output
from rhytid.baking.request import BakeRequest
from rhytid.baking.run_warnings import RunWarnings
from rhytid.engine.messages import MapQuery
from rhytid.errors import StorageError
from rhytid.exports.textures.profiles import profiles_of
from rhytid.support.atomic_files import sweep
from rhytid.support.settings import ServiceSettings
from storage.leftovers import left_by_a_killed_writer

PROFILES = profiles_of(["float", "weights"])


class Undrawn(DaskBake):
    """A bake that draws nothing; it ends with `failure`, if there is one."""

    failure: Exception | None = None

    def _job(self, shared: Path) -> Any:
        self.shared = shared
        self.mode = shared.stat().st_mode & 0o777

    def _bake(self, cluster: Any, job: Any) -> None:
        self._chunks = self._numbers.chunks(2)
        if self.failure is not None:
            raise self.failure


@pytest.fixture(autouse=True)
def without_a_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_bake, "bake_cluster", nullcontext)


def bake(out: Path, dask: str = "tcp://farm:8786") -> Undrawn:
    """A bake of frames 1001 to 1004, with surfaces."""
    request = BakeRequest(
        mesh=Path("face.obj"),
        out=out,
        profiles=PROFILES,
        query=MapQuery(),
        service=ServiceSettings(),
        dask=dask,
        geometry="glb",
    )
    frames = SimpleNamespace(places=[FramePlace(str(n), None, n) for n in range(1001, 1005)])
    output = Output(out, "face", PROFILES)
    asset = SimpleNamespace(udims=(1001, 1002))
    looked = {"refuse_replaced": lambda: None, "tell_origins": lambda found: None}
    told = RunWarnings("bake", False)
    baker = SimpleNamespace(frames=frames, output=output, asset=asset, warnings=told, **looked)
    given = SimpleNamespace(numbers=FrameRange.of(range(1001, 1005)), name="face")
    return Undrawn(request, cast("Any", given), cast("Any", baker))


def unfinished(out: Path, file: str) -> Path:
    """What is left where the writer of a file is killed, or while it writes."""
    return left_by_a_killed_writer(out, uuid4().hex, file)


OWN = (
    "face.1001.1004.exr",
    "face.1002.1001.exr",
    "face.weights.1003.1001.png",
    "face.1004.glb",
    "face.bake.1001-1002.json",
)
# The first UDIM is the label of a frame, too.
FOREIGN = (
    "face.1001.0007.exr",
    "face.1001.2001.exr",
    "face.mip.1001.1001.exr",
    "face.1001.ply",
    "face.bake.1001-1003.json",
    "faces.1001.1001.exr",
)


def test_half_files_of_other_bakes_stay(tmp_path: Path) -> None:
    own = [unfinished(tmp_path, file) for file in OWN]
    foreign = [unfinished(tmp_path, file) for file in FOREIGN]

    bake(tmp_path).run()

    assert [folder.name for folder in own if folder.exists()] == []
    assert [folder.name for folder in foreign if not folder.exists()] == []


@pytest.mark.parametrize(("dask", "stays"), [("tcp://farm:8786", True), ("local", False)])
def test_half_files_of_workers_that_may_live_stay_after_an_error(
    dask: str, stays: bool, tmp_path: Path
) -> None:
    half = unfinished(tmp_path, OWN[0])
    failing = bake(tmp_path, dask)
    failing.failure = StorageError("the disk failed")

    with pytest.raises(StorageError):
        failing.run()

    assert half.exists() == stays


def test_the_folder_of_the_snapshot_is_for_others_and_is_swept(tmp_path: Path) -> None:
    baking = bake(tmp_path)
    baking.run()

    assert baking.mode == 0o755
    assert not baking.shared.exists()
    baking.shared.mkdir()
    sweep(tmp_path)
    assert baking.shared.exists(), "it may be in use"
    os.utime(baking.shared, (0, 0))
    sweep(tmp_path)
    assert not baking.shared.exists()
