"""API keys, and the file that keeps them: JSON that is read and written whole.

A key is `rhytid_ID_SECRET`: the id finds it, the secret proves it. The secret is 256 random bits,
not a password: nobody guesses it, so one pass of SHA-256 is enough to keep it by.

The file has digests alone, so that a reader of it gains no key; whoever can write it makes keys. It
is written for its owner alone, and refused where others may write it.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from rhytid.errors import AccessError, StorageError
from rhytid.storage.lock import FileLock
from rhytid.support.atomic_files import install, storage_errors

READ, COMPUTE, ADMIN = SCOPES = ("read", "compute", "admin")
# A digest to compare a secret with where no key has its id.
_NOBODY = "0" * 64
_KEY = re.compile(rb"rhytid_([0-9a-f]{8})_([A-Za-z0-9_-]{43})")
FORMAT = 1
# Bytes: some 40,000 keys.
LARGEST = 1 << 24
_MARKED = (
    "API keys were asked for here: without their file the server starts only with --without-keys. "
    "Remove this file to go back to a server that has no keys.\n"
)


@dataclass(frozen=True)
class ApiKey:
    """An API key as it is kept, without its secret.

    scopes: some of `SCOPES`.  sha256: hexadecimal digest of the secret.  expires: None = never.
    rate: most requests per second.  jobs: most unfinished jobs. None for either = what the server
    allows everybody.
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
        """Whether the key has not expired."""
        return self.expires is None or now < self.expires


def new_key(
    name: str,
    scopes: Collection[str],
    expires: datetime | None = None,
    rate: int | None = None,
    jobs: int | None = None,
) -> tuple[str, ApiKey]:
    """Make a key; returns it in full, which is kept nowhere, and as it is to be kept."""
    id, secret = secrets.token_hex(4), secrets.token_urlsafe(32)
    created = utc_now().replace(microsecond=0)
    kept = ApiKey(id, name, frozenset(scopes), _digest(secret), created, expires, rate, jobs)
    return f"rhytid_{id}_{secret}", kept


def key_id(shown: bytes) -> str | None:
    """Return the id that a key claims, or None where it does not have the form of a key."""
    found = _KEY.fullmatch(shown)
    return None if found is None else found[1].decode()


def proves(shown: bytes, kept: ApiKey | None) -> bool:
    """Whether the secret of a shown key is the kept one. Takes as long where `kept` is None."""
    found = _KEY.fullmatch(shown)
    secret = "" if found is None else found[2].decode()
    same = hmac.compare_digest(_digest(secret), _NOBODY if kept is None else kept.sha256)
    return same and kept is not None


def utc_now() -> datetime:
    """The present time in UTC, with its zone."""
    return datetime.now(timezone.utc)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def read_keys(path: Path) -> list[ApiKey]:
    """Return the keys of a file in the order in which they were made.

    Raises FileNotFoundError where there is no file. Raises StorageError where the file cannot be
    read, is not one that `write_keys` wrote, is no plain file, or may be written by others than its
    owner.
    """
    try:
        with open(path, "rb", opener=_opened) as file:
            _check_kind(path, os.fstat(file.fileno()))
            data = file.read(LARGEST + 1)
    except FileNotFoundError:
        raise
    except OSError as exc:
        raise StorageError(f"the API keys cannot be read: {exc}") from exc
    if len(data) > LARGEST:
        raise StorageError(f"{path} has more than {LARGEST} bytes: not a file of API keys")
    try:
        return _parsed(json.loads(data))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as exc:
        raise StorageError(
            f"{path} is not a file of API keys: {type(exc).__name__}: {exc}"
        ) from exc


def has_valid_key(path: Path) -> bool:
    """Whether a key of the file is valid now; False where there is no file. Raises StorageError
    where the file cannot be read."""
    with suppress(FileNotFoundError):
        return any(key.valid(utc_now()) for key in read_keys(path))
    return False


def write_keys(path: Path, keys: list[ApiKey]) -> None:
    """Replace the keys of a file by these, atomically; raises StorageError."""
    text = json.dumps({"format": FORMAT, "keys": [_as_json(key) for key in keys]}, indent=2) + "\n"
    with storage_errors("the API keys cannot be written"):
        # Such a file is its owner's alone from the start.
        descriptor, aside = tempfile.mkstemp(prefix=".keys-", dir=path.parent)
        try:
            with open(descriptor, "wb") as file:
                file.write(text.encode())
                file.flush()
                os.fsync(descriptor)
            _give_away(Path(aside), path.parent)
            install(Path(aside), path)
        except BaseException:
            with suppress(OSError):
                Path(aside).unlink()
            raise


