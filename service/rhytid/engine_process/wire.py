"""Messages over a Unix socket: a head, sizes of arrays, a pickle; descriptors of shared memory go
beside them.

On a line one side asks and the other answers; on the control socket both send messages.
"""

from __future__ import annotations

import array
import os
import select
import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass

# Bytes of the pickle, number of arrays, bytes of shared memory with the arrays, bytes of room for
# an answer. A descriptor goes with each of the two that is not 0, where one is needed.
_HEAD = struct.Struct("<IIQQ")
_PIECE = 1 << 20
_MOST_DESCRIPTORS = 3


@dataclass(frozen=True)
class Message:
    """One message as it is on the wire.

    shared: bytes of memory with the arrays.  room: of a message that asks, bytes of memory for the
    answer; of one that answers, bytes that the answer needs and does not have.
    """

    body: bytes = b""
    sizes: tuple[int, ...] = ()
    shared: int = 0
    room: int = 0
    descriptors: tuple[int, ...] = ()


def readable(line: socket.socket, seconds: float) -> bool:
    """Whether something comes, or the end, in that time. `select` has descriptors to 1023 alone."""
    poll = select.poll()
    poll.register(line, select.POLLIN)
    return bool(poll.poll(1000 * seconds))


def send(line: socket.socket, message: Message) -> None:
    """Send a message; its descriptors stay the caller's. Raises OSError on a broken line."""
    head = _HEAD.pack(len(message.body), len(message.sizes), message.shared, message.room)
    data = b"".join((head, struct.pack(f"<{len(message.sizes)}Q", *message.sizes), message.body))
    sent = 0
    if message.descriptors:
        sent = socket.send_fds(line, [data], list(message.descriptors))
    if sent < len(data):
        line.sendall(memoryview(data)[sent:])


def receive(line: socket.socket, *, descriptors: bool = False) -> Message | None:
    """The next message; None where the other side is gone.  descriptors: whether some may come with
    it, which are the caller's to close."""
    found: list[int] = []
    try:
        data = _head(line, found) if descriptors else bytearray(line.recv(_HEAD.size))
        if not data or not _filled(line, data, _HEAD.size):
            close_all(found)
            return None
        length, count, shared, room = _HEAD.unpack(data)
        rest = bytearray()
        if not _filled(line, rest, 8 * count + length):
            close_all(found)
            return None
    except ConnectionError:
        close_all(found)
        return None
    sizes = struct.unpack_from(f"<{count}Q", rest)
    return Message(bytes(memoryview(rest)[8 * count :]), sizes, shared, room, tuple(found))


def _head(line: socket.socket, found: list[int]) -> bytearray:
    """The head of a message, or its beginning, and the descriptors that come with it."""
    size = array.array("i").itemsize * _MOST_DESCRIPTORS
    data, beside, _, _ = line.recvmsg(_HEAD.size, socket.CMSG_SPACE(size))
    for _, _, content in beside:
        numbers = array.array("i")
        numbers.frombytes(content[: len(content) // numbers.itemsize * numbers.itemsize])
        found += numbers
    for descriptor in found:
        os.set_inheritable(descriptor, False)
    return bytearray(data)


def _filled(line: socket.socket, data: bytearray, size: int) -> bool:
    """Read on until there are so many bytes; False where the other side is gone."""
    while len(data) < size:
        more = line.recv(min(size - len(data), _PIECE))
        if not more:
            return False
        data += more
    return True


def close_all(descriptors: Sequence[int]) -> None:
    """Close descriptors."""
    for descriptor in descriptors:
        os.close(descriptor)
