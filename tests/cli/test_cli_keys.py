"""`rhytid keys`, and `rhytid serve` where others reach it."""

from __future__ import annotations

import json
import signal
import socket
import stat
from contextlib import closing
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import httpx
import pytest

from cli.running import process, usage_error
from rhytid.api.keys import leave_mark, read_keys
from rhytid.api.server.listening import asks_keys, listen
from rhytid.cli import main
from rhytid.errors import AccessError, StorageError
from rhytid_client import NotAllowed, PlainClient


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of RHYTID_STORE, which is not there yet."""
    folder = tmp_path / "store"
    monkeypatch.setenv("RHYTID_STORE", str(folder))
    monkeypatch.delenv("RHYTID_KEYS_FILE", raising=False)
    return folder


def keys(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What `rhytid keys` prints."""
    assert main(["keys", *arguments]) == 0
    return capsys.readouterr().out


def test_a_key_is_made_shown_once_listed_and_revoked(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = keys(capsys, "create", "farm").strip()
    file = store / "keys.json"
    assert shown.startswith("rhytid_")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert shown[16:] not in file.read_text()
    limited = ["--expires", "90", "--rate", "50", "--jobs", "4"]
    keys(capsys, "create", "artist", "--scopes", "read", "admin", *limited)
    listed = keys(capsys, "list")
    assert shown not in listed
    rows = {line.split()[0]: line for line in listed.splitlines()[2:]}
    assert rows.keys() == {"farm", "artist"}
    assert "read compute" in rows["farm"]
    assert "never" in rows["farm"]
    assert rows["artist"].split()[-2:] == ["50", "4"]
    assert keys(capsys, "revoke", "farm") == "revoked farm\n"
    assert [key.name for key in read_keys(file)] == ["artist"]


def test_keys_as_figures(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = json.loads(keys(capsys, "create", "farm", "--expires", "1", "--json"))
    (listed,) = json.loads(keys(capsys, "list", "--json"))
    assert made.pop("key").startswith(f"rhytid_{made['id']}_")
    assert listed == made
    assert (listed["scopes"], listed["valid"]) == (["read", "compute"], True)


def test_the_file_may_be_elsewhere(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RHYTID_KEYS_FILE", str(tmp_path / "own" / "keys"))
    keys(capsys, "create", "farm", "--store", str(tmp_path / "other"))
    assert [key.name for key in read_keys(tmp_path / "own" / "keys")] == ["farm"]
    assert not store.exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["create", "farm"], "there is a key farm already"),
        (["revoke", "nobody"], "has no key nobody"),
    ],
)
def test_what_cannot_be_done_is_said(
    store: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    keys(capsys, "create", "farm")
    assert main(["keys", *arguments]) == 1
    assert told in capsys.readouterr().err
    assert [key.name for key in read_keys(store / "keys.json")] == ["farm"]


@pytest.mark.parametrize(
    "arguments",
    [["create"], ["revoke"], ["list", "farm"], ["create", "a b"], ["create", "a", "--expires", "0"],
     ["create", "a", "--scopes", "all"], ["create", "a", "--rate", "-1"], []],
)  # fmt: skip
def test_arguments_that_cannot_be_understood(
    store: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert "rhytid keys: error: " in usage_error(capsys, "keys", *arguments)
    assert not store.exists()


def test_a_server_on_loopback_asks_for_keys_once_there_are_some(tmp_path: Path) -> None:
    for host in ("127.0.0.1", "localhost"):
        with closing(listen(host, 0)) as listening:
            assert asks_keys(listening, tmp_path / "keys.json", without=False) is None


def test_a_server_that_had_keys_does_not_start_without_them(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, mark = store / "keys.json", store / "keys.json.asked"

    def asked(without: bool = False) -> bool | None:
        with closing(listen("127.0.0.1", 0)) as listening:
            return asks_keys(listening, file, without=without, mark=mark)

    keys(capsys, "create", "farm")
    leave_mark(mark)
    keys(capsys, "revoke", "farm")
    assert asked() is None  # the file is there: a key is asked for, which nobody has
    file.unlink()
    for _ in range(2):
        with pytest.raises(AccessError, match=r"keys\.json is gone.*--without-keys"):
            asked()
        assert asked(without=True) is False
    keys(capsys, "create", "farm")
    assert asked() is None
    file.unlink()
    mark.unlink()
    assert asked() is None


def test_a_file_of_keys_that_is_named_must_be_there(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where a secret is not mounted: nobody would be asked for a key."""
    with closing(listen("127.0.0.1", 0)) as listening:
        with pytest.raises(AccessError, match=r"RHYTID_KEYS_FILE names .*keys\.json, which is not"):
            asks_keys(listening, store / "keys.json", without=False, named=True)
        assert asks_keys(listening, store / "keys.json", without=True, named=True) is False
        keys(capsys, "create", "farm")
        assert asks_keys(listening, store / "keys.json", without=False, named=True) is None


@pytest.mark.slow
def test_serve_leaves_a_mark_and_heeds_it(
    store: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    keys(capsys, "create", "farm")
    serve = ("serve", "--port", "0", "--store", str(store))
    with process(*serve, folder=tmp_path) as running:
        assert running.stdout is not None
        assert "rhytid" in running.stdout.readline()
        running.send_signal(signal.SIGTERM)
        running.communicate(timeout=60)
    (store / "keys.json").unlink()

    with process(*serve, folder=tmp_path) as again:
        _, errors = again.communicate(timeout=60)

    assert again.returncode == 1
    assert "keys.json is gone" in errors


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_a_server_that_others_reach_needs_a_key(
    host: str, store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if host == "::" and not socket.has_ipv6:
        pytest.skip("this Python has no IPv6")
    file = store / "keys.json"
    with closing(listen(host, 0)) as listening:
        assert not ip_address(listening.getsockname()[0]).is_loopback
        with pytest.raises(AccessError, match=r"rhytid keys create.*127\.0\.0\.1.*--without-keys"):
            asks_keys(listening, file, without=False)
        assert asks_keys(listening, file, without=True) is False
        keys(capsys, "create", "farm")
        assert asks_keys(listening, file, without=False) is True
        document = json.loads(file.read_text())
        document["keys"][0]["expires"] = "2020-01-01T00:00:00+00:00"
        file.write_text(json.dumps(document))
        with pytest.raises(AccessError, match="no valid API key"):
            asks_keys(listening, file, without=False)
        file.write_text("{")
        with pytest.raises(StorageError, match="is not a file of API keys"):
            asks_keys(listening, file, without=False)


# Keys are asked for in the process of the server, whichever process has the device.
SERVE = ("serve", "--in-process", "--host", "0.0.0.0", "--port", "0", "--store", "store")


def test_serve_refuses_to_start_beyond_loopback_without_keys(tmp_path: Path) -> None:
    with process(*SERVE, folder=tmp_path) as running:
        out, errors = running.communicate(timeout=60)
    assert (running.returncode, out) == (1, "")
    assert errors.count("\n") == 1
    assert "rhytid keys create" in errors
    assert not (tmp_path / "store").exists()


@pytest.mark.slow
def test_serve_asks_for_the_keys_that_there_are(
    tmp_path: Path, store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = keys(capsys, "create", "farm", "--store", str(tmp_path / "store"))
    with process(*SERVE, folder=tmp_path) as running:
        url = address(running)
        assert httpx.get(f"{url}/v1/devices").status_code == 401
        assert httpx.get(f"{url}/healthz").status_code == 200
        assert httpx.get(f"{url}/healthz", headers={"Host": "evil.example"}).status_code == 400
        with pytest.raises(NotAllowed):
            PlainClient(url, key="rhytid_00000000_x").devices()
        assert PlainClient(url, key=shown).devices()
        running.terminate()
        assert running.wait(60) == 0


@pytest.mark.slow
def test_serve_goes_without_keys_where_it_is_told_to(tmp_path: Path) -> None:
    with process(*SERVE, "--without-keys", folder=tmp_path) as running:
        assert PlainClient(address(running)).devices()


def address(running: Any) -> str:
    words = running.stdout.readline().split()
    return str(words[words.index("on") + 1]).rstrip(",").replace("0.0.0.0", "127.0.0.1")
