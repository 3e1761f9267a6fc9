"""Uploads decoded in a process with limits: the same results, and what the limits do."""

from __future__ import annotations

import io
import os
import pickle
import signal
import subprocess
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from api.patch import obj, positions
from attack.bombs import TRIANGLE, Files, grey_png, images, mesh, packed
from exr_images import exr
from processes.served import children
from rhytid.api.multipart import Part
from rhytid.api.spool import Spool
from rhytid.domain import blendshapes
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.scan import ScanSettings
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.messages import NewAsset
from rhytid.errors import BusyError, CancelledError, InputError, LimitError, MeshError
from rhytid.processes.decoding import child, limits
from rhytid.processes.decoding import decoder as decoding
from rhytid.processes.decoding.decoder import Decoder
from rhytid.processes.decoding.words import read_word

MIB = 1 << 20
SCAN = ScanSettings((0.02,), unit="mm")
GREY = np.linspace(0, 1, 64, dtype=np.float16).reshape(8, 8)


@pytest.fixture
def hold() -> Iterator[Hold]:
    """What an upload holds of 1 GiB."""
    budget = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")
    hold = budget.hold("uploads")
    yield hold
    hold.release()
    assert budget.used == 0


def read(
    files: Files,
    hold: Hold,
    gone: Callable[[], bool] = lambda: False,
    decoder: Decoder | None = None,
) -> NewAsset:
    """What is decoded of files that were sent."""
    before = children(os.getpid())  # servers of other tests
    spool = Spool()
    named: dict[str, list[Part]] = {}
    for name, (filename, data) in files:
        named.setdefault(name, []).append(Part(name, filename, spool, spool.size, len(data)))
        spool.write(data)
    parts = {name: replace(first, again=tuple(again)) for name, (first, *again) in named.items()}
    settings, file = AssetSettings(), spool.descriptor
    try:
        decoder = decoder or Decoder()
        return decoder.read(parts, settings, SCAN, force=True, hold=hold, gone=gone, file=file)
    finally:
        spool.close()
        assert set(children(os.getpid())) <= set(before)


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is light, and somebody looks whether the client is there before anything comes."""
    monkeypatch.setattr(limits, "LIGHT", -1)
    monkeypatch.setattr(decoding, "_LOOK", 0.0)


SHAPES = np.stack([positions(), positions() * 1.1]).astype(np.float32)


def shapes_file() -> bytes:
    file = io.BytesIO()
    np.save(file, SHAPES)
    return file.getvalue()


def test_what_a_process_decodes_is_what_a_thread_does(
    hold: Hold, monkeypatch: pytest.MonkeyPatch
) -> None:
    files: Files = [*mesh("patch.obj", obj()), ("shapes", ("shapes.npy", shapes_file()))]
    files += [("stiffness", ("s.1001.png", grey_png(16))), ("density", ("d.png", grey_png(8)))]
    here = read(files, hold)
    assert hold.nbytes == 3 * (sum(len(data) for _, (_, data) in files) + 4 * (16**2 + 8**2))
    hold.release()
    monkeypatch.setattr(limits, "LIGHT", -1)
    there = read(files, hold)
    assert hold.nbytes < 8 * MIB  # no longer the room for decoding
    for name in ("positions", "faces", "uv", "face_uv", "centre"):
        np.testing.assert_array_equal(getattr(there.mesh, name), getattr(here.mesh, name))
    assert (there.settings, there.force) == (here.settings, True)
    assert there.shapes is not None
    assert here.shapes is not None
    np.testing.assert_array_equal(there.shapes.positions, here.shapes.positions)
    assert there.stiffness is not None
    assert here.stiffness is not None
    np.testing.assert_array_equal(there.stiffness.maps[1001], here.stiffness.maps[1001])
    assert there.controls is not None
    assert here.controls is not None
    assert there.controls.maps.keys() == here.controls.maps.keys()


def test_a_scan_is_decoded_in_a_process_and_measured(hold: Hold) -> None:
    """At the resolution of the asset, with what is probably wrong with it."""
    heights = np.linspace(-0.001, 0.001, 64**2, dtype=np.float16).reshape(64, 64)
    found = read([*mesh("patch.obj", obj()), ("scan", ("s.1001.exr", exr(heights)))], hold)
    assert found.scan is not None
    assert found.scan.maps[1001].shape == (AssetSettings().resolution,) * 2
    assert np.abs(found.scan.maps[1001]).max() == pytest.approx(0.001 * 0.002, rel=0.1)
    assert {warning.code for warning in found.noted} >= {"scan-depth"}
    assert hold.nbytes >= found.scan.maps[1001].nbytes


def test_a_scan_that_promises_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its header promises three times what an upload may take at all; its folder is removed."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    hold = ByteBudget(128 * MIB, "RHYTID_HOST_MEMORY_MB").hold("uploads")
    files: Files = [*mesh("patch.obj", obj()), ("scan", ("s.1001.png", grey_png(6000)))]
    with pytest.raises(LimitError, match=r"^s\.1001\.png: .* than [0-9]+ bytes of memory"):
        read(files, hold)
    assert not list(tmp_path.iterdir())


def test_images_of_exr_are_decoded_in_one_process(
    hold: Hold, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Any] = []

    class Counted(subprocess.Popen[bytes]):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            started.append(arguments)
            super().__init__(*arguments, **options)

    monkeypatch.setattr(subprocess, "Popen", Counted)
    found = read(images(20, exr(GREY), "exr"), hold).stiffness
    assert found is not None
    assert len(found.maps) == 20
    assert len(started) == 1
    np.testing.assert_array_equal(found.maps[1001], np.rint(GREY.astype(float) * 65535))


def test_errors_are_told_as_they_are(hold: Hold, apart: None) -> None:
    with pytest.raises(MeshError, match="line 1: face corner 1 '1/1': no such vertex"):
        read(mesh("m.obj", b"f 1/1 2/2 3/3\n"), hold)


def test_a_damaged_image_is_named(hold: Hold) -> None:
    whole = exr(GREY)
    files = [*images(2, whole, "exr"), ("stiffness", ("s.1003.exr", whole[:-20]))]
    with pytest.raises(InputError, match=r"s\.1003\.exr"):
        read(files, hold)


def test_who_takes_more_memory_than_headers_promise_is_refused(
    hold: Hold, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "ROOM", 16 * MIB)
    monkeypatch.setattr(limits, "ROOM_A_PROMISED", 0)
    with pytest.raises(LimitError, match=r"^big\.npz: .* than [0-9]+ bytes of memory"):
        read(mesh("big.npz", packed({"positions": (1_000_000, 3)})), hold)


def test_what_headers_promise_is_counted(hold: Hold, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "ROOM", 16 * MIB)
    most = []
    monkeypatch.setattr(
        ByteBudget, "give_back", lambda budget, *_: most.append(budget.used), raising=True
    )
    budget = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")
    read(mesh("big.npz", packed({"positions": (1_000_000, 3)})), budget.hold("uploads"))
    assert most[0] > 16 * MIB + 3 * 24_000_000


@pytest.mark.parametrize("pack", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("number", ["f4", "f8"])
def test_a_mesh_is_taken_packed_or_not(
    hold: Hold, monkeypatch: pytest.MonkeyPatch, pack: Callable[..., None], number: str
) -> None:
    """What its arrays take is what is allowed, not what was sent of them."""
    monkeypatch.setattr(limits, "ROOM", 48 * MIB)
    side = 317
    u, v = np.meshgrid(*[np.linspace(0.01, 0.99, side, dtype=number)] * 2)
    at = np.arange(side * side).reshape(side, side)
    corners = (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1])
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype("<i4")
    uv = np.stack([u.ravel(), v.ravel()], 1)
    positions = np.concatenate([20 * uv, np.zeros((side**2, 1), number)], 1)
    file = io.BytesIO()
    pack(file, positions=positions, faces=faces, uv=uv, face_uv=faces)

    found = read(mesh("grid.npz", file.getvalue()), hold).mesh

    np.testing.assert_array_equal(found.faces, faces)


@pytest.mark.slow
def test_who_takes_too_long_is_refused(hold: Hold, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "SECONDS", -10)
    monkeypatch.setattr(limits, "CLOCK", 100)  # a busy machine gives it little of its time
    with pytest.raises(LimitError, match=r"^m\.obj: .* seconds of processor time"):
        read(mesh("m.obj", b"v 0 0 0\n" * (11 * MIB // 8)), hold)


def test_who_takes_no_processor_time_is_ended_by_the_clock(
    hold: Hold, apart: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "CLOCK", 0.02)
    others = set(children(os.getpid()))  # servers of other tests

    def stop() -> bool:
        for pid in set(children(os.getpid())) - others:
            os.kill(pid, signal.SIGSTOP)
        return False

    with pytest.raises(LimitError, match=r"decoding it takes more than 0\.6 seconds"):
        read(mesh("m.obj", obj()), hold, stop)


def test_a_file_that_is_too_short_ends(tmp_path: Path) -> None:
    file = tmp_path / "upload"
    file.write_bytes(b"12345")
    with file.open("rb") as opened:
        part = child.Part("mesh", "m.obj", 10, 2, opened.fileno(), lambda _: None)
        with pytest.raises(EOFError, match="part mesh has 3 bytes in place of 10"):
            _ = part.data


def test_a_client_that_is_gone_ends_it(hold: Hold, apart: None) -> None:
    with pytest.raises(CancelledError):
        read(mesh("m.obj", obj()), hold, lambda: True)


def test_a_crash_names_the_file(hold: Hold, apart: None) -> None:
    others = set(children(os.getpid()))  # servers of other tests

    def crash() -> bool:
        for pid in set(children(os.getpid())) - others:
            os.kill(pid, signal.SIGSEGV)
        return False

    with pytest.raises(InputError, match=r"damaged: it ends its decoder \(SIGSEGV\)"):
        read(mesh("m.obj", obj()), hold, crash)


def test_two_at_once_and_some_wait(
    hold: Hold, apart: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decoding, "_LOOK", 0.01)
    monkeypatch.setattr(decoding, "_PATIENCE", 0.05)
    decoder = Decoder()
    for _ in range(limits.AT_ONCE):
        assert decoder._turns.acquire(blocking=False)
    with pytest.raises(BusyError, match="other uploads were decoded for"):
        read(mesh("m.obj", obj()), hold, decoder=decoder)
    with pytest.raises(CancelledError):
        read(mesh("m.obj", obj()), hold, lambda: True, decoder=decoder)
    while decoder._places.acquire(blocking=False):
        pass
    with pytest.raises(BusyError, match="16 uploads wait"):
        read(mesh("m.obj", obj()), hold, decoder=decoder)


@pytest.mark.parametrize(
    "files",
    [
        mesh("m.obj", bytes(MIB + 1)),
        mesh("m.glb", b"glTF"),
        mesh("m.npz", packed({"positions": (1_000_000, 3)})),
        [*mesh("m.obj", obj()), ("stiffness", ("s.exr", exr(GREY)))],
        [*mesh("m.obj", obj()), ("stiffness", ("s.png", grey_png(2049)))],
    ],
    ids=["large", "gltf", "npz", "exr", "png"],
)
def test_what_is_not_light(files: Files) -> None:
    spool = Spool()
    parts = {}
    for name, (filename, data) in files:
        parts[name] = Part(name, filename, spool, spool.size, len(data))
        spool.write(data)
    assert not limits.is_light(parts)


def test_uploads_that_become_large_are_decoded_one_at_a_time(
    hold: Hold, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "LARGE", 20_000_000)
    monkeypatch.setattr(decoding, "_PATIENCE", 0.05)
    decoder = Decoder()
    large = mesh("m.npz", packed({"positions": (1_000_000, 3)}))
    other = [*mesh("m.obj", obj()), ("stiffness", ("s.exr", exr(GREY)))]
    with decoding._taken(decoder._alone, lambda: False):
        with pytest.raises(BusyError, match="other uploads were decoded for"):
            read(large, hold, decoder=decoder)
        assert read(other, hold, decoder=decoder).stiffness is not None
    assert len(read(large, hold, decoder=decoder).mesh.positions) == 1_000_000


class _Evil:
    def __init__(self, module: str, name: str, *arguments: Any) -> None:
        self._what = (module, name), arguments

    def __reduce__(self) -> Any:
        (module, name), arguments = self._what
        return _global(module, name), arguments


def _global(module: str, name: str) -> Any:
    import importlib
    from functools import reduce

    return reduce(getattr, name.split("."), importlib.import_module(module))


@pytest.mark.parametrize(
    "evil",
    [
        _Evil("os", "system", "true"),
        _Evil("subprocess", "run", "true"),
        _Evil("builtins", "eval", "1"),
        _Evil("rhytid.formats.exr", "read_grey_exr", b"", ""),
        _Evil("numpy", "fromfile", "x"),
        np.fromfile,
        open,
    ],
)
def test_an_answer_runs_nothing(evil: Any) -> None:
    with pytest.raises(pickle.UnpicklingError, match="is not expected here"):
        read_word(pickle.dumps(evil, 5))


def test_what_our_modules_import_is_not_ours() -> None:
    """A class of another module would lead on: defaultdict calls what it is made with."""
    assert blendshapes.defaultdict is defaultdict
    body = b"\x80\x04\x8c\x19rhytid.domain.blendshapes\x8c\x0bdefaultdict\x93."
    with pytest.raises(pickle.UnpicklingError, match="is not expected here"):
        read_word(body)


def test_a_name_with_a_dot_leads_nowhere() -> None:
    body = b"\x80\x04\x8c\x12rhytid.domain.mesh\x8c\x07np.load\x93."
    with pytest.raises(pickle.UnpicklingError, match="is not expected here"):
        read_word(body)
    assert read_word(pickle.dumps(Mesh, 5)) is Mesh
    assert TRIANGLE.keys() == {"faces", "uv", "face_uv", "positions"}
