"""A client that openapi-python-client makes of the document, as it makes it, calls a server."""

from __future__ import annotations

import importlib
import importlib.util
import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from api.live import serving
from api.patch import SETTINGS, SIDE, obj, smile
from engine.engines import running

pytestmark = pytest.mark.slow
NAME = "rhytid_http_client"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[httpx.Client]:
    with running(tmp_path / "store") as engine, serving(engine) as client:
        yield client


@pytest.fixture
def generated(server: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The output of the generator, whose package can be imported."""
    document, out = tmp_path / "openapi.json", tmp_path / "made"
    document.write_bytes(server.get("/openapi.json").content)
    command = [sys.executable, "-m", "openapi_python_client", "generate"]
    given = ["--path", str(document), "--output-path", str(out)]
    made = subprocess.run([*command, *given], capture_output=True, text=True, timeout=120)
    assert made.returncode == 0, made.stdout + made.stderr
    monkeypatch.syspath_prepend(str(out))
    return made.stdout + made.stderr


def call(place: str) -> Any:
    """A module of the package: a call of the API, or its types."""
    return importlib.import_module(f"{NAME}.{place}")


def test_every_call_is_made(server: httpx.Client, generated: str) -> None:
    """Under a name of its own: the SDK is installed beside it."""
    assert "will not be generated" not in generated
    paths = server.get("/openapi.json").json()["paths"]
    wanted = {one["operationId"] for methods in paths.values() for one in methods.values()}
    root = Path(call("client").__file__).parent / "api"
    made = {path.stem.replace("_", "") for path in root.glob("*/*.py")}
    assert {name for name in wanted if name.lower() not in made} == set()
    assert importlib.util.find_spec("rhytid_client") is not None


def test_the_main_calls_work(server: httpx.Client, generated: str) -> None:
    models, types = call("models"), call("types")
    made = call("client").Client(base_url=str(server.base_url), raise_on_unexpected_status=True)
    with made as client:
        main_calls(client, models, types)


def main_calls(client: Any, models: Any, types: Any) -> None:
    """From a mesh to its map, and its snapshot back."""

    def sent(data: bytes, name: str = "file") -> Any:
        return types.File(payload=io.BytesIO(data), file_name=name)

    settings = models.AssetSettings.from_dict({**SETTINGS, "unit": "ft", "name": "Ada"})
    body = models.CreateAssetBody(mesh=sent(obj(), "patch.obj"), settings=settings)
    asset = call("api.assets.create_asset").sync(body=body, client=client)
    assert isinstance(asset, models.Asset)
    while (job := call("api.jobs.get_job").sync(asset.job, client=client)).state != "done":
        assert job.state in ("queued", "running"), job
    asset = call("api.assets.get_asset").sync(asset.id, client=client)
    assert (asset.state, asset.settings.name) == ("ready", "Ada")

    positions = np.ascontiguousarray(smile(), "<f4")
    frame = call("api.frames.put_frame").sync(
        asset.id, "smile", body=sent(positions.tobytes()), client=client
    )
    assert frame.name == "smile"
    place = (asset.id, "smile", 1001)
    tile = call("api.tiles.get_tile").sync(*place, 0, 0, 0, client=client)
    whole = call("api.tiles.get_map").sync(*place, client=client)
    heights = np.load(io.BytesIO(whole.payload.read()))
    side = asset.settings.tile_size
    assert heights.shape == (256, 256)
    assert np.ptp(heights) > 0
    assert np.array_equal(np.load(io.BytesIO(tile.payload.read())), heights[:side, :side])

    for name in ("get_graph", "get_mesh"):
        assert call(f"api.assets.{name}").sync(asset.id, client=client).payload.read()
    snapshot = call("api.assets.get_snapshot").sync(asset.id, client=client).payload.read()
    call("api.assets.delete_asset").sync_detailed(asset.id, client=client)
    restored = call("api.assets.restore_snapshot").sync(body=sent(snapshot), client=client)
    assert (restored.id, restored.vertices) == (asset.id, SIDE**2)
