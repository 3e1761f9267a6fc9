"""What people call an asset: from the file, by the settings, changed, kept, and of no account."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import pytest

from api.asking import is_problem
from api.live import serving
from api.patch import SETTINGS, obj
from engine.engines import built, new_asset, running
from rhytid.domain.asset_settings import AssetSettings
from rhytid_client import Client

SMALL = {**SETTINGS, "unit": "ft", "graph": {"wrinkles": 400}}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[httpx.Client]:
    with running(tmp_path / "store") as engine, serving(engine) as found:
        yield found


def test_an_asset_is_named_after_its_file_and_again_as_one_likes(client: httpx.Client) -> None:
    with closing(Client(str(client.base_url))) as sdk:
        made = sdk.wait(sdk.create_asset(obj(), name="Ada at 40.obj", settings=SMALL))
        assert made.name == "Ada at 40"
        assert [one.name for one in sdk.assets()] == ["Ada at 40"]
        tile = f"/v1/assets/{made.id}/frames/neutral/tiles/1001/0/0/0"
        etag = client.head(tile).headers["etag"]

        same = sdk.create_asset(obj(), name="another.obj", settings={**SMALL, "name": "Eve"})
        assert (same.id, same.name, same.warnings) == (made.id, "Ada at 40", made.warnings)

        assert sdk.change_asset(made, {"name": "Ada, 1979"}).name == "Ada, 1979"
        assert sdk.asset(made.id).name == "Ada, 1979"
        assert client.head(tile).headers["etag"] == etag
        assert sdk.change_asset(made, {"name": None}).name is None
    for wrong in ("", "x" * 81, "a\nb", 7):
        is_problem(client.patch(f"/v1/assets/{made.id}", json={"name": wrong}), 422, "settings")


def test_a_name_is_kept(tmp_path: Path) -> None:
    with running(tmp_path / "store") as engine:
        asset = built(engine, new_asset(name="Ada"))
        other = built(engine, new_asset(seed=2))
        engine.assets.change(asset, {"name": "Eve"})
    with running(tmp_path / "store") as engine:
        assert engine.assets.info(asset).settings["name"] == "Eve"
        assert engine.assets.info(other).settings["name"] is None


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("face.npz", "face"),
        ("C:\\faces\\Ada v2.obj", "Ada v2"),
        ("/tmp/../x/head.v2.glb", "head.v2"),
        ("a\tb\n c\x00.obj", "a b c"),
        ("\u202egnp.obj", "gnp"),
        ("Ærøskøbing 頭.ply", "Ærøskøbing 頭"),
        ("x" * 300 + ".obj", "x" * 80),
        (" \n.obj", None),
        ("", None),
    ],
)
def test_what_a_file_gives(file: str, name: str | None) -> None:
    named = AssetSettings().named_after(file)
    assert named.name == name
    assert AssetSettings.parse(named.as_json()) == named
    assert AssetSettings(name="mine").named_after(file).name == "mine"


def test_settings_of_before_there_were_names_are_read() -> None:
    before = AssetSettings(name="Ada").drawn()
    assert "name" not in before
    assert AssetSettings.parse(before) == AssetSettings()
