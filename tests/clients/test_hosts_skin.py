"""A skin over a host that is made up, with the real service: sent, baked, shown, cancelled."""

from __future__ import annotations

import socket
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from api.fake_engine import FakeEngine
from api.live import serving
from engine.engines import running
from meshes import bumpy_grid, deform
from rhytid_client import PlainClient
from rhytid_client.hosts import Cancelled, Display, MeshArrays, Progress, Server, Skin, Trouble
from rhytid_client.hosts.sequences import STANDARD, UDIM_LAST, UNPADDED, Style
from rhytid_client.hosts.work import finish

pytestmark = pytest.mark.usefixtures("no_maps_ahead")

MESH = bumpy_grid(10, seed=1)
TINY = {"graph": {"wrinkles": 200}, "tile_size": 256}


class Host:
    """A scene of a sheet that is bent more with each frame, in which calls are noted."""

    def __init__(self, *, style: Style = STANDARD, patience: int = 1000) -> None:
        self.name, self.unit = "a sheet", "cm"
        self._style, self._patience = style, patience
        self.at = 2
        self.shown: list[Display] = []
        self.told: list[str] = []
        self.extra = 0

    def rest(self) -> MeshArrays:
        return MESH._asdict()

    def positions(self, frame: int) -> np.ndarray:
        self.at = frame
        bent = deform(MESH.positions, 3, 0.02 * frame)
        return np.concatenate([bent, bent[: self.extra]])

    def frame(self) -> int:
        return self.at

    def frames(self) -> Sequence[int]:
        return range(1, 4)

    @contextmanager
    def working(self, title: str) -> Iterator[Progress]:
        shown = self.at
        try:
            yield self._goes_on
        finally:
            self.at = shown

    def _goes_on(self, share: float, text: str) -> bool:
        self.told.append(text)
        return len(self.told) < self._patience

    def style(self, udims: Sequence[int]) -> Style:
        return self._style

    def show(self, display: Display) -> list[str]:
        self.shown.append(display)
        return ["shown"]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running(tmp_path_factory.mktemp("store")) as engine, serving(engine) as http:
        yield Server(str(http.base_url).rstrip("/"))


def sent(host: Host, server: Server, **how: float) -> Skin:
    skin = Skin(host, server, **how)
    skin.send(resolution=512, settings=TINY)
    return skin


def texels(file: Path) -> np.ndarray:
    return OpenEXR.File(str(file), separate_channels=True).channels()["Y"].pixels


@pytest.mark.slow
def test_baked_files_are_the_maps_of_the_frames(server: Server, tmp_path: Path) -> None:
    host = Host()
    skin = sent(host, server)
    assert skin.bake(tmp_path / "maps")[0] == "shown"
    maps = host.shown[-1].maps
    assert maps.frames == (1, 2, 3)
    assert maps.name.startswith("a_sheet-")
    assert host.at == 2
    client = PlainClient(server.url)
    drawn = []
    for frame in maps.frames:
        client.put_frame(skin.asset, "test", deform(MESH.positions, 3, 0.02 * frame))
        expected = client.map(skin.asset, "test", 1001, sampling="smooth").array
        found = texels(maps.file(1001, frame))
        assert (found == expected).all()
        drawn.append(found)
        assert np.abs(found).max() <= maps.bound
    assert np.abs(drawn[0] - drawn[2]).max() > 0
    assert sorted(frame.name for frame in client.frames(skin.asset)) == ["neutral", "test"]


def test_a_mesh_may_be_a_file(server: Server, tmp_path: Path) -> None:
    host = Host()
    file = tmp_path / "sheet.npz"
    np.savez(file, **MESH._asdict())
    host.rest = lambda: file  # type: ignore[method-assign,assignment,return-value]
    assert sent(host, server).asset.id == sent(Host(), server).asset.id


def test_expressions_of_the_scene_lead_lines(server: Server) -> None:
    plain, led = Host(), Host()
    first = sent(plain, server).asset
    skin = Skin(led, server)
    skin.send(resolution=512, settings=TINY, expressions=[3, 9])
    assert skin.asset.id != first.id
    again = sent(Host(), server).asset
    assert again.id == first.id


def test_one_frame_is_the_one_that_is_shown(server: Server, tmp_path: Path) -> None:
    host = Host()
    sent(host, server, strength=0.5).draw(tmp_path)
    (display,) = host.shown
    assert display.maps.frames == (2,)
    assert (display.start, display.scale) == (2, 0.5)
    assert display.bound == pytest.approx(0.5 * display.maps.bound)
    assert [path.name for path in tmp_path.iterdir()] == [display.maps.file(1001, 2).name]


def test_half_floats_have_half_the_size(server: Server, tmp_path: Path) -> None:
    host = Host()
    sent(host, server).bake(tmp_path, [1], half=True)
    (file,) = tmp_path.iterdir()
    assert texels(file).dtype == np.float16


