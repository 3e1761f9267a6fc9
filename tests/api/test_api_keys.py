"""API keys: what is kept of them, in a file that its owner alone may change."""

from __future__ import annotations

import json
import stat
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from rhytid.api.keys import (
    SCOPES,
    changing,
    key_id,
    new_key,
    proves,
    read_keys,
    utc_now,
    write_keys,
)
from rhytid.errors import StorageError


def test_a_key_proves_itself_and_no_other() -> None:
    shown, kept = new_key("farm", {"read"})
    other, _ = new_key("farm", {"read"})
    assert key_id(shown.encode()) == kept.id
    assert proves(shown.encode(), kept)
    swapped = f"rhytid_{kept.id}_{other.rpartition(f'rhytid_{key_id(other.encode())}_')[2]}"
    for wrong in (
        other,
        swapped,
        shown[:-1],
        shown + "A",
        shown.upper(),
        "",
        "rhytid_",
        kept.sha256,
    ):
        assert not proves(wrong.encode(), kept), wrong
    assert not proves(shown.encode(), None)


def test_secrets_are_compared_in_constant_time(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[tuple[str, str]] = []

    def compare(one: str, other: str) -> bool:
        compared.append((one, other))
        return one == other

    monkeypatch.setattr("rhytid.api.keys.hmac.compare_digest", compare)
    shown, kept = new_key("farm", {"read"})
    assert proves(shown.encode(), kept)
    assert not proves(shown.encode(), None)
    # An unknown id costs the same comparison.
    assert [one for one, _ in compared] == [kept.sha256, kept.sha256]


def test_a_file_holds_what_was_written_and_no_secret(tmp_path: Path) -> None:
    file = tmp_path / "keys.json"
    expires = utc_now() + timedelta(days=3)
    shown, one = new_key("farm", {"read"}, expires, rate=5, jobs=2)
    _, two = new_key("artist", SCOPES)
    with changing(file) as keys:
        keys += [one, two]
    assert read_keys(file) == [one, two]
    assert shown.rpartition("_")[2] not in file.read_text()
    assert shown[16:] not in file.read_text()


def test_a_file_is_its_owners_alone(tmp_path: Path) -> None:
    file = tmp_path / "keys.json"
    for _ in range(2):  # a second time in place of the first
        write_keys(file, [])
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert [left.name for left in tmp_path.iterdir()] == ["keys.json"]


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_a_file_that_others_may_write_is_refused(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "keys.json"
    write_keys(file, [])
    file.chmod(mode)
    with pytest.raises(StorageError, match=r"written by others.*: chmod 600"):
        read_keys(file)
    file.chmod(0o444)  # as a secret of a container is mounted
    assert read_keys(file) == []


def changed(**changes: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document["keys"][0].update(changes)


DAMAGES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "format": lambda document: document.update(format=2),
    "no keys": lambda document: document.pop("keys"),
    "twice": lambda document: document["keys"].append(document["keys"][0]),
    "scope": changed(scopes=["read", "everything"]),
    "time": changed(expires="2999-01-01T00:00:00"),
    "no time": changed(created=None),
    "rate": changed(rate=0),
    "jobs": changed(jobs="many"),
    "row": lambda document: document["keys"].append(3),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_refused(tmp_path: Path, damage: str) -> None:
    file = tmp_path / "keys.json"
    write_keys(file, [new_key("farm", {"read"})[1]])
    document = json.loads(file.read_text())
    DAMAGES[damage](document)
    file.write_text(json.dumps(document))
    with pytest.raises(StorageError, match="is not a file of API keys"):
        read_keys(file)


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff", b"[" * 100_000])
def test_what_is_no_file_of_keys_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "keys.json"
    file.write_bytes(content)
    file.chmod(0o600)
    with pytest.raises(StorageError, match="is not a file of API keys"):
        read_keys(file)


def test_two_changes_at_a_time_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "keys.json"
    with changing(file) as keys:
        with pytest.raises(StorageError, match="is being changed"), changing(file):
            pass
        keys.append(new_key("farm", {"read"})[1])
    assert [key.name for key in read_keys(file)] == ["farm"]


def test_a_change_that_fails_leaves_the_file(tmp_path: Path) -> None:
    file = tmp_path / "keys.json"
    write_keys(file, [new_key("farm", {"read"})[1]])
    before = file.read_bytes()

    def forget() -> None:
        with changing(file) as keys:
            keys.clear()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        forget()
    assert file.read_bytes() == before
