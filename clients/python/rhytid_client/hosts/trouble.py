"""What is wrong, in the words that the user of a host application reads."""

from __future__ import annotations

from rhytid_client.errors import (
    BadAnswer,
    ConnectionFailed,
    NotAllowed,
    NotFound,
    ProblemError,
)


class Trouble(Exception):
    """Something that the user can mend; its text says what and how."""


NOT_SENT = "Send the mesh first"


def changed_count(name: str, sent: int, found: int) -> str:
    """The vertices are no longer those that were sent; how to mend it is for the host to say."""
    return f"'{name}' has {found} vertices, {sent} were sent: "


def no_answer(url: str, why: object) -> str:
    """Nobody answered."""
    return f"No answer from {url}: start it with 'rhytid serve', or set another address ({why})"


def no_uv(name: str) -> str:
    """Displacement has nowhere to be."""
    return f"'{name}' has no UV map: unwrap it, for displacement is drawn in UV"


def message_of(exc: Exception, url: str) -> str:
    """An error of the client, as the user reads it.  url: of the server."""
    if isinstance(exc, ConnectionFailed):
        return no_answer(url, exc.__cause__)
    if isinstance(exc, BadAnswer):
        return f"{url} answers, but not as a rhytid server does: {exc}"
    if isinstance(exc, NotFound):
        return f"The server does not have it: {exc.detail}. Send the mesh again"
    if isinstance(exc, NotAllowed) and exc.status == 401:
        return f"{url} asks for a valid key (401): enter one as 'rhytid keys create' printed it"
    if isinstance(exc, NotAllowed):
        return f"The server refuses the key ({exc.status}): {exc.detail}"
    if isinstance(exc, ProblemError):
        return exc.detail or str(exc)
    return str(exc)
