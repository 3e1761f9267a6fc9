"""What a bake on a cluster does where the command does not say."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from rhytid.baking.farm import dask_bake
from rhytid.baking.farm.dask_bake import chunk_size, worker_devices
from rhytid.baking.request import BakeRequest
from rhytid.cli.service_options import service_settings
from rhytid.engine.messages import MapQuery


@pytest.mark.parametrize(
    ("frames", "slots", "size"), [(80, 2, 10), (81, 2, 11), (1, 9, 1), (4000, 1, 50)]
)
def test_tasks_are_of_fifty_frames_at_most(frames: int, slots: int, size: int) -> None:
    assert chunk_size(frames, slots) == size


@pytest.mark.parametrize(
    ("gpus", "option", "variable", "count", "devices"),
    [
        (3, None, None, None, ["0", "1", "2"]),
        (3, None, None, 4, ["0", "1", "2", "0"]),
        (3, "2", None, None, ["2", "2"]),
        (3, None, "1", None, ["1", "1"]),
        (3, "2", "1", 3, ["2", "2", "2"]),
        (0, None, None, None, [None, None]),
    ],
)
def test_processes_here_have_the_device_that_is_named_or_one_each(
    gpus: int,
    option: str | None,
    variable: str | None,
    count: int | None,
    devices: list[str | None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = [SimpleNamespace(index=index, kind="gpu") for index in range(gpus)]
    monkeypatch.setattr(dask_bake, "candidates", lambda: found)
    monkeypatch.delenv("RHYTID_DEVICE", raising=False)
    if variable is not None:
        monkeypatch.setenv("RHYTID_DEVICE", variable)
    request = BakeRequest(
        mesh=Path("face.obj"),
        out=Path("maps"),
        profiles=(),
        query=MapQuery(),
        service=service_settings(None, option, None),
        dask="local",
        dask_workers=count,
    )

    assert worker_devices(request) == devices
