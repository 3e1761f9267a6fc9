"""Snapshots between servers: the same asset, id and bits, and nothing synthesised again."""

from __future__ import annotations

import asyncio
import io
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest

from api.asking import is_problem
from api.live import serving
from cli.running import process
from engine.engines import REDRAW, built, maps, new_asset, rest, running, same
from meshes import deform
from pipeline.scenes import sheet
from rhytid.cli import main
from rhytid.domain.expressions import Expressions
from rhytid.engine.engine import Engine
from rhytid.errors import NotReadyError, StorageError
from rhytid_client import AsyncClient, Client, ConnectionFailed, PlainClient, RequestError

TAR = {"Content-Type": "application/x-tar"}


class Made(NamedTuple):
    """A server with a changed asset, and the snapshot of it."""

    engine: Engine
    client: httpx.Client
    asset: str
    data: bytes


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    with running(tmp_path_factory.mktemp("made")) as engine, serving(engine) as client:
        mesh = sheet(udims=2)
        moved = Expressions.checked(mesh.positions[None], len(mesh.positions), ["jawOpen"])
        asset = built(engine, replace(new_asset(mesh), shapes=moved))
        engine.assets.change(asset, {"shape": {"wrinkle_bulge": 5.0}})
        rest(engine)
        data = client.get(f"/v1/assets/{asset}/snapshot").raise_for_status().content
        yield Made(engine, client, asset, data)


def test_the_asset_is_the_same_on_another_server(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path) as engine, serving(engine) as client:
        monkeypatch.setattr("rhytid.synthesis.generate.synthesize", None)
        answer = client.post("/v1/snapshots", content=made.data, headers=TAR)
        assert answer.status_code == 201
        assert answer.headers["location"] == f"/v1/assets/{made.asset}"
        found, known = answer.json(), made.engine.assets.info(made.asset)
        assert (found["id"], found["state"], found["job"]) == (made.asset, "ready", None)
        assert found["settings"] == known.settings
        assert found["settings"]["shape"]["wrinkle_bulge"] == 5.0
        assert found["statistics"] == known.statistics
        assert engine.assets.shapes(made.asset).names == ("jawOpen",)
        bent = deform(sheet(udims=2).positions, 3, 0.15)
        for one in (engine, made.engine):
            one.frames.put(made.asset, "bent", bent)
        assert same(*(maps(one, made.asset, "bent") for one in (engine, made.engine)))
        again = client.get(f"/v1/assets/{made.asset}/snapshot")
        assert again.content == made.data
        sent = engine.assets.create(new_asset(sheet(udims=2)))
        assert (sent.id, sent.state) == (made.asset, "ready")
    with running(tmp_path) as engine:
        assert engine.assets.info(made.asset).settings == found["settings"]


def test_a_snapshot_has_a_length_a_name_and_a_tag(made: Made) -> None:
    path = f"/v1/assets/{made.asset}/snapshot"
    answer = made.client.get(path)
    assert answer.headers["content-type"] == "application/x-tar"
    assert answer.headers["content-length"] == str(len(made.data))
    assert f'filename="{made.asset}.rhytid.tar"' in answer.headers["content-disposition"]
    tag = {"If-None-Match": answer.headers["etag"]}
    assert made.client.get(path, headers=tag).status_code == 304
    is_problem(made.client.get("/v1/assets/0123456789abcdef/snapshot"), 404, "not-found")


def test_what_is_there_stays_as_it_is(made: Made) -> None:
    before = made.engine.assets.info(made.asset)
    made.engine.assets.change(made.asset, {"shape": {"wrinkle_bulge": 4.0}})
    answer = made.client.post("/v1/snapshots", content=made.data, headers=TAR)
    assert (answer.status_code, answer.json()["id"]) == (200, made.asset)
    assert answer.json()["settings"]["shape"]["wrinkle_bulge"] == 4.0
    made.engine.assets.change(made.asset, {"shape": {"wrinkle_bulge": 5.0}})
    assert made.engine.assets.info(made.asset).settings == before.settings


