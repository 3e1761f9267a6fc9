"""One API key: what is kept of it, and how it is made.

A key is `rhytid_ID_SECRET`: the id finds it, the secret proves it. The secret is 256 random bits,
not a password: nobody guesses it, so one pass of SHA-256 is enough to keep it by.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime, timezone

READ, COMPUTE, ADMIN = SCOPES = ("read", "compute", "admin")
# What the secret of a key that there is not is compared with.
_NOBODY = "0" * 64
_KEY = re.compile(rb"rhytid_([0-9a-f]{8})_([A-Za-z0-9_-]{43})")


@dataclass(frozen=True)
class ApiKey:
    """What is kept of a key.

    scopes: of `SCOPES`.  sha256: of the secret, hexadecimal.  expires: None = never.  rate: most
    requests per second, jobs: most unfinished jobs; None = what the server allows everybody.
    """

    id: str
    name: str
    scopes: frozenset[str]
    sha256: str
    created: datetime
    expires: datetime | None = None
    rate: int | None = None
    jobs: int | None = None

    def valid(self, now: datetime) -> bool:
        """Whether it has not expired."""
        return self.expires is None or now < self.expires


def new_key(
    name: str,
    scopes: Collection[str],
    expires: datetime | None = None,
    rate: int | None = None,
    jobs: int | None = None,
) -> tuple[str, ApiKey]:
    """A new key in full, which is kept nowhere, and what is kept of it."""
    id, secret = secrets.token_hex(4), secrets.token_urlsafe(32)
    created = utc_now().replace(microsecond=0)
    kept = ApiKey(id, name, frozenset(scopes), _digest(secret), created, expires, rate, jobs)
    return f"rhytid_{id}_{secret}", kept


def key_id(shown: bytes) -> str | None:
    """The id that a key claims; None where it does not have the form of one."""
    found = _KEY.fullmatch(shown)
    return None if found is None else found[1].decode()


def proves(shown: bytes, kept: ApiKey | None) -> bool:
    """Whether the secret of a key is the one that was kept; takes as long where there is none."""
    found = _KEY.fullmatch(shown)
    secret = "" if found is None else found[2].decode()
    same = hmac.compare_digest(_digest(secret), _NOBODY if kept is None else kept.sha256)
    return same and kept is not None


def utc_now() -> datetime:
    """The present time, with its zone."""
    return datetime.now(timezone.utc)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
