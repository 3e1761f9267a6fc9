"""Messages between the server and the process: values, large arrays, descriptors, errors."""

from __future__ import annotations

import gc
import os
import resource
import socket
import threading
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.domain.expressions import Expressions
from rhytid.domain.painted_maps import Controls, Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine import wanted
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.engine_process.line import Line, Lines
from rhytid.engine_process.packing import APART, pack, unpack
from rhytid.engine_process.requests import Request
from rhytid.engine_process.shared import mapped, private, shared_file
from rhytid.engine_process.wire import Message, close_all, readable, receive, send
from rhytid.errors import CancelledError, HostBusyError, NotFoundError, RhytidError, StrictError

SIZES = st.lists(st.integers(0, 5 * APART), max_size=4)


def shared(nbytes: int) -> Any:
    descriptor = shared_file(nbytes)
    memory = mapped(descriptor, nbytes)
    os.close(descriptor)
    return memory


@given(SIZES)
def test_arrays_of_all_sizes_come_back(sizes: list[int]) -> None:
    arrays = [np.arange(size, dtype=np.uint8) for size in sizes]
    packed = pack(("name", arrays))
    memory = None
    if packed.nbytes:
        memory = shared(packed.nbytes)
        packed.write(memory)
    name, found = unpack(packed.body, packed.sizes, memory)
    assert name == "name"
    assert [one.tobytes() for one in found] == [one.tobytes() for one in arrays]
    assert len(packed.sizes) == sum(size >= APART for size in sizes)


@pytest.mark.parametrize(
    "error",
    [
        NotFoundError("no frame 'x'"),
        HostBusyError("later"),
        StrictError("two", (("code", "text"),)),
    ],
)
def test_errors_come_back_with_what_they_carry(error: RhytidError) -> None:
    found = unpack(pack(error).body, (), None)
    assert type(found) is type(error)
    assert (str(found), vars(found)) == (str(error), vars(error))


def test_a_private_mapping_is_not_written_back() -> None:
    descriptor = shared_file(16)
    both, one = mapped(descriptor, 16), private(descriptor, 16)
    os.close(descriptor)
    both[0] = 1
    one[1] = 2
    assert both.tolist()[:2] == [1, 0]


def test_mappings_hold_no_descriptor_and_go_with_their_last_array() -> None:
    def here() -> tuple[int, int]:
        with open("/proc/self/maps") as maps:
            return len(os.listdir("/proc/self/fd")), maps.read().count("memfd:rhytid")  # noqa: PTH208

    before = here()
    kept = [shared(4096)[10:20] for _ in range(5)]
    assert here() == (before[0], before[1] + 5)
    del kept
    assert here() == before


def test_equal_requests_have_equal_digests() -> None:
    def request(frame: str, size: int = 9000) -> Request:
        array = np.arange(size, dtype=np.float32)
        return Request(
            "draw", ("".join(["a", "b"]), frame, MapQuery(), TileAddress(1001, 0, 0, 0), array)
        )

    assert request("one").digest == request("one").digest
    assert request("one").digest != request("two").digest
    assert request("one").digest != request("one", 9001).digest
    assert request("one").number != request("one").number


def answering(far: socket.socket, answer: Any) -> threading.Thread:
    """Answers every call of a line with the same value, as the process does."""

    def answer_all() -> None:
        room = None
        while (message := receive(far, descriptors=True)) is not None:
            packed = pack(answer)
            while True:
                descriptors = list(message.descriptors)
                if message.room:
                    room = mapped(descriptors[-1], message.room)
                close_all(descriptors)
                if packed.nbytes <= (0 if room is None else len(room)):
                    break
                send(far, Message(room=packed.nbytes))
                message = receive(far, descriptors=True)  # type: ignore[assignment]
            if room is not None:
                packed.write(room)
            send(far, Message(packed.body, packed.sizes))
        far.close()

    thread = threading.Thread(target=answer_all)
    thread.start()
    return thread


@pytest.mark.parametrize("expected", [0, 400_000])
def test_a_line_is_free_when_its_answer_is_forgotten(expected: int) -> None:
    made: list[threading.Thread] = []
    sent = np.arange(100_000, dtype=np.float32)

    def connect() -> Line:
        near, far = socket.socketpair()
        made.append(answering(far, sent))
        return Line(near)

    lines = Lines(connect)
    first = lines.ask(pack("a"), expected)
    row = first[10:20]  # what is left of an answer holds it
    del first
    second = lines.ask(pack("b"), expected)
    assert len(made) == 2
    assert row.tolist() == sent[10:20].tolist()
    assert second.tolist() == sent.tolist()
    del row, second
    gc.collect()
    lines.ask(pack("c"), expected)
    assert len(made) == 2
    lines.close()
    for thread in made:
        thread.join()


def test_a_call_that_nobody_waits_for_hangs_up() -> None:
    near, far = socket.socketpair()
    lines = Lines(lambda: Line(near))
    with far, wanted.unless(lambda: True), pytest.raises(CancelledError):
        lines.ask(pack("a"))
    assert near.fileno() < 0


def test_an_upload_with_everything_comes_over() -> None:
    mesh, maps = sheet(), {1001: np.ones((16, 16), np.float32)}
    frames = np.stack([mesh.positions] * 2)
    stiffness, controls = Stiffness(maps), Controls({"density": maps})
    new = NewAsset(
        mesh,
        settings_of(),
        graph=random_graph(1),
        frames=frames,
        stiffness=stiffness,
        controls=controls,
        shapes=Expressions(frames, ("one", "two")),
    )
    packed = pack(new)
    memory = shared(packed.nbytes) if packed.nbytes else None
    if memory is not None:
        packed.write(memory)
    found = unpack(packed.body, packed.sizes, memory)
    assert pack(found).body == packed.body
    assert found.frames.tobytes() == frames.tobytes()
    assert found.settings == new.settings
    assert isinstance(found.stiffness, Stiffness)
    assert found.stiffness.maps[1001].tobytes() == stiffness.maps[1001].tobytes()
    assert found.controls.maps.keys() == controls.maps.keys()
    assert unpack(pack(MappingProxyType({1: 2})).body, (), None) == {1: 2}
    assert found.shapes is not None
    assert found.shapes.names == ("one", "two")


def test_a_high_descriptor_can_be_waited_for() -> None:
    """A server with many connections has descriptors above 1023."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
    near, far = socket.socketpair()
    try:
        with near, far, socket.socket(fileno=os.dup2(near.fileno(), 1999)) as high:
            assert not readable(high, 0)
            far.send(b"!")
            assert readable(high, 5)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
