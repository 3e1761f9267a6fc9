"""Servers with a shared store, each with a process of its own for the device."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from api.asking import NPY, npy
from api.patch import smile
from engine_process.served import await_value, faults, serving
from rhytid.storage.shared.shared_store import SharedStore

__all__ = ["faults"]


@pytest.mark.slow
def test_servers_share_what_one_of_them_builds(bucket: str, faults: Path, tmp_path: Path) -> None:
    """The other fetches it, and a removal there reaches the shared store."""
    with ExitStack() as opened:
        one, other = (
            opened.enter_context(
                serving(folder, faults, "--shared-store", bucket, "--devices", "0")
            )
            for folder in (new(tmp_path / "a"), new(tmp_path / "b"))
        )
        one.make()
        wanted = one.tile(method="redraw")
        shared = SharedStore.at(bucket)
        await_value(lambda: shared.ids() == [one.asset])

        other.asset = one.asset
        await_value(lambda: other.client.get(f"/v1/assets/{one.asset}").status_code == 200)
        other.client.put(other.frame, content=npy(smile()), headers=NPY).raise_for_status()
        assert other.tile(method="redraw").content == wanted.content

        other.client.delete(f"/v1/assets/{one.asset}", params={"shared": "true"})
        assert shared.ids() == []
        assert other.tile().status_code == 404
        assert one.tile(method="redraw").content == wanted.content


def new(folder: Path) -> Path:
    folder.mkdir()
    return folder