def test_an_opened_folder_has_the_unit_of_the_scene(server: Server, tmp_path: Path) -> None:
    baker = Host(style=STANDARD)
    sent(baker, server).bake(tmp_path, [4, 5])
    host = Host(style=UNPADDED)
    host.unit = "mm"
    Skin(host, server, strength=2.0).open(tmp_path, start=20)
    (display,) = host.shown
    assert (display.start, display.scale) == (20, 20.0)
    assert display.bound is None
    names = sorted(path.name for path in (tmp_path / "renamed").iterdir())
    assert names == [display.maps.file(1001, frame).name for frame in (4, 5)]
    assert names[0].endswith(".1001.4.exr")


def test_names_that_suit_are_not_copied(server: Server, tmp_path: Path) -> None:
    host = Host()
    sent(host, server).bake(tmp_path, [4])
    Skin(host, server).open(tmp_path)
    assert not (tmp_path / "renamed").exists()
    assert host.shown[-1].start == 4


def test_names_of_a_host_are_written_at_once(server: Server, tmp_path: Path) -> None:
    host = Host(style=UDIM_LAST)
    sent(host, server).bake(tmp_path, [7])
    (file,) = tmp_path.iterdir()
    assert file.name.endswith("_f0007.1001.exr")


def test_cancelled_work_leaves_whole_files_and_the_frame(server: Server, tmp_path: Path) -> None:
    host = Host()
    skin = sent(host, server)
    host._patience = len(host.told) + 3
    with pytest.raises(Cancelled, match="frame 3 of 3"):
        skin.bake(tmp_path)
    assert host.at == 2
    assert host.shown == []
    files = sorted(tmp_path.iterdir())
    assert [file.name.split(".")[2] for file in files] == ["0001", "0002"]
    assert [texels(file).shape for file in files] == [(512, 512)] * 2


def test_a_cancelled_send_ends_the_job() -> None:
    engine = FakeEngine(polls=1000)
    with serving(engine) as http:
        server = Server(str(http.base_url).rstrip("/"))
        with pytest.raises(Cancelled):
            Skin(Host(patience=4), server).send(resolution=512, settings=TINY)
        client = PlainClient(server.url)
        (asset,) = client.assets()
        assert asset.job is not None
        assert client.job(asset.job).state == "cancelled"


def test_another_number_of_vertices_is_told(server: Server, tmp_path: Path) -> None:
    host = Host()
    skin = sent(host, server)
    host.extra = 2
    with pytest.raises(Trouble, match=r"'a sheet' has \d+ vertices, \d+ were sent: it was edited"):
        skin.bake(tmp_path)
    assert host.at == 2


@pytest.mark.parametrize(
    ("frames", "words"),
    [([], "There are no frames to bake"), ([-1, 0], "Frame -1 cannot be baked")],
)
def test_frames_that_cannot_be_baked(
    server: Server, tmp_path: Path, frames: list[int], words: str
) -> None:
    with pytest.raises(Trouble, match=f"{words}: they are numbered from 0 on"):
        sent(Host(), server).bake(tmp_path, frames)


def test_of_a_range_before_0_the_rest_is_baked(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    host = Host()
    monkeypatch.setattr(host, "frames", lambda: [-2, -1, 0, 0])
    sent(host, server).bake(tmp_path)
    assert [path.name.split(".")[-2] for path in tmp_path.glob("*.exr")] == ["0000"]


@pytest.mark.slow
def test_settings_may_say_the_resolution(server: Server) -> None:
    skin = Skin(Host(), server)
    skin.send(settings={"graph": TINY["graph"], "resolution": 256})
    assert skin.asset.settings["tile_size"] == 256


def test_what_is_wrong_is_told_in_words(server: Server, tmp_path: Path) -> None:
    with pytest.raises(Trouble, match="Send the mesh first"):
        Skin(Host(), server).bake(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as free:
        nobody = Server(f"http://127.0.0.1:{free.getsockname()[1]}")
    with pytest.raises(Trouble, match=r"No answer from http://127.0.0.1:.*rhytid serve"):
        nobody.tested()
    for written in ("ftp://a", "http://127.0.0.1:8717x", " "):
        with pytest.raises(Trouble, match="is not the address of a server: it is like http://"):
            Server(written).tested()
    with pytest.raises(Trouble, match="resolution"):
        Skin(Host(), server).send(resolution=3)


def test_an_address_needs_no_scheme(server: Server) -> None:
    assert Server(f" {server.url.removeprefix('http://')}").tested().startswith("Connected")


def test_the_connection_is_tested(server: Server) -> None:
    assert server.tested().startswith("Connected: ")


def test_the_key_is_in_no_message() -> None:
    assert "secret" not in repr(Server("http://a", "secret"))


def test_work_that_is_cancelled_is_closed_at_once() -> None:
    ended = []

    def steps() -> Generator[tuple[float, str, float], None, None]:
        try:
            yield 0.5, "half", 0.0
        finally:
            ended.append(True)

    work = steps()
    with pytest.raises(Cancelled, match="half"):
        finish(work, lambda share, text: False)
    assert ended == [True]


def test_steps_give_their_result() -> None:
    def steps() -> Generator[tuple[float, str, float], None, int]:
        yield 0.5, "half", 0.0
        return 7

    assert finish(steps(), lambda share, text: True) == 7