def test_files_that_are_none_are_refused_and_leave_nothing(made: Made, tmp_path: Path) -> None:
    with running(tmp_path) as engine, serving(engine, upload_limit=len(made.data)) as client:

        def refused(data: bytes, status: int, kind: str | None, **headers: str) -> str:
            answer = client.post("/v1/snapshots", content=data, headers={**TAR, **headers})
            return is_problem(answer, status, kind)

        flipped = bytearray(made.data)
        flipped[len(flipped) // 2] ^= 1
        assert "is damaged, bytes" in refused(bytes(flipped), 422, "snapshot")
        assert "cut off" in refused(made.data[:-1], 422, "snapshot")
        assert "no snapshot of rhytid" in refused(bytes(2048), 422, "snapshot")
        refused(made.data + b"\0", 413, "limit")
        refused(made.data, 415, None, **{"Content-Type": "application/zip"})
        assert engine.assets.all() == []
        assert not any((tmp_path / "assets").iterdir())
        assert not any((tmp_path / "partial").iterdir())
        assert engine.memory.used == 0


def test_a_damaged_asset_is_healed_by_its_snapshot(made: Made, tmp_path: Path) -> None:
    with running(tmp_path) as engine:
        engine.snapshots.restore(io.BytesIO(made.data), len(made.data))
    mesh = tmp_path / "assets" / made.asset / "asset" / "mesh.safetensors"
    mesh.write_bytes(mesh.read_bytes()[:-1])
    with running(tmp_path) as engine:
        assert engine.assets.info(made.asset).state == "failed"
        info, new = engine.snapshots.restore(io.BytesIO(made.data), len(made.data))
        assert (info.state, new) == ("ready", True)
        engine.tiles.plan_map(made.asset, "neutral", REDRAW, 1001, 0).draw()


def test_a_restore_that_the_disk_fails_can_be_repeated(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path) as engine:
        with monkeypatch.context() as patch:
            patch.setattr(engine._store.snapshots, "install", _fails)
            with pytest.raises(StorageError):
                engine.snapshots.restore(io.BytesIO(made.data), len(made.data))
        assert engine.assets.all() == []
        assert engine.snapshots.restore(io.BytesIO(made.data), len(made.data))[1]


def _fails(*_: Any) -> None:
    raise StorageError("no")


def test_an_asset_that_builds_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with running(tmp_path) as engine:
        monkeypatch.setattr(engine.assets._builder, "start", lambda *_, **__: None)
        info = engine.assets.create(new_asset())
        with pytest.raises(NotReadyError):
            engine.snapshots.of(info.id)


def test_bytes_stay_whole_while_the_asset_is_removed(made: Made, tmp_path: Path) -> None:
    with running(tmp_path) as engine:
        engine.snapshots.restore(io.BytesIO(made.data), len(made.data))
        with engine.snapshots.of(made.asset) as snapshot:
            pieces = snapshot.pieces()
            first = next(pieces)
            engine.assets.delete(made.asset)
            assert first + b"".join(pieces) == made.data


@pytest.mark.parametrize("kind", [Client, PlainClient])
def test_the_blocking_clients_write_and_send_files(kind: Any, made: Made, tmp_path: Path) -> None:
    with running(tmp_path / "store") as engine, serving(engine) as other, ExitStack() as opened:
        here, there = kind(str(made.client.base_url)), kind(str(other.base_url))
        if kind is Client:
            opened.callback(here.close)
            opened.callback(there.close)
        file = here.snapshot(made.asset, tmp_path)
        assert file == tmp_path / f"{made.asset}.rhytid.tar"
        assert file.read_bytes() == made.data
        told: list[tuple[int, int]] = []
        asset = there.restore(file, progress=lambda *sent: told.append(sent))
        assert (asset.id, asset.state) == (made.asset, "ready")
        assert told[-1] == (len(made.data), len(made.data))
        file.write_bytes(made.data[:-1])
        with pytest.raises(RequestError, match="cut off"):
            there.restore(file)
    assert {path.name for path in tmp_path.iterdir()} == {"store", file.name}


def test_the_same_awaited(made: Made, tmp_path: Path) -> None:
    async def session() -> None:
        async with AsyncClient(str(made.client.base_url)) as client:
            file = await client.snapshot(made.asset, tmp_path / "a.tar")
            assert file.read_bytes() == made.data
            assert (await client.restore(file)).id == made.asset

    asyncio.run(session())


@pytest.mark.parametrize("kind", [Client, PlainClient])
def test_an_answer_that_breaks_off_leaves_no_file(
    kind: Any, made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rhytid.storage.snapshots import Snapshot

    whole = Snapshot.pieces

    def broken(self: Snapshot) -> Iterator[bytes]:
        pieces = whole(self)
        yield from (next(pieces) for _ in range(5))
        raise StorageError("broken")

    monkeypatch.setattr(Snapshot, "check", lambda self: None)
    monkeypatch.setattr(Snapshot, "pieces", broken)
    client = kind(str(made.client.base_url))
    with pytest.raises(ConnectionFailed):
        client.snapshot(made.asset, tmp_path / "a.tar")
    if kind is Client:
        client.close()
    assert not any(tmp_path.iterdir())


def test_the_command_line_writes_and_reads_them(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sent.rhytid.tar"
    file.write_bytes(made.data)
    one, two = (str(tmp_path / name) for name in ("one", "two"))
    assert main(["restore", str(file), "--store", one]) == 0
    assert capsys.readouterr().out == f"{made.asset}: restored\n"
    assert main(["restore", str(file), "--store", one]) == 0
    assert capsys.readouterr().out == f"{made.asset}: there already\n"
    out = tmp_path / "again.tar"
    assert main(["snapshot", made.asset, "--out", str(out), "--store", one]) == 0
    assert out.read_bytes() == made.data
    file.write_bytes(made.data[:3000])
    assert main(["restore", str(file), "--store", two]) == 1
    assert f"{file}: it is cut off" in capsys.readouterr().err
    assert main(["snapshot", made.asset, "--store", two]) == 1
    told = capsys.readouterr().err
    assert "no asset" in told
    assert f"; the store is {two}" in told
    assert main(["snapshot", made.asset, "--store", str(tmp_path / "three")]) == 1
    assert "is no store of assets" in capsys.readouterr().err
    with running(Path(one)) as engine:
        assert engine.assets.info(made.asset).state == "ready"


@pytest.mark.slow
def test_a_server_starts_with_restored_assets(made: Made, tmp_path: Path) -> None:
    file = tmp_path / "sent.rhytid.tar"
    file.write_bytes(made.data)
    assert main(["restore", str(file), "--store", str(tmp_path / "store"), "-q"]) == 0
    with process("serve", "--port", "0", "--store", "store", folder=tmp_path) as server:
        assert server.stdout is not None
        words = server.stdout.readline().split()
        url = words[words.index("on") + 1].rstrip(",")
        found = httpx.get(f"{url}/v1/assets", timeout=60).json()
        assert [(one["id"], one["state"]) for one in found] == [(made.asset, "ready")]
        assert main(["snapshot", made.asset, "--store", str(tmp_path / "store")]) == 1
