"""What changes the ETag of a tile: what its method reads, and nothing else."""

from __future__ import annotations

import httpx
import pytest

import rhytid
import rhytid_kernels
from api.live import serving
from engine.engines import QUERIES, built, finish, new_asset, running, same, settle
from meshes import deform
from pipeline.scenes import DEPTH, sheet
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.domain.tiles import TileAddress
from rhytid.engine.tiles import service
from rhytid.support import build_identity

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
    "name": ({"name": "Ada at 40"}, []),
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


QUICK = ("depth", "response", "r_max", "convolve", "name")
NAMED = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in READ]


@pytest.mark.parametrize("name", NAMED)
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


def test_another_drawing_has_other_keys_on_the_same_store(tmp_path, monkeypatch):
    """As after an update: assets keep their ids, and what was drawn before is drawn anew."""
    found = []
    for version in ("1.0+old", "1.0+new", "1.0+old"):
        monkeypatch.setattr(service, "drawing_version", lambda version=version: version)
        with running(tmp_path) as engine:
            asset = built(engine, new_asset()) if not found else engine.assets.all()[0].id
            settle(engine, asset)
            assert engine.assets.info(asset).state == "ready"
            engine.frames.put(asset, "bent", BENT)
            keys = [engine.tiles.plan_map(asset, "bent", query, 1001, 0).key for query in QUERIES]
            tiles = [engine.tiles.plan(asset, "bent", query, ADDRESS).draw() for query in QUERIES]
            with serving(engine) as client:
                found.append((asset, keys, etags(client, asset), tiles))
    old, new, again = found
    assert old[0] == new[0] == again[0]
    assert old[1:3] == again[1:3]
    assert not set(old[1]) & set(new[1])
    assert not set(old[2].values()) & set(new[2].values())
    assert same(old[3], new[3])


def test_the_version_of_the_drawing_goes_with_the_sources(monkeypatch):
    version = build_identity.drawing_version()
    assert version.startswith(f"{rhytid.__version__}+")
    read = rhytid_kernels._read
    for name in ("redraw.cl", "response.clh"):
        changed = lambda file, name=name: read(file) + " " * (file == name)  # noqa: E731
        monkeypatch.setattr(rhytid_kernels, "_read", changed)
        assert build_identity.drawing_version.__wrapped__() != version
    monkeypatch.undo()
    assert build_identity.drawing_version.__wrapped__() == version
    monkeypatch.setattr(build_identity, "modules_digest", lambda *packages: "0" * 12)
    assert build_identity.drawing_version.__wrapped__() != version


@pytest.mark.parametrize(
    "file", ["pipeline/blend", "synthesis/ranks", "tracing/fit", "domain/skin"]
)
def test_other_code_of_grown_and_traced_skin_is_another_drawing(file, monkeypatch):
    """An asset keeps its id where the same input makes other lines."""
    version, add = build_identity.drawing_version(), build_identity._add
    changed = lambda digest, name, data: add(  # noqa: E731
        digest, name, data + b" " * (name == f"rhytid.{file}.py")
    )
    monkeypatch.setattr(build_identity, "_add", changed)
    assert build_identity.drawing_version.__wrapped__() != version


def test_the_digest_of_modules_goes_with_names_and_texts(tmp_path, monkeypatch):
    monkeypatch.setattr(build_identity, "files", lambda package: tmp_path)
    digests = set()
    for name, text in (("a.py", "x = 1"), ("b.py", "x = 1"), ("b.py", "x = 2")):
        (tmp_path / name).write_text(text)
        digests.add(build_identity.modules_digest("rhytid.pipeline"))
    assert len(digests) == 3
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "c.pyc").write_text("x")
    assert build_identity.modules_digest("rhytid.pipeline") in digests


def test_a_tile_says_which_key_its_place_has_once_it_is_drawn(engine, monkeypatch):
    """Another where the settings or the frame were changed meanwhile."""
    asset, query = built(engine, new_asset()), QUERIES[1]
    engine.frames.put(asset, "bent", BENT)
    others = [
        lambda: None,
        lambda: engine.assets.change(asset, {"depth": 2 * DEPTH}),
        lambda: engine.frames.put(asset, "bent", deform(sheet().positions, 4, 0.15)),
        lambda: engine.assets.change(asset, {"depth": DEPTH}),
    ]
    draw = engine.tiles._tile
    for other in others:

        def changed(*arguments, meanwhile=other):
            tile = draw(*arguments)
            meanwhile()
            return tile

        monkeypatch.setattr(engine.tiles, "_tile", changed)
        drawn = engine.tiles.draw(asset, "bent", query, ADDRESS)
        assert (drawn.key == drawn.description.key) == (other is others[0])
        assert drawn.key == engine.tiles.plan(asset, "bent", query, ADDRESS).key
