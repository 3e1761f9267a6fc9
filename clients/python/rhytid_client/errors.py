"""Everything that the client raises on purpose, and what it warns with.

::

    RhytidError
    ├── ProblemError          the server refused; .status .title .detail .type .warnings
    │   ├── RequestError      4xx: what was asked is wrong
    │   │   ├── NotFound      404
    │   │   ├── Conflict      409
    │   │   │   └── NotReady  409 with Retry-After: the asset is still building
    │   │   ├── TooLarge      413
    │   │   ├── NotAllowed    401, 403: no valid API key, or one for other things
    │   │   └── TooMany       429: more than one caller may ask for
    │   └── ServerError       5xx
    │       └── ServerBusy    503 with Retry-After: the queue is full
    ├── ConnectionFailed      no answer; the error of the transport is its __cause__
    ├── LiveClosed            a live connection ended; .code .reason
    ├── BadAnswer             an answer that cannot be read
    ├── JobFailed             .job
    ├── JobCancelled          .job
    └── Timeout               the time given to `wait` is over; .job

    RhytidWarning             a warning of Python's: what was sent is probably wrong
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rhytid_client.results import InputWarning, Job


class RhytidWarning(UserWarning):
    """What was sent can be used and is probably wrong; the text names what and where.

    `warnings.simplefilter("error", RhytidWarning)` makes it an exception; `strict=True` has the
    server refuse it.
    """


class RhytidError(Exception):
    """Base of every deliberate error."""


class ProblemError(RhytidError):
    """The server refused, with problem details (RFC 9457).

    `detail` says what is wrong and where; `type` is the kind as a URI; `call` is the method and
    path that were asked; `retry_after` is in seconds, where the server gave it; `warnings` is what
    `strict` refused; `request_id` is what the server's log calls the request.
    """

    def __init__(
        self,
        status: int,
        title: str,
        detail: str,
        type: str = "about:blank",
        call: str = "",
        retry_after: float | None = None,
        warnings: tuple[InputWarning, ...] = (),
        request_id: str = "",
    ) -> None:
        super().__init__(f"{status} {title}: {detail} [{call}]")
        self.status = status
        self.title = title
        self.detail = detail
        self.type = type
        self.call = call
        self.retry_after = retry_after
        self.warnings = warnings
        self.request_id = request_id


class RequestError(ProblemError):
    """What was asked is wrong, or not possible now (4xx)."""


class NotFound(RequestError):
    """No such asset, frame, job, UDIM or tile."""


class Conflict(RequestError):
    """Right, but not in the present state."""


class NotReady(Conflict):
    """The asset is still building; `retry_after` says when to ask again."""


class TooLarge(RequestError):
    """Larger than the server allows."""


class NotAllowed(RequestError):
    """No API key that is valid (401), or one without the scope that this needs (403)."""


class TooMany(RequestError):
    """More than one caller may ask for; nothing was done; `retry_after` says when to ask again."""


class ServerError(ProblemError):
    """The server failed (5xx)."""


class ServerBusy(ServerError):
    """The server's queue is full; nothing was done; `retry_after` says when to ask again."""


class ConnectionFailed(RhytidError):
    """No answer came; `__cause__` is the error of httpx or of Python's own HTTP."""


class LiveClosed(RhytidError):
    """A live connection ended. `code` is that of WebSocket, 1006 where none came; docs/live.md
    lists those of the server; `reason` is in its words."""

    def __init__(self, code: int, reason: str = "", call: str = "") -> None:
        super().__init__(f"{code} {reason or 'the connection ended'} [{call}]")
        self.code = code
        self.reason = reason


class BadAnswer(RhytidError):
    """The server's answer cannot be read: not this service, or another version of it."""


class _JobError(RhytidError):
    def __init__(self, message: str, job: Job | None = None) -> None:
        super().__init__(message)
        self.job = job


class JobFailed(_JobError):
    """The job, or the build of the asset, failed; the message has the server's reason."""


class JobCancelled(_JobError):
    """The job was cancelled."""


class Timeout(_JobError):
    """The job did not end in the time given; it goes on."""
