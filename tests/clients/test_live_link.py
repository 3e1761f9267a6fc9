"""The bridge from Live Link Face, fed by an encoder that is written from the format alone."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from api import patch
from api.fake_engine import FakeEngine
from api.live import serving
from rhytid_client import Client, LiveAnswer, LiveClosed, LiveTile, ProblemError
from rhytid_client.live_link import ARKIT, read_packet
from rhytid_client.live_link.bridge import Bridge
from rhytid_client.live_link.receiver import FaceReceiver

# Number 18 in the packets.
JAW_OPEN = 17
DEVICE, PHONE = "7F2A5C1E-0000-4A7B-9A1D-1234567890AB", "Anna's iPhone"


def encoded(
    values: Any = (0.0,) * 61,
    frame: int = 100,
    share: float = 0.25,
    rate: tuple[int, int] = (60, 1),
    name: str = PHONE,
    device: str = DEVICE,
) -> bytes:
    """A packet, byte for byte: version, two texts, the time, 61 numbers; all big-endian."""
    out = bytearray([6])
    for text in (device.encode(), name.encode()):
        out += len(text).to_bytes(4, "big") + text
    out += frame.to_bytes(4, "big", signed=True) + np.array(share, ">f4").tobytes()
    out += rate[0].to_bytes(4, "big") + rate[1].to_bytes(4, "big")
    out += bytes([len(values)]) + np.array(values, ">f4").tobytes()
    return bytes(out)


def face(jaw: float) -> list[float]:
    values = [0.0] * 61
    values[JAW_OPEN] = jaw
    return values


def test_every_value_finds_its_name() -> None:
    found = read_packet(encoded([k / 61 for k in range(61)], 7, 0.5, (30000, 1001)))
    assert found is not None
    assert (found.device, found.subject, found.frame) == (DEVICE, PHONE, 7.5)
    assert found.rate == pytest.approx(29.97, abs=1e-3)
    assert found.weights == pytest.approx([k / 61 for k in range(52)])
    assert found.turns == pytest.approx([k / 61 for k in range(52, 61)])
    # Apple's names: 52, of which these stand at known places in Epic's list.
    assert len(set(ARKIT)) == 52
    places = {"eyeBlinkLeft": 0, "eyeBlinkRight": 7, "jawForward": 14, "jawOpen": JAW_OPEN,
              "mouthClose": 18, "mouthSmileLeft": 23, "browDownLeft": 41, "browInnerUp": 43,
              "cheekPuff": 46, "noseSneerLeft": 49, "tongueOut": 51}  # fmt: skip
    assert {name: ARKIT.index(name) for name in places} == places


def test_a_packet_without_a_face() -> None:
    whole = encoded()
    assert read_packet(whole[: -61 * 4 - 1]) is None
    assert read_packet(encoded([])) is None
    assert read_packet(encoded(name="Anna\0"))  # some senders count the zero


@pytest.mark.parametrize(
    ("packet", "named"),
    [
        (b"", "version is missing"),
        (b"\7" + encoded()[1:], "version is 7"),
        (encoded()[:3], "device id is cut off"),
        (encoded()[:30], "device id has a length of 36"),
        (encoded()[:1] + struct.pack(">i", -4) + encoded()[5:], "length of -4"),
        (encoded()[:50], "subject name"),
        (encoded()[: -61 * 4 - 5], "time of the frame is cut off"),
        (encoded([0.0] * 60), "60 values"),
        (encoded()[:-1], "values end at"),
        (encoded() + b"\0", "values end at"),
        (encoded([float("nan")] * 61), "not finite"),
        (encoded().replace(b"Anna", b"\xff\xff\xff\xff"), "not UTF-8"),
    ],
)
def test_what_is_no_packet_is_named(packet: bytes, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        read_packet(packet)


@given(st.binary(max_size=60) | st.integers(0, 340).map(lambda n: encoded()[:n]))
def test_any_bytes_are_read_or_refused(packet: bytes) -> None:
    try:
        read_packet(packet)
    except ValueError:
        return


@pytest.fixture
def phone() -> Iterator[Any]:
    """Sends packets to a receiver."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending,
        FaceReceiver("127.0.0.1", 0) as faces,
    ):
        yield lambda packet: sending.sendto(packet, ("127.0.0.1", faces.port)), faces


def test_the_newest_is_used_and_late_ones_are_not(phone: Any) -> None:
    send, faces = phone
    for number in (1, 2, 5, 4, 3):
        send(encoded(face(number / 10), frame=number))
    newest = faces.newest(5)
    assert newest is not None
    assert (newest.frame, newest.weights[JAW_OPEN]) == (5.25, pytest.approx(0.5))
    assert faces.skipped == 2
    assert faces.newest(0.01) is None
    send(encoded(face(0.7), frame=4))
    assert faces.newest(0.01) is None
    # A clock that was set anew: another take.
    send(encoded(face(0.9), frame=-500))
    assert faces.newest(5).frame == -499.75


