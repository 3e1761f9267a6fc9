"""The keys as a server knows them, while their file comes, changes and goes."""

from __future__ import annotations

import logging
from datetime import timedelta
from pathlib import Path

import pytest

from rhytid.access.api_key import ApiKey, new_key, utc_now
from rhytid.access.key_file import write_keys
from rhytid.access.key_ring import KeyRing
from rhytid.errors import StorageError


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "keys.json"


@pytest.fixture
def ring(file: Path) -> KeyRing:
    """One that looks at its file every time."""
    return KeyRing(file, every=0.0)


def found(ring: KeyRing, shown: str) -> str | None:
    key = ring.find(shown.encode())
    return None if key is None else key.name


def farm() -> tuple[str, ApiKey]:
    return new_key("farm", {"read"})


def test_a_key_is_asked_for_as_soon_as_there_is_a_file(file: Path, ring: KeyRing) -> None:
    shown, key = farm()
    assert not ring.asked
    write_keys(file, [key])
    assert ring.asked
    assert found(ring, shown) == "farm"


def test_a_revoked_key_is_not_valid_and_one_is_still_asked_for(file: Path, ring: KeyRing) -> None:
    (shown, key), (other, left) = farm(), new_key("artist", {"read"})
    write_keys(file, [key, left])
    assert found(ring, shown) == "farm"
    write_keys(file, [left])
    assert (found(ring, shown), found(ring, other)) == (None, "artist")
    write_keys(file, [])
    assert (ring.asked, found(ring, other)) == (True, None)


def test_a_file_that_is_gone_lets_nobody_in(file: Path, ring: KeyRing) -> None:
    shown, key = farm()
    write_keys(file, [key])
    assert found(ring, shown) == "farm"
    file.unlink()
    assert (ring.asked, found(ring, shown)) == (True, None)


def test_one_may_be_asked_for_before_there_is_a_file(file: Path) -> None:
    ring = KeyRing(file, asked=True)
    assert (ring.asked, found(ring, farm()[0])) == (True, None)


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
        assert ring.asked
        with pytest.raises(StorageError, match="cannot be read"):
            found(ring, shown)
    (record,) = caplog.records
    assert (record.levelno, "nobody is let in" in record.getMessage()) == (logging.ERROR, True)
    write_keys(file, [key])
    assert found(ring, shown) == "farm"


def test_a_folder_that_cannot_be_looked_into_lets_nobody_in(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    ring = KeyRing(tmp_path / "file" / "keys.json", every=0.0)
    assert ring.asked
    with pytest.raises(StorageError):
        found(ring, farm()[0])


def test_a_folder_that_turns_bad_lets_nobody_in(tmp_path: Path) -> None:
    ring = KeyRing(tmp_path / "folder" / "keys.json", every=0.0)
    assert not ring.asked
    (tmp_path / "folder").touch()
    assert ring.asked


def test_the_file_is_not_looked_at_for_every_request(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr("rhytid.access.key_ring.time.monotonic", lambda: now)
    shown, key = farm()
    write_keys(file, [key])
    ring = KeyRing(file, every=1.0)
    assert found(ring, shown) == "farm"
    write_keys(file, [])
    now = 100.9
    assert found(ring, shown) == "farm"
    now = 101.0
    assert found(ring, shown) is None
