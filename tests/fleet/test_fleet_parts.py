"""What a fleet is made of, without Ray: where assets are placed, what is shared, what is known."""

from __future__ import annotations

import asyncio
import shutil
from collections import Counter
from contextvars import Context
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from rhytid.engine.call_context import drawn_live, is_live
from rhytid.engine.messages import JobInfo
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import NotFoundError, SettingsError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.envelopes import Addressed, ElsewhereError, Parcel
from rhytid.fleet.frame_registry import FrameRegistry
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.jobs import JobName, JobNames, ReplicaNames
from rhytid.fleet.local_place import LocalPlace
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.replica import EngineReplica
from rhytid.fleet.router import replica_order
from rhytid.processes.envelope import Answer, Envelope, Request

ASSET = "0123456789abcdef"
NAMES = [f"replica{number}" for number in range(10)]


def test_an_asset_stays_where_it_is_when_another_replica_goes() -> None:
    assets = [f"{number:016x}" for number in range(2000)]
    before = {asset: replica_order(asset, NAMES)[0] for asset in assets}
    after = {asset: replica_order(asset, NAMES[1:])[0] for asset in assets}
    moved = [asset for asset in assets if before[asset] != after[asset]]
    assert set(moved) == {asset for asset in assets if before[asset] == NAMES[0]}
    assert max(Counter(before.values()).values()) < 1.4 * len(assets) / len(NAMES)


def test_the_second_replica_is_the_first_of_those_that_are_left() -> None:
    first, second, *_ = replica_order(ASSET, NAMES)
    assert replica_order(ASSET, [name for name in NAMES if name != first])[0] == second


def test_the_id_of_a_job_names_its_replica() -> None:
    info = JobInfo("00ff", ASSET, "build", "running", 0.5, "pores", "")
    names = JobNames(b"a key")
    named = ReplicaNames(names, "abc12XYZ", lambda job: info).job(info)
    assert JobNames(b"a key").read(named.id) == JobName("00ff", "build", ASSET, "abc12XYZ")
    assert replace(named, id="00ff") == info
    for wrong in ("00ff", f"00ff-build-{ASSET}", f"00ff-build-{ASSET}-a/b", f"{named.id}\n"):
        with pytest.raises(NotFoundError, match="no job"):
            names.read(wrong)


@pytest.mark.parametrize(
    "change",
    [("00ff", "00fe"), ("build", "frames"), (ASSET, "1" * 16), ("abc12XYZ", "abc12XYY")],
)
def test_an_id_of_a_job_that_the_fleet_has_not_made_is_none(change: tuple[str, str]) -> None:
    names = JobNames(b"a key")
    made = names.id(JobName("00ff", "build", ASSET, "abc12XYZ"))
    for forged in (made.replace(*change), made[:-1] + "xy"[made[-1] == "x"], made[:-17], "a" * 400):
        with pytest.raises(NotFoundError, match="no job"):
            names.read(forged)
    with pytest.raises(NotFoundError, match="no job"):
        JobNames(b"another key").read(made)


def test_the_board_keeps_frames_under_its_budget() -> None:
    async def use() -> None:
        positions = np.ones((10, 3), np.float32)
        board, limit = FrameRegistry(), 2 * positions.nbytes

        async def keep(name: str, values: Any) -> int:
            return (await board.keep(ASSET, name, values, limit)).version

        first = await keep("a", positions)
        second = await keep("a", 2 * positions)
        assert second > first
        stamp, kept = await board.frame(ASSET, "a")
        assert stamp.version == second
        assert kept is not None
        assert kept[0, 0] == 2
        await keep("b", positions)
        assert await keep("c", positions) == 0
        assert set(await board.versions(ASSET)) == {"a", "b"}
        assert await keep("b", positions) > second
        assert await keep("b", np.ones((11, 3), np.float32)) == 0
        assert (await board.frame(ASSET, "b"))[1] is not None
        gone = await board.remove(ASSET, "a")
        assert await board.frame(ASSET, "a") == (replace(stamp, version=gone), None)
        await keep("c", positions)
        assert set(await board.versions(ASSET)) == {"a", "b", "c"}
        await board.forget(ASSET)
        assert await board.versions(ASSET) == {}
        assert await board.frame(ASSET, "b") == (replace(stamp, version=0), None)

    asyncio.run(use())


