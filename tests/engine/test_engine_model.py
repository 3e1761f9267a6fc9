"""Any order of calls for assets, frames, jobs and restarts, over little memory, beside a model."""

from __future__ import annotations

import json
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from engine.engines import QUERIES, draw, finish, new_asset, rest, running, settle
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery
from rhytid.errors import FrameMemoryError, NotFoundError

MESH = sheet()
FRAME_BYTES = MESH.positions.nbytes
MOST_FRAMES = 2
# Room for one asset with maps of all methods, and not for two.
BUDGET = 3 << 20
SEEDS, FRAMES = st.integers(0, 3), st.sampled_from(["a", "b"])
ADDRESSES = st.sampled_from([TileAddress(1001, 0, 1, 0), TileAddress(1001, 1, 0, 0)])


@dataclass
class Known:
    """What an asset should be: the seed that it was made of, its frames by name, its bulge."""

    seed: int
    frames: dict[str, int] = field(default_factory=dict)
    bulge: float | None = None  # not changed


class Calls(RuleBasedStateMachine):
    """An engine on a store of its own, and what it should hold."""

    # Tiles by what they are made of: the same in every history.
    seen: dict[tuple[object, ...], bytes] = {}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.closing = ExitStack()
        folder = self.closing.enter_context(tempfile.TemporaryDirectory())
        self.store = Path(folder) / "store"
        self.known: dict[str, Known] = {}
        self.open()

    def open(self) -> None:
        memory = {"device_memory": BUDGET, "frame_memory": MOST_FRAMES * FRAME_BYTES}
        self.running = self.closing.enter_context(ExitStack())
        self.engine = self.running.enter_context(running(self.store, **memory))

    def teardown(self) -> None:
        self.closing.close()

    def pick(self, data: st.DataObject) -> str:
        return data.draw(st.sampled_from(sorted(self.known)))

    @initialize()
    def begin(self) -> None:
        """With one asset and its frames: most calls are about what is there."""
        self.create(0, wait=True)
        [asset] = self.known
        for frame, bent in (("a", 1), ("b", 2)):
            self.engine.frames.put(asset, frame, deform(MESH.positions, bent, 0.15))
            self.known[asset].frames[frame] = bent

    @precondition(lambda self: not self.known)
    @rule()
    def begin_again(self) -> None:
        """The frames of what was deleted have given back their memory."""
        self.begin()

    @rule(seed=SEEDS, wait=st.booleans())
    def create(self, seed: int, wait: bool) -> None:
        info = self.engine.assets.create(new_asset(MESH, seed))
        assert self.known.setdefault(info.id, Known(seed)).seed == seed
        if wait:
            settle(self.engine, info.id)
            assert self.engine.assets.info(info.id).state == "ready"

    @precondition(lambda self: self.known)
    @rule(data=st.data())
    def delete(self, data: st.DataObject) -> None:
        asset = self.pick(data)
        self.engine.assets.delete(asset)
        del self.known[asset]
        with pytest.raises(NotFoundError):
            self.engine.assets.info(asset)

    @precondition(lambda self: self.known)
    @rule(data=st.data(), frame=FRAMES, bent=st.integers(0, 2))
    def put_frame(self, data: st.DataObject, frame: str, bent: int) -> None:
        asset = self.pick(data)
        settle(self.engine, asset)
        frames = self.known[asset].frames
        full = sum(len(known.frames) for known in self.known.values()) == MOST_FRAMES
        positions = deform(MESH.positions, bent, 0.15)
        if full and frame not in frames:
            with pytest.raises(FrameMemoryError):
                self.engine.frames.put(asset, frame, positions)
        else:
            self.engine.frames.put(asset, frame, positions)
            frames[frame] = bent

    @precondition(lambda self: any(known.frames for known in self.known.values()))
    @rule(data=st.data())
    def delete_frame(self, data: st.DataObject) -> None:
        places = [(id, frame) for id, known in self.known.items() for frame in known.frames]
        asset, frame = data.draw(st.sampled_from(places))
        self.engine.frames.delete(asset, frame)
        del self.known[asset].frames[frame]

    @precondition(lambda self: self.known)
    @rule(data=st.data(), query=st.sampled_from(QUERIES), address=ADDRESSES)
    def tile(self, data: st.DataObject, query: MapQuery, address: TileAddress) -> None:
        asset = self.pick(data)
        settle(self.engine, asset)
        rest(self.engine)
        known = self.known[asset]
        frame = data.draw(st.sampled_from(["neutral", *sorted(known.frames)]))
        drawn = draw(self.engine, asset, frame, query, address).tobytes()
        made = json.dumps(self.engine.assets.info(asset).settings, sort_keys=True)
        key = (known.seed, made, known.frames.get(frame), query, address)
        assert self.seen.setdefault(key, drawn) == drawn

    @precondition(lambda self: self.known)
    @rule(data=st.data(), bulge=st.sampled_from([0.0, 1.0]))
    def change(self, data: st.DataObject, bulge: float) -> None:
        asset = self.pick(data)
        settle(self.engine, asset)
        self.engine.assets.change(asset, {"shape": {"wrinkle_bulge": bulge}})
        self.known[asset].bulge = bulge

    @precondition(lambda self: self.known)
    @rule(data=st.data(), cancel=st.booleans())
    def calibrate(self, data: st.DataObject, cancel: bool) -> None:
        asset = self.pick(data)
        settle(self.engine, asset)
        job = self.engine.assets.calibrate(asset, deform(MESH.positions, 1, 0.15)).id
        if cancel:
            self.engine.jobs.cancel(job)
        assert finish(self.engine, job).state in (("done", "cancelled") if cancel else ("done",))

    @rule()
    def restart(self) -> None:
        self.running.close()
        self.open()
        for known in self.known.values():
            known.frames.clear()

    @invariant()
    def it_holds_what_it_should(self) -> None:
        infos = {info.id: info for info in self.engine.assets.all()}
        assert set(infos) == set(self.known)
        for id, known in self.known.items():
            assert infos[id].state in ("building", "ready")
            if infos[id].state == "ready":
                frames = [info.name for info in self.engine.frames.all(id)]
                assert frames == ["neutral", *sorted(known.frames)]
                found = infos[id].settings["shape"]["wrinkle_bulge"]
                assert known.bulge in (None, found)

    @invariant()
    def it_stays_within_its_memory(self) -> None:
        device = next(info for info in self.engine.devices() if info.selected)
        assert 0 <= device.used <= device.budget == BUDGET


Calls.TestCase.settings = settings(
    max_examples=60, stateful_step_count=20, suppress_health_check=list(HealthCheck)
)
TestCalls = pytest.mark.slow(Calls.TestCase)