def test_one_face_is_followed_and_noise_is_counted(phone: Any) -> None:
    send, faces = phone
    send(encoded(face(0.1)))
    assert faces.newest(5).device == DEVICE
    send(encoded(face(0.2), frame=101, device="another"))
    send(b"noise")
    send(encoded()[:-4])
    assert faces.newest(0.05) is None
    assert faces.refused == 2
    assert "values end at" in faces.reason


def test_a_wait_goes_on_after_what_is_not_used(phone: Any) -> None:
    send, faces = phone
    assert faces.newest(0) is None
    send(b"noise")
    later = threading.Timer(0.1, send, (encoded(face(0.4)),))
    later.start()
    found = faces.newest(5)
    later.join()
    assert found is not None
    assert found.weights[JAW_OPEN] == pytest.approx(0.4)


def test_a_subject_may_be_chosen() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending,
        FaceReceiver("127.0.0.1", 0, "Bob") as faces,
    ):
        for name in (PHONE, "Bob", PHONE):
            sending.sendto(encoded(name=name, device=name), ("127.0.0.1", faces.port))
        assert faces.newest(5).subject == "Bob"  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, str]]:
    shapes = {"jawOpen": patch.smile(1.0), "browInnerUp_L": patch.smile(0.5)}
    with serving(FakeEngine()) as http, Client(str(http.base_url)) as client:
        made = client.create_asset(
            patch.obj(), name="patch.obj", settings=patch.SETTINGS, shapes=shapes
        )
        yield str(http.base_url), client.wait(made).id


def test_a_face_comes_back_as_skin(server: tuple[str, str], phone: Any) -> None:
    send, faces = phone
    url, asset = server
    tiles: list[LiveTile] = []
    ends: list[LiveAnswer | ProblemError] = []
    with Client(url) as client, client.live(asset, tiles=[(1001, 0, 1, 1)], shapes=ARKIT) as live:
        assert set(live.asset.unknown) == set(ARKIT) - {"jawOpen", "browInnerUp"}
        bridge = Bridge(faces, live, tiles.append, ends.append)
        running = threading.Thread(target=bridge.run)
        running.start()
        send(encoded(face(0.5)))
        until(lambda: ends)
        bridge.stop()
        running.join(5)
        assert not running.is_alive()
    with Client(url) as client:
        half = 0.5 * (patch.smile(1.0) + patch.positions())
        expected = client.tiles(asset, half, [(1001, 0, 1, 1)])[0].array
    assert np.abs(tiles[0].array - expected).max() < 1e-6
    assert bridge.sent == 1


def test_the_end_of_the_connection_ends_the_bridge(phone: Any) -> None:
    _, faces = phone
    with serving(FakeEngine()) as http, Client(str(http.base_url)) as client:
        shapes = {"jawOpen": patch.smile()}
        made = client.create_asset(patch.obj(), name="patch.obj", shapes=shapes)
        asset = client.wait(made)
        with client.live(asset, tiles=[(1001, 0, 0, 0)], shapes=ARKIT) as live:
            timer = threading.Timer(0.1, http.stop)
            timer.start()
            with pytest.raises(LiveClosed) as closed:
                Bridge(faces, live, lambda tile: None).run()
            assert closed.value.code == 1012
            timer.join()


def until(look: Any) -> None:
    deadline = time.monotonic() + 20
    while not look():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_an_error_of_the_socket_is_raised(phone: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(timeout: float) -> None:
        raise OSError("the network is down")

    _, faces = phone
    monkeypatch.setattr(faces, "newest", broken)
    with serving(FakeEngine()) as http, Client(str(http.base_url)) as client:
        shapes = {"jawOpen": patch.smile()}
        asset = client.wait(client.create_asset(patch.obj(), name="patch.obj", shapes=shapes))
        with (
            client.live(asset, tiles=[(1001, 0, 0, 0)], shapes=ARKIT) as live,
            pytest.raises(OSError, match="the network is down"),
        ):
            Bridge(faces, live, lambda _: None).run()


def test_the_command_writes_the_newest_tiles(server: tuple[str, str], tmp_path: Path) -> None:
    url, asset = server
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    command = [sys.executable, "-m", "rhytid_client.live_link", asset, "--url", url]
    command += ["--host", "127.0.0.1", "--port", str(port), "--tile", "1001/0/1/2"]
    command += ["--out", str(tmp_path / "out")]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending,
    ):
        try:
            assert process.stdout is not None
            assert f"port {port}" in process.stdout.readline()
            file = tmp_path / "out" / "1001.0.1.2.npy"
            sending.sendto(encoded(face(0.5)), ("127.0.0.1", port))
            until(file.exists)
            assert np.load(file).shape == (64, 64)
        finally:
            process.terminate()
