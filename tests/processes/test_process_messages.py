"""Messages between the server and the process: values, large arrays, descriptors, errors."""

from __future__ import annotations

import gc
import os
import resource
import threading
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
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
from rhytid.engine import call_context
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import CancelledError, HostBusyError, NotFoundError, RhytidError, StrictError
from rhytid.processes.envelope import Request
from rhytid.processes.lines import Line, Lines
from rhytid.processes.packing import (
    APART,
    handed_on,
    mapped,
    pack,
    private,
    shared_file,
    unpack,
)
from rhytid.processes.wire import (
    Close,
    Control,
    Message,
    close_all,
    readable,
    receive,
    send,
)
from rhytid.storage.snapshots import OpenFile

DRAW = OPERATIONS["tiles.draw"]
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
    name, found = unpack(packed.body, packed.places, memory)
    assert name == "name"
    assert [one.tobytes() for one in found] == [one.tobytes() for one in arrays]
    assert len(packed.places) == sum(size >= APART for size in sizes)


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


def test_arrays_that_lie_in_a_file_are_sent_on_in_it() -> None:
    """What the decoder has written goes to the process of the device without a copy."""
    first, second = np.arange(9000.0), np.arange(20_000.0)[::-1].copy()
    packed = pack((first, second))
    descriptor = shared_file(packed.nbytes)
    packed.write_file(descriptor)
    kept = handed_on(descriptor, packed.nbytes)
    os.close(descriptor)
    value = unpack(packed.body, packed.places, kept)
    assert not any(array.flags.writeable for array in value), "else other bytes would be sent"
    part = pack((value[1], "and what is small"))
    near, far = Pipe()
    with near, far:
        open_before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        threading.Thread(target=lambda: answer_once(far)).start()
        found, _ = Line(near).ask(part, None)
        assert found[0].tobytes() == second.tobytes()
        assert part.memory is None
    assert pack((value[0], np.ones(9000))).kept_file() is None
    del kept, value, part, packed, found
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) < open_before  # noqa: PTH208


def answer_once(far: Connection) -> None:
    """Answer a call with what it sends, in the memory that it came in."""
    message = receive(far)
    assert message is not None
    memory = private(message.descriptors[0], message.shared)
    value = unpack(message.body, message.places, memory)
    close_all(message.descriptors)
    packed = pack(value)
    send(far, Message(room=packed.nbytes))
    offer = receive(far)
    assert offer is not None
    packed.write(mapped(offer.descriptors[0], offer.room))
    close_all(offer.descriptors)
    send(far, Message(packed.body, packed.places))


def test_a_message_has_few_descriptors() -> None:
    """A decoder that strangers' bytes have taken over cannot use up those of the server."""
    near, far = Pipe()
    with near, far, Path("/dev/null").open("rb") as file:
        sent = (file.fileno(),) * 2
        send(far, Message(b"a", descriptors=sent))
        found = receive(near)
        assert found is not None
        assert len(found.descriptors) == 2
        close_all(found.descriptors)
        open_before = os.listdir("/proc/self/fd")  # noqa: PTH208
        send(far, Message(b"a", descriptors=(*sent, file.fileno())))
        assert receive(near) is None
        assert os.listdir("/proc/self/fd") == open_before  # noqa: PTH208


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
            DRAW, ("".join(["a", "b"]), frame, MapQuery(), TileAddress(1001, 0, 0, 0), array)
        )

    assert request("one").digest == request("one").digest
    assert request("one").digest != request("two").digest
    assert request("one").digest != request("one", 9001).digest
    assert request("one").number != request("one").number


def test_calls_with_files_are_the_same_where_their_bytes_are(tmp_path: Path) -> None:
    digests = []
    for name, content in (("one", b"1" * 100), ("same", b"1" * 100), ("other", b"2" * 100)):
        (tmp_path / name).write_bytes(content)
        with (tmp_path / name).open("rb") as file:
            sent = (OpenFile(file.fileno()), 100)
            digests.append(Request(OPERATIONS["snapshots.restore"], sent).digest)
            assert file.read() == content, "its position is left alone"
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def answering(far: Connection, answer: Any) -> threading.Thread:
    """Answers every call of a line with the same value, as the process does."""

    def answer_all() -> None:
        room = None
        while (message := receive(far)) is not None:
            packed = pack(answer)
            while True:
                descriptors = list(message.descriptors)
                if message.room:
                    room = mapped(descriptors[-1], message.room)
                close_all(descriptors)
                if packed.nbytes <= (0 if room is None else len(room)):
                    break
                send(far, Message(room=packed.nbytes))
                message = receive(far)  # type: ignore[assignment]
            if room is not None:
                packed.write(room)
            send(far, Message(packed.body, packed.places))
        far.close()

    thread = threading.Thread(target=answer_all)
    thread.start()
    return thread


class Closing(Connection):
    """Stays a while between its end in the system and the moment that Python knows of it."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
        self.ended, self.goes_on = threading.Event(), threading.Event()

    def _close(self) -> None:
        os.close(self.fileno())
        self.ended.set()
        assert self.goes_on.wait(10)


def test_nothing_is_sent_on_a_connection_that_got_the_number_of_the_control() -> None:
    (near, far), (mine, others) = Pipe(), Pipe()
    line = Closing(os.dup(near.fileno()))
    number, control = line.fileno(), Control(line)
    closing = threading.Thread(target=control.close)
    closing.start()
    assert line.ended.wait(10)
    os.dup2(others.fileno(), number)  # as the system does by itself, sooner or later

    def send_late() -> None:
        with pytest.raises(OSError, match="closed"):
            control.send(Close())

    sending = threading.Thread(target=send_late)
    sending.start()
    sending.join(0.3)  # time to do what it must not
    line.goes_on.set()
    for thread in (closing, sending):
        thread.join(10)
        assert not thread.is_alive()
    assert not readable(mine, 0)
    for end in (near, far, mine, others):
        end.close()
    os.close(number)


def test_a_line_is_free_when_its_answer_is_forgotten() -> None:
    made: list[threading.Thread] = []
    sent = np.arange(100_000, dtype=np.float32)

    def connect() -> Line:
        near, far = Pipe()
        made.append(answering(far, sent))
        return Line(near)

    lines = Lines(connect)
    first = lines.ask(pack("a"))
    row = first[10:20]  # what is left of an answer holds it
    del first
    second = lines.ask(pack("b"))
    assert len(made) == 2
    assert row.tolist() == sent[10:20].tolist()
    assert second.tolist() == sent.tolist()
    del row, second
    gc.collect()
    lines.ask(pack("c"))
    assert len(made) == 2
    lines.close()
    for thread in made:
        thread.join()


def test_a_call_that_nobody_waits_for_hangs_up() -> None:
    near, far = Pipe()
    lines = Lines(lambda: Line(near))
    with far, call_context.abandoned_when(lambda: True), pytest.raises(CancelledError):
        lines.ask(pack("a"))
    assert near.closed


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
    found = unpack(packed.body, packed.places, memory)
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
    near, far = Pipe()
    try:
        with near, far, Connection(os.dup2(near.fileno(), 1999)) as high:
            assert not readable(high, 0)
            far.send_bytes(b"!")
            assert readable(high, 5)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
