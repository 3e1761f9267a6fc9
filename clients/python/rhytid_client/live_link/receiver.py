"""Takes packets of Live Link Face from a socket, the newest first and the others not at all."""

from __future__ import annotations

import socket
import time
from types import TracebackType

from rhytid_client.live_link.packet import FaceFrame, read_packet

# Where the app sends to unless another port is set there.
PORT = 11111
_LARGEST = 2048
# Packets that are read in one go before the newest is used.
_MOST = 10_000
# A packet so many seconds older than one before came late; one that is older still is of a clock
# that was set anew.
_LATE = 1.0
_USUAL_RATE = 60.0


class FaceReceiver:
    """Listens for the packets of one face.

    subject: of whom; None = of whom the first packet is.  skipped: packets that were overtaken by
    newer ones.  refused: packets that are none of Live Link Face, and why the last of them is not.
    """

    def __init__(self, host: str = "", port: int = PORT, subject: str | None = None) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except BaseException:
            self._socket.close()
            raise
        self._subject, self._source = subject, ""
        self._last: FaceFrame | None = None
        self.skipped, self.refused, self.reason = 0, 0, ""

    @property
    def port(self) -> int:
        """Where it listens."""
        found: int = self._socket.getsockname()[1]
        return found

    def __enter__(self) -> FaceReceiver:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()

    def newest(self, timeout: float | None = None) -> FaceFrame | None:
        """The newest face that came since the last call; waits for one. None where none came in
        `timeout` seconds."""
        until = None if timeout is None else time.monotonic() + timeout
        newest = None
        for _ in range(_MOST):
            packet = self._packet(0.0 if newest is not None else _left(until))
            if packet is None:
                break
            found = self._face(packet)
            if found is not None:
                self.skipped += newest is not None
                newest = found
        return newest

    def _packet(self, timeout: float | None) -> bytes | None:
        """None where none came in time."""
        self._socket.settimeout(timeout)
        try:
            return self._socket.recv(_LARGEST)
        except (TimeoutError, BlockingIOError):
            return None

    def _face(self, packet: bytes) -> FaceFrame | None:
        """What a packet has; None for one that is not used."""
        try:
            face = read_packet(packet)
        except ValueError as exc:
            self.refused, self.reason = self.refused + 1, str(exc)
            return None
        return face if face is not None and self._wanted(face) else None

    def _wanted(self, face: FaceFrame) -> bool:
        if self._subject not in (None, face.subject):
            return False
        self._source = self._source or face.device
        if face.device != self._source:
            return False
        last = self._last
        if last is not None and 0.0 < last.frame - face.frame < _LATE * (face.rate or _USUAL_RATE):
            return False
        self._last = face
        return True


def _left(until: float | None) -> float | None:
    return None if until is None else max(until - time.monotonic(), 0.0)
