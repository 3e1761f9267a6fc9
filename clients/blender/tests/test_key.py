"""The key of the panel, against a service that asks for one."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import pytest

from conftest import command, preferences, served


class Keyed(NamedTuple):
    url: str
    key: str
    reads: str


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Keyed]:
    """A service with a key of the usual scopes, and one that may only read."""
    store = tmp_path_factory.mktemp("keyed")
    artist, viewer = made(store, "artist"), made(store, "viewer", "--scopes", "read")
    with served(store) as url:
        yield Keyed(url, artist, viewer)


def made(store: Path, name: str, *more: str) -> str:
    """A new key of a store."""
    words = [*command()[:-1], "keys", "create", name, "--store", str(store), "--json", *more]
    told = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    return str(json.loads(told)["key"])


@pytest.fixture
def connection(blender: bpy.types.Scene, keyed: Keyed) -> Iterator[Any]:
    """The extension's part that speaks with the service, which is the one with keys."""
    from bl_ext.user_default.rhytid import connection

    preferences().server = keyed.url
    yield connection
    preferences().key = ""


def test_the_service_answers_to_its_key(connection: Any, keyed: Keyed) -> None:
    for key in (keyed.key, keyed.reads, f" {keyed.key} "):
        preferences().key = key
        assert connection.server().tested().startswith("Connected: ")


@pytest.mark.parametrize("key", ["", "wrong"])
def test_the_panel_says_that_a_key_is_needed(connection: Any, key: str) -> None:
    from rhytid_client.hosts import Trouble

    preferences().key = key
    with pytest.raises(Trouble, match=r"asks for a valid key \(401\): .*rhytid keys create"):
        connection.server().tested()


def test_the_panel_says_what_a_key_is_not_for(connection: Any, keyed: Keyed) -> None:
    from rhytid_client.hosts import Trouble

    preferences().key = keyed.reads
    flat = {"positions": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
    mesh = {**flat, "uv": [[0, 0], [1, 0], [0, 1]], "face_uv": [[0, 1, 2]]}
    with (
        pytest.raises(Trouble, match=r"refuses the key \(403\): .*scope compute"),
        connection.server().client() as client,
    ):
        client.create_asset(mesh)
