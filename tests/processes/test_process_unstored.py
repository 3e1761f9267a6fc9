"""Positions that are drawn without being stored are checked, named and sent once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from engine.engines import REDRAW, built, new_asset, running
from rhytid.domain.tiles import TileAddress
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.engine import Engine
from rhytid.engine.frames import Frame, UnknownFrameError
from rhytid.engine.operations import Proxy
from rhytid.errors import FrameError, StrictError
from rhytid.processes.envelope import Request, answered
from rhytid.processes.frame_ledger import FrameLedger
from rhytid.processes.job_ledger import JobLedger
from rhytid.processes.packing import unpack
from rhytid.processes.remote_calls import RemoteCalls, UploadHolds

PLACES = [TileAddress(1001, 0, 0, column) for column in range(4)]


class Transport:
    """Carries calls to an engine of this process as to another one; `sent` has the bytes of
    each."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.sent: list[int] = []

    def call(self, request: Request, prepare: Any = None) -> Any:
        packed = request.packed
        self.sent.append(len(packed.body) + packed.nbytes)
        memory = np.empty(packed.nbytes, np.uint8)
        packed.write(memory)
        envelope = unpack(packed.body, packed.places, memory)
        return answered(envelope, lambda e: e.perform(self.engine), lambda: False).open()

    def forget(self, asset: str) -> None: ...

    def forget_frames(self) -> None:
        """As a process that is started anew."""
        memory = cast(Any, self.engine.frames)._assets.frame_memory
        memory._recent.clear()
        memory._recent_bytes = 0


@pytest.fixture
def transport(tmp_path: Path) -> Iterator[Transport]:
    with running(tmp_path / "store") as engine:
        yield Transport(engine)


def engine_over(transport: Transport) -> Proxy:
    uploads = UploadHolds(ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB"))
    ledger = FrameLedger(1 << 30, lambda *_: None)
    return Proxy(RemoteCalls(transport, ledger, JobLedger(), uploads))


def test_positions_go_with_the_first_call_alone(transport: Transport) -> None:
    asset = built(transport.engine, new_asset())
    engine = engine_over(transport)
    positions = transport.engine.frames.positions(asset, "neutral") * np.float32([1.1, 1, 1])
    frame = Frame.checked(positions, len(positions))
    engine.frames.put(asset, "same", positions)
    stored = [engine.tiles.draw(asset, "same", REDRAW, at).tile.copy() for at in PLACES]
    transport.sent.clear()

    for _ in range(2):
        engine.frames.warnings(asset, frame)
        drawn = [engine.tiles.draw(asset, frame, REDRAW, at) for at in PLACES]
        assert [one.tile.tobytes() for one in drawn] == [one.tobytes() for one in stored]
        assert {one.description.header.frame for one in drawn} == {""}
    first, *others = transport.sent
    assert first >= positions.nbytes
    assert max(others) < 0.6 * positions.nbytes


def test_a_process_that_lost_them_gets_them_again(transport: Transport) -> None:
    asset = built(transport.engine, new_asset())
    engine = engine_over(transport)
    positions = transport.engine.frames.positions(asset, "neutral")
    frame = Frame.checked(positions, len(positions))
    before = engine.tiles.draw(asset, frame, REDRAW, PLACES[0]).tile.copy()
    transport.forget_frames()
    with pytest.raises(UnknownFrameError):
        transport.engine.tiles.draw(asset, frame.bare, REDRAW, PLACES[0])
    assert engine.tiles.draw(asset, frame, REDRAW, PLACES[0]).tile.tobytes() == before.tobytes()
    transport.forget_frames()
    assert engine.frames.warnings(asset, frame) == ()


def test_they_are_those_of_the_asset(transport: Transport) -> None:
    asset = built(transport.engine, new_asset())
    engine = engine_over(transport)
    positions = transport.engine.frames.positions(asset, "neutral")
    other = Frame.checked(positions[:-1], len(positions) - 1)
    with pytest.raises(FrameError, match="vertices, the neutral mesh has"):
        engine.tiles.draw(asset, other, REDRAW, PLACES[0])
    far = Frame.checked(100 * positions, len(positions))
    for _ in range(2):
        with pytest.raises(StrictError):
            engine.frames.warnings(asset, far, strict=True)
