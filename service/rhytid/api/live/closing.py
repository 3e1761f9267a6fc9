"""Why a live connection is closed: codes of WebSocket, which clients can act on."""

from __future__ import annotations

# Of RFC 6455. The server sends 1009 and 1012 by itself: a message above its limit, and its end.
INTERNAL = 1011
LATER = 1013
# Ours, near the status of HTTP that says the same.
BAD_MESSAGE = 4400
GONE = 4404
IDLE = 4408
ORDER = 4409
TOO_LARGE = 4413
# A close frame holds so many bytes, two of which are the code.
_LONGEST = 123

CODES = {
    1000: "the client is done",
    1001: "the client goes away",
    1009: "a message is larger than 1 MiB and than a frame of the asset, or than 16 MiB",
    INTERNAL: "the server failed, or a ping was not answered within 20 seconds",
    1012: "the server ends",
    LATER: "others hold the memory, or the device restarts; try again",
    BAD_MESSAGE: "a header, a view or a frame that is not as it must be; the reason names what",
    GONE: "the asset was deleted, or what was asked of it is not there",
    IDLE: "no header within 10 seconds, or nothing at all for 5 minutes",
    ORDER: "a frame number that is not larger than the one before",
    TOO_LARGE: "more tiles, texels or memory than one connection may have",
}


class LiveClosed(Exception):
    """The connection ends.  code: one of `CODES`.  reason: in words, for the client."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code

    @property
    def reason(self) -> str:
        """As much of it as a close frame holds."""
        return str(self).encode()[:_LONGEST].decode(errors="ignore")
