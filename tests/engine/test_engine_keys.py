"""What changes the ETag of a tile: what its method reads, and nothing else."""

from __future__ import annotations

import httpx
import pytest
from rhytid.domain.settings_changes import CHANGEABLE

from api.live import serving
from engine.engines import QUERIES, built, finish, new_asset, same
from meshes import deform
from pipeline.scenes import DEPTH, sheet
from rhytid.domain.tiles import TileAddress

ADDRESS = TileAddress(1001, 0, 1, 2)
BENT = deform(sheet().positions, 3, 0.15)
FORMATS = ("npy", "f16", "exr", "exr16", "png")
NAMES = [query.method for query in QUERIES]

# A change, and the methods whose tiles it changes.
READ = {
    "depth": ({"depth": 2 * DEPTH}, NAMES),
    "shape": ({"shape": {"wrinkle_bulge": 1.0}}, NAMES),
    "response": ({"response": {"alpha_d": 3.0}}, ["redraw", "binned", "convolved"]),
    "limit": ({"response": {"log_stretch_limit": 0.2}}, ["redraw", "binned", "convolved"]),
    "angles": ({"angles": "surface"}, ["redraw", "binned"]),
    "r_max": ({"bins": {"r_max": 0.1}}, ["binned"]),
    "bins": ({"bins": {"count": 8, "depth_factored": True}}, ["binned"]),
    "preset": ({"preset": "best"}, ["neutral", "redraw", "binned", "convolved"]),
    "convolve": ({"convolve": {"blur_gain": 2.0}}, ["convolved"]),
}


def test_every_setting_that_can_change_is_tried():
    assert {key for changes, _ in READ.values() for key in changes} == set(CHANGEABLE)


def etags(client: httpx.Client, asset: str) -> dict[tuple[str, str], str]:
    """Of one tile by every method and in every format."""
    path = f"/v1/assets/{asset}/frames/bent/tiles/{ADDRESS}"
    ask = {
        (m, f): client.head(path, params={"method": m, "format": f}) for m in NAMES for f in FORMATS
    }
    return {key: answer.raise_for_status().headers["etag"] for key, answer in ask.items()}


@pytest.mark.parametrize("name", READ)
def test_only_what_a_method_reads_changes_its_etags(engine, name):
    changes, methods = READ[name]
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    with serving(engine) as client:
        before = etags(client, asset)
        tiles = [engine.tiles.plan(asset, "bent", query, ADDRESS).draw() for query in QUERIES]
        client.patch(f"/v1/assets/{asset}", json=changes).raise_for_status()
        after = etags(client, asset)
    changed = {
        method for method, format in before if before[method, format] != after[method, format]
    }
    assert changed == set(methods)
    for query, tile in zip(QUERIES, tiles, strict=True):
        if query.method not in changed:
            assert same([engine.tiles.plan(asset, "bent", query, ADDRESS).draw()], [tile])


def test_calibration_leaves_all_but_binned(engine):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    with serving(engine) as client:
        before = etags(client, asset)
        finish(engine, engine.assets.calibrate(asset, BENT).id)
        after = etags(client, asset)
    assert {key[0] for key in before if before[key] != after[key]} == {"binned"}
