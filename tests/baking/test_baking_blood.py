"""Blood follows the area of skin late, whatever was baked before."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from baking.bakers import SQUARE, bake
from baking.fake_engine import FakeEngine
from exports.textures.reading import read_texture
from reference.hencky import late
from rhytid.baking.blood import REACH, BloodFlow
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.frames import FrameFiles
from rhytid.baking.request import Lag
from rhytid.exports.textures.stretch import MOST
from rhytid.formats.meshes import MeshFile

SIZES = np.array([1.0, 0.8, 0.7, 0.7, 1.0, 1.0, 1.3, 1.0, 0.9, 1.0])
FRAMES = (SQUARE.positions * SIZES[:, None, None]).astype(np.float32)
AREAS = [float(area) for area in 2 * np.log(SIZES)]


def flow(lag: Lag, frames: np.ndarray = FRAMES) -> tuple[BloodFlow, list[FramePlace]]:
    files = FrameFiles(MeshFile(SQUARE, frames), [])
    return BloodFlow(SQUARE, files, lag), list(files.places)


@pytest.mark.parametrize(("seconds", "fps"), [(0.15, 24.0), (0.02, 30.0), (0.0, 24.0)])
def test_a_frame_has_the_late_area_in_any_order(seconds: float, fps: float) -> None:
    lag = Lag(seconds, fps)
    forwards, places = flow(lag)
    in_order = [forwards.field(place).values for place in places]
    for frame, values in enumerate(in_order):
        times = [i / fps for i in range(frame + 1)]
        wanted = late(times, AREAS[: frame + 1], seconds, REACH) if seconds else AREAS[frame]
        np.testing.assert_allclose(values, wanted, atol=1e-7)

    other, _ = flow(lag)
    for frame in (7, 2, 9, 0, 8):
        np.testing.assert_array_equal(other.field(places[frame]).values, in_order[frame])
        assert other.key(places[frame]) == forwards.key(places[frame])


def test_frames_have_the_time_that_their_numbers_say(tmp_path: Path) -> None:
    files = []
    for number, positions in zip((4, 10, 11), FRAMES[[0, 2, 4]], strict=True):
        files.append(tmp_path / f"shot.{number:04d}.npy")
        np.save(files[-1], positions)
    frames = FrameFiles(MeshFile(SQUARE), files)
    found = BloodFlow(SQUARE, frames, Lag(0.15, 24.0)).field(frames.places[-1]).values

    wanted = late([4 / 24, 10 / 24, 11 / 24], [AREAS[i] for i in (0, 2, 4)], 0.15, REACH)
    np.testing.assert_allclose(found, wanted, atol=1e-7)


def test_what_lies_far_back_changes_nothing() -> None:
    """Of 0.02 s at 24 frames per second, eight time constants are less than four frames."""
    lag = Lag(0.02, 24.0)
    here, places = flow(lag)
    changed = FRAMES.copy()
    changed[:4] *= 2.0
    there, _ = flow(lag, changed)
    assert here.key(places[7]) == there.key(places[7])
    assert here.key(places[6]) != there.key(places[6])
    assert here.key(places[7]) != flow(Lag(0.02, 25.0))[0].key(places[7])


def test_files_are_baked_anew_where_a_frame_before_them_changed(tmp_path: Path) -> None:
    """Frames of one value each have no area: the mask is black."""
    first = bake(FakeEngine(), tmp_path, [0.5] * 3, profiles=["blood"])
    again = bake(FakeEngine(), tmp_path, [0.5] * 3, profiles=["blood"])
    later = bake(FakeEngine(), tmp_path, [0.5, 0.4, 0.5], profiles=["blood"])

    assert (first.written, again.written, again.skipped) == (6, 0, 6)
    assert (later.written, later.skipped, later.replaced) == (4, 2, 4)
    assert first.replaced == again.replaced == 0
    found = read_texture(tmp_path / "face.blood.1001.0003.png")
    assert (found.texels == 0).all()
    assert float(found.attributes["minimum"]) == pytest.approx(-MOST)
    assert found.attributes["midlevel"] == "0.5000076295109483"
    assert (found.attributes["blood_seconds"], found.attributes["fps"]) == ("0.15", "24.0")
    facts = json.loads((tmp_path / "face.blood.json").read_text())
    assert (facts["blood_seconds"], facts["fps"]) == (0.15, 24.0)