@contextmanager
def changing(path: Path) -> Iterator[list[ApiKey]]:
    """Change the keys of a file: the block changes the list, which is written when it ends. The
    list is empty where there is no file.

    Raises StorageError where another process changes the file at the same time, and what
    `read_keys` and `write_keys` raise.
    """
    with storage_errors("the API keys cannot be written"):
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path.with_name(f"{path.name}.lock"), f"{path} is being changed: try again")
    try:
        keys: list[ApiKey] = []
        with suppress(FileNotFoundError):
            keys = read_keys(path)
        yield keys
        write_keys(path, keys)
    finally:
        lock.release()


def leave_mark(mark: Path) -> None:
    """Make the file, where it is not there, which says that keys were asked for beside it: see
    `check_mark`. Raises StorageError."""
    with storage_errors(f"{mark} cannot be written"), suppress(FileExistsError):
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        with open(os.open(mark, flags, 0o600), "w", encoding="utf-8") as file:
            file.write(_MARKED)
            file.flush()
            os.fsync(file.fileno())
        _give_away(mark, mark.parent)


def check_mark(path: Path, mark: Path) -> None:
    """Raise AccessError where the file of the keys is gone although the mark says that there was
    one: nobody would be asked for a key."""
    if mark.exists() and not path.exists():
        raise AccessError(
            f"API keys were asked for here ({mark}), and {path} is gone: put it back, make a key "
            "with `rhytid keys create NAME`, or give --without-keys"
        )


def _opened(path: str, flags: int) -> int:
    """Open the file without waiting for a writer, should it be a named pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _check_kind(path: Path, found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise StorageError(f"{path} is not a plain file")
    others = stat.S_IWGRP | stat.S_IWOTH
    if os.name != "nt" and stat.S_IMODE(found.st_mode) & others:
        raise StorageError(f"{path} may be written by others than its owner: chmod 600 {path}")


def _give_away(file: Path, folder: Path) -> None:
    """Give the file to the owner of the folder, where root makes keys for a server that runs as
    another user."""
    if os.name != "nt" and os.geteuid() == 0:
        owner = folder.stat()
        os.chown(file, owner.st_uid, owner.st_gid)


def _parsed(document: Any) -> list[ApiKey]:
    if document["format"] != FORMAT:
        raise ValueError(f"format {document['format']!r}: {FORMAT} is known here")
    keys = [_key(row) for row in document["keys"]]
    if len({key.id for key in keys}) < len(keys) or len({key.name for key in keys}) < len(keys):
        raise ValueError("two keys have the same name or id")
    return keys


def _key(row: dict[str, Any]) -> ApiKey:
    key = ApiKey(
        str(row["id"]),
        str(row["name"]),
        frozenset(row["scopes"]),
        str(row["sha256"]),
        _time(row["created"]),
        None if row.get("expires") is None else _time(row["expires"]),
        _count(row, "rate"),
        _count(row, "jobs"),
    )
    if not key.scopes <= set(SCOPES):
        raise ValueError(f"key {key.name!r} has scopes {sorted(key.scopes)}: of {SCOPES}")
    return key


def _time(text: str) -> datetime:
    found = datetime.fromisoformat(text)
    if found.tzinfo is None:
        raise ValueError(f"{text!r} names no time zone")
    return found


def _count(row: dict[str, Any], name: str) -> int | None:
    value = row.get(name)
    if value is not None and (not isinstance(value, int) or value < 1):
        raise ValueError(f"{name} is {value!r}: must be a whole number above 0")
    return value


def _as_json(key: ApiKey) -> dict[str, Any]:
    return {
        "id": key.id,
        "name": key.name,
        "scopes": [scope for scope in SCOPES if scope in key.scopes],
        "sha256": key.sha256,
        "created": key.created.isoformat(),
        "expires": None if key.expires is None else key.expires.isoformat(),
        "rate": key.rate,
        "jobs": key.jobs,
    }
