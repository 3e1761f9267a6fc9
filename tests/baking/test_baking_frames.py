"""Which frames there are and which numbers they get."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cli.running import write_animation
from meshes import SmallMesh, deform
from rhytid.baking.frame_names import frame_labels
from rhytid.baking.frames import FrameFiles
from rhytid.domain.frame import frame_label
from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError
from rhytid.formats.meshes import MeshFile
from rhytid_lab.commands.demo_face import animation


def paths(*names: str) -> list[Path | None]:
    return [Path(name) for name in names]


@pytest.mark.parametrize(
    ("files", "labels"),
    [
        (paths("frame_0042.obj", "frame_0007.obj"), ["0042", "0007"]),
        (paths("a/shot1.obj", "b/shot2.npy"), ["0001", "0002"]),
        (paths("0.obj", "00010.obj"), ["0000", "0010"]),
        (paths("smile.obj", "frame_0042.obj"), ["smile", "frame_0042"]),
        (paths("neutral.obj", "smile.obj"), ["0001", "0002"]),
        (paths("a/smile.obj", "b/smile.obj"), ["0001", "0002"]),
        (paths("big smile.obj", "jaw.obj"), ["0001", "0002"]),
        (paths("smile.obj"), ["smile"]),
        (paths("v2_final.obj", "v3_final.obj"), ["v2_final", "v3_final"]),
    ],
)
def test_numbers_are_of_all_files_or_of_none(files: list[Path | None], labels: list[str]) -> None:
    assert frame_labels(files, [1] * len(files)) == labels


def test_files_of_many_frames_are_counted_through() -> None:
    assert frame_labels(paths("a1.npz", "b7.obj"), [2, 1]) == ["0001", "0002", "0003"]
    assert frame_labels([None], [3]) == ["0001", "0002", "0003"]


def test_two_files_of_one_number_are_refused() -> None:
    with pytest.raises(FrameError, match=r"a_01\.obj and b_1\.obj are both frame 1"):
        frame_labels(paths("a_01.obj", "b_1.obj"), [1, 1])


@given(st.lists(st.integers(0, 10**6), unique=True, min_size=1, max_size=20))
def test_numbers_survive_their_file_names(numbers: list[int]) -> None:
    files: list[Path | None] = [Path(f"shot.v2_{number:04d}.obj") for number in numbers]

    assert frame_labels(files, [1] * len(files)) == [f"{number:04d}" for number in numbers]


@pytest.mark.parametrize(("number", "label"), [(1, "0001"), (42, "0042"), (12345, "12345")])
def test_labels_have_four_digits_at_least(number: int, label: str) -> None:
    assert frame_label(number) == label


@pytest.fixture
def neutral(small_mesh: SmallMesh) -> MeshFile:
    return MeshFile(Mesh(*small_mesh))


def test_frames_of_several_files(tmp_path: Path, small_mesh: SmallMesh, neutral: MeshFile) -> None:
    archive = write_animation(tmp_path / "many.npz", small_mesh, 3)
    single = deform(small_mesh.positions, 9)
    np.save(tmp_path / "one.npy", single)

    frames = FrameFiles(neutral, [archive, tmp_path / "one.npy"])

    assert [place.label for place in frames.places] == ["0001", "0002", "0003", "0004"]
    assert np.array_equal(frames.read(frames.places[3]), single)
    with np.load(archive) as stored:
        assert np.array_equal(frames.read(frames.places[1]), stored["frames"][1])


def test_frames_of_the_mesh_itself(small_mesh: SmallMesh) -> None:
    mesh = Mesh(*small_mesh)
    own = np.stack([deform(small_mesh.positions, seed) for seed in (1, 2)])

    frames = FrameFiles(MeshFile(mesh, own), [])

    assert [place.label for place in frames.places] == ["0001", "0002"]
    assert np.array_equal(frames.read(frames.places[1]), own[1])


def test_no_frames_at_all_are_refused(neutral: MeshFile) -> None:
    with pytest.raises(FrameError, match="no frames"):
        FrameFiles(neutral, [])


def test_a_bad_frame_is_told_with_its_file(tmp_path: Path, neutral: MeshFile) -> None:
    np.save(tmp_path / "short.npy", np.zeros((3, 3), np.float32))

    with pytest.raises(FrameError, match=r"short\.npy: .*shape \(1, 3, 3\)"):
        FrameFiles(neutral, [tmp_path / "short.npy"])


@pytest.mark.slow
def test_the_built_in_animation_survives_its_file(tmp_path: Path) -> None:
    built_in = animation(None, [])
    built_in.save(tmp_path / "face.npz")

    again = animation(tmp_path / "face.npz", [])

    assert len(built_in.frames.places) == 17
    assert [p.label for p in again.frames.places] == [p.label for p in built_in.frames.places]
    last = built_in.frames.places[-2]
    assert np.array_equal(again.frames.read(last), built_in.frames.read(last))
    assert np.array_equal(again.mesh.face_uv, built_in.mesh.face_uv)