def test_a_board_that_starts_again_has_larger_versions() -> None:
    async def use() -> None:
        before = await FrameRegistry().remove(ASSET, "a")
        assert await FrameRegistry().remove(ASSET, "a", before) > before

    asyncio.run(use())


def test_answers_and_errors_come_back() -> None:
    array = np.arange(10_000, dtype=np.float32)
    answer = Parcel.of(Answer(True, {"a": array, "b": 1}))
    assert answer.arrays[0].nbytes == array.nbytes
    assert np.array_equal(answer.open().value["a"], array)
    error = Parcel.of(Answer(False, ElsewhereError("abc"))).open().value
    assert isinstance(error, ElsewhereError)
    assert error.replica == "abc"


def test_options_are_read_or_refused() -> None:
    found = FleetOptions.read({"replicas": "2-8", "store": "/mnt/x", "gpus": "1", "spread": 3})
    assert (found.least, found.most, found.store) == (2, 8, Path("/mnt/x"))
    assert (found.gpus, found.spread) == (1.0, 3)
    for wrong in ({"replicas": "8-2"}, {"replicas": "0"}, {"spread": "0"}, {"cpus": "x"}):
        with pytest.raises(SettingsError, match=f"{next(iter(wrong))}.* must be|number from 1 on"):
            FleetOptions.read(wrong)
    with pytest.raises(SettingsError, match="no option 'least' of a fleet: there are assets"):
        FleetOptions.read({"least": 1})


def test_each_replica_of_a_machine_has_its_place(tmp_path: Path) -> None:
    first, second = LocalPlace(tmp_path), LocalPlace(tmp_path)
    assert (first.number, second.number) == (0, 1)
    left = first.store / "left"
    left.touch()
    shutil.copytree(first.store, tmp_path / "left by one that was killed")
    first.close()
    assert not first.store.exists()
    (tmp_path / "left by one that was killed").rename(first.store)
    third = LocalPlace(tmp_path)
    assert (third.number, third.store) == (0, first.store)
    assert not left.exists()
    second.close()
    third.close()


def test_a_replica_of_another_build_performs_nothing() -> None:
    """Its version is the same, and one kernel another: maps would differ from those of others."""

    class Calls:
        performed = 0

        def perform(self, envelope: Envelope, asset: str, to: str) -> Answer:
            self.performed += 1
            return Answer(True, "drawn")

    replica: Any = object.__new__(EngineReplica)
    replica._name, replica._calls = "one", Calls()
    call = Envelope(1, "tiles.draw", (), {})

    def performed(call: Envelope) -> Answer:
        found = replica._performed(Addressed.of(call, "", ""), lambda: False).open()
        return cast(Answer, found)

    assert performed(call).value == "drawn"
    answer = performed(replace(call, drawing="0.1.0+other"))
    assert not answer.good
    assert "ingress as 0.1.0+other: install the same" in str(answer.value)
    assert replica._calls.performed == 1


def test_that_it_is_for_a_live_connection_comes_to_the_replica() -> None:
    """Else live frames of a fleet wait for every tile that others ask for."""

    class Calls:
        def perform(self, envelope: Envelope, asset: str, to: str) -> Answer:
            return Answer(True, is_live())

    parts, replica = None, object.__new__(EngineReplica)
    replica._name, replica._calls = "one", cast(Any, Calls())
    caller = FleetCaller(cast(Any, parts), FrameVersions(), JobNames(b"a key"), lambda: True)

    def performed() -> Any:
        call = caller._addressed(Request(OPERATIONS["tiles.draw"], (ASSET, "smile")), ASSET, "")
        return Context().run(replica._performed, call, lambda: False).open().value

    with drawn_live():
        assert performed() is True
    assert performed() is False
