"""The keys as a server knows them, while their file comes, changes and goes."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

import pytest

from rhytid.api import access
from rhytid.api.access import KeyRing
from rhytid.api.keys import ApiKey, new_key, read_keys, utc_now, write_keys
from rhytid.errors import StorageError


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "keys.json"


@pytest.fixture
def ring(file: Path) -> KeyRing:
    """One that looks at its file every time."""
    return KeyRing(file, every=0.0)


def asked(ring: KeyRing) -> bool:
    ring.look()
    return ring.asked


def found(ring: KeyRing, shown: str) -> str | None:
    ring.look()
    key = ring.find(shown.encode())
    return None if key is None else key.name


def farm() -> tuple[str, ApiKey]:
    return new_key("farm", {"read"})


def test_a_key_is_asked_for_as_soon_as_there_is_a_file(file: Path, ring: KeyRing) -> None:
    shown, key = farm()
    assert not asked(ring)
    write_keys(file, [key])
    assert asked(ring)
    assert found(ring, shown) == "farm"


def test_a_revoked_key_is_not_valid_and_one_is_still_asked_for(file: Path, ring: KeyRing) -> None:
    (shown, key), (other, left) = farm(), new_key("artist", {"read"})
    write_keys(file, [key, left])
    assert found(ring, shown) == "farm"
    write_keys(file, [left])
    assert (found(ring, shown), found(ring, other)) == (None, "artist")
    write_keys(file, [])
    assert (asked(ring), found(ring, other)) == (True, None)


def test_a_file_that_is_gone_lets_nobody_in(file: Path, ring: KeyRing) -> None:
    shown, key = farm()
    write_keys(file, [key])
    assert found(ring, shown) == "farm"
    file.unlink()
    assert (asked(ring), found(ring, shown)) == (True, None)


def test_one_may_be_asked_for_before_there_is_a_file(file: Path) -> None:
    ring = KeyRing(file, asked=True)
    assert (asked(ring), found(ring, farm()[0])) == (True, None)


def test_an_expired_key_is_not_valid(file: Path, ring: KeyRing) -> None:
    hour = timedelta(hours=1)
    old, over = new_key("old", {"read"}, utc_now() - hour)
    new, lasting = new_key("new", {"read"}, utc_now() + hour)
    write_keys(file, [over, lasting])
    assert (found(ring, old), found(ring, new)) == (None, "new")


def test_a_file_that_cannot_be_read_lets_nobody_in_and_is_told_once(
    file: Path, ring: KeyRing, caplog: pytest.LogCaptureFixture
) -> None:
    shown, key = farm()
    write_keys(file, [key])
    assert found(ring, shown) == "farm"
    file.write_text("{")
    for _ in range(3):
        assert asked(ring)
        with pytest.raises(StorageError, match="cannot be read"):
            found(ring, shown)
    (record,) = caplog.records
    assert (record.levelno, "nobody is let in" in record.getMessage()) == (logging.ERROR, True)
    write_keys(file, [key])
    assert found(ring, shown) == "farm"


def test_a_folder_that_cannot_be_looked_into_lets_nobody_in(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    ring = KeyRing(tmp_path / "file" / "keys.json", every=0.0)
    assert asked(ring)
    with pytest.raises(StorageError):
        found(ring, farm()[0])


def test_a_folder_that_turns_bad_lets_nobody_in(tmp_path: Path) -> None:
    ring = KeyRing(tmp_path / "folder" / "keys.json", every=0.0)
    assert not asked(ring)
    (tmp_path / "folder").touch()
    assert asked(ring)


def test_the_file_is_not_looked_at_for_every_request(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr("rhytid.api.access.time.monotonic", lambda: now)
    shown, key = farm()
    write_keys(file, [key])
    ring = KeyRing(file, every=1.0)
    assert found(ring, shown) == "farm"
    write_keys(file, [])
    now = 100.9
    assert found(ring, shown) == "farm"
    now = 101.0
    assert found(ring, shown) is None


def test_who_waits_for_a_look_does_not_hold_the_event_loop(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a file system that hangs: nobody is let in until it answers."""
    shown, key = farm()
    write_keys(file, [key])
    go, reading = threading.Event(), threading.Event()

    def hang(path: Path) -> list[ApiKey]:
        reading.set()
        assert go.wait(60)
        return read_keys(path)

    monkeypatch.setattr(access, "read_keys", hang)

    async def asking() -> None:
        ring = KeyRing(file, every=0.0, patience=0.2)
        waiting = asyncio.create_task(ring.refresh())
        while not reading.is_set():
            await asyncio.sleep(0.01)
        assert not waiting.done()
        await waiting
        assert ring.asked
        for _ in range(3):  # and the others do not wait as long again
            await ring.refresh()
            with pytest.raises(StorageError, match="cannot be read"):
                ring.find(shown.encode())
        assert len([one for one in threading.enumerate() if one.name == "rhytid-keys"]) == 1
        go.set()
        key = None
        while key is None:
            await asyncio.sleep(0.01)
            await ring.refresh()
            with suppress(StorageError):
                key = ring.find(shown.encode())

    asyncio.run(asking())


def test_a_named_pipe_is_no_file_of_keys(file: Path, ring: KeyRing) -> None:
    os.mkfifo(file, 0o600)
    look = threading.Thread(target=ring.look)
    look.start()
    look.join(10)
    if waits := look.is_alive():
        os.close(os.open(file, os.O_WRONLY | os.O_NONBLOCK))
        look.join()
    assert not waits
    assert ring.asked
    with pytest.raises(StorageError):
        ring.find(b"")


def test_a_mark_is_left_once_there_were_keys(file: Path, tmp_path: Path) -> None:
    mark = tmp_path / "store" / "keys.json.asked"
    ring = KeyRing(file, every=0.0, mark=mark)
    assert not asked(ring)
    write_keys(file, [])
    assert asked(ring)
    assert not mark.parent.exists()  # it is not made for the mark
    mark.parent.mkdir()
    write_keys(file, [farm()[1]])
    assert asked(ring)
    assert mark.stat().st_mode & 0o777 == 0o600
