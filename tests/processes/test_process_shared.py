"""Servers with a shared store, each with a process of its own for the device."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from api.asking import NPY, npy
from api.patch import smile
from engine.engines import REDRAW, built, new_asset, running
from engine.test_engine_shared import FIRST
from pipeline.scenes import sheet
from processes.served import await_value, faults, serving
from rhytid.domain.expressions import Expressions
from rhytid.errors import NotFoundError
from rhytid.processes.remote_engine import RemoteEngine
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.support.settings import ServiceSettings

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
        url = f"/v1/assets/{one.asset}"
        await_value(lambda: other.client.get(url).json().get("state") == "ready")
        other.client.put(other.frame, content=npy(smile()), headers=NPY).raise_for_status()
        assert other.tile(method="redraw").content == wanted.content

        other.client.delete(url, params={"shared": "true"})
        assert shared.ids() == []
        assert other.tile().status_code == 404
        assert one.tile(method="redraw").content == wanted.content


def new(folder: Path) -> Path:
    folder.mkdir()
    return folder


def test_a_machine_in_step_follows_across_its_process(tmp_path: Path) -> None:
    """What the server keeps of an asset goes where the process fetches it anew, or drops it."""
    given: Any = {"shared_store": str(new(tmp_path / "shared")), "in_step": True}
    settings = replace(ServiceSettings.from_environment(), store=tmp_path / "b", **given)
    mesh = sheet()
    moved = Expressions.checked(mesh.positions[None], len(mesh.positions), ["jawOpen"])
    with (
        running(tmp_path / "a", **given) as one,
        closing(RemoteEngine(settings)) as other,
    ):
        asset = built(one, new_asset(mesh))
        found = other.assets.follow(asset, replace=True)
        assert found is not None
        assert (found.info.state, found.replaced) == ("ready", True)
        other.frames.put(asset, "bent", mesh.positions)
        one.assets.change(asset, {"depth": 0.25})
        found = other.assets.follow(asset, replace=False)
        assert found is not None
        assert (found.info.settings["depth"], found.replaced) == (0.25, False)
        assert other.frames.info(asset, "bent").name == "bent"
        built(one, replace(new_asset(mesh), shapes=moved))
        assert other.assets.follow(asset, replace=False) is None
        found = other.assets.follow(asset, replace=True)
        assert found is not None
        assert found.replaced
        with pytest.raises(NotFoundError):
            other.tiles.draw(asset, "bent", REDRAW, FIRST)
        assert not other.assets.leave(asset), "it was used a moment ago"
