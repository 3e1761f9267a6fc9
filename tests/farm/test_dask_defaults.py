"""What a bake on a cluster does where the command does not say."""

from __future__ import annotations

from argparse import Namespace
from types import SimpleNamespace

import pytest

from rhytid.cli import bake_cluster
from rhytid.cli.bake_cluster import worker_devices
from rhytid.cli.dask_bake import chunk_size


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
    monkeypatch.setattr(bake_cluster, "candidates", lambda: found)
    monkeypatch.delenv("RHYTID_DEVICE", raising=False)
    if variable is not None:
        monkeypatch.setenv("RHYTID_DEVICE", variable)
    arguments = Namespace(device=option, dask_workers=count)

    assert worker_devices(arguments) == devices
