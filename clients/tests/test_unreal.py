"""The script for Unreal, with an Unreal that is made up. It was not run in Unreal."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_unreal import STUB, Texture2D, Unreal, install

import stubs
from rhytid_client.hosts import Display, MapSequence, Trouble
from rhytid_client.hosts.sequences import NO_UDIM, UDIM_LAST

FRAMES = np.arange(3 * 4 * 3, dtype=np.float32).reshape(3, 4, 3)


@pytest.fixture
def unreal() -> Iterator[Unreal]:
    project = Unreal()
    install(project)
    yield project
    for name in ("unreal", "rhytid_unreal"):
        sys.modules.pop(name, None)


def mesh(folder: Path, **how: Any) -> Any:
    np.savez(folder / "face.npz", frames=FRAMES)
    given = {"content": "/Game/Face/", **how}
    return importlib.import_module("rhytid_unreal").UnrealMesh(folder / "face.npz", **given)


def display(folder: Path, udims: tuple[int, ...] = (1001,), **how: Any) -> Display:
    style = NO_UDIM if udims == (1001,) else UDIM_LAST
    maps = MapSequence.of(folder, "face", style, udims, range(1, 4))
    for udim in udims:
        for frame in maps.frames:
            maps.file(udim, frame).write_bytes(b"")
    return Display(maps, **{"start": 1, "scale": 2.0, "bound": 0.02, **how})


def test_positions_are_those_of_the_file(unreal: Unreal, tmp_path: Path) -> None:
    face = mesh(tmp_path, first=11)
    assert face.rest() == tmp_path / "face.npz"
    assert list(face.frames()) == [11, 12, 13]
    assert (face.positions(12) == FRAMES[1]).all()
    for wrong in (10, 14):
        with pytest.raises(Trouble, match=f"no frame {wrong}: frames are 11 to 13"):
            face.positions(wrong)


def test_frames_of_a_file_beside_the_mesh(unreal: Unreal, tmp_path: Path) -> None:
    np.save(tmp_path / "shot.npy", FRAMES[:2])
    assert list(mesh(tmp_path, frames=tmp_path / "shot.npy").frames()) == [1, 2]


@pytest.mark.parametrize("frames", [FRAMES[0], FRAMES[:0], FRAMES[..., :2]])
def test_frames_of_another_shape_are_told(
    unreal: Unreal, tmp_path: Path, frames: np.ndarray
) -> None:
    np.save(tmp_path / "shot.npy", frames)
    with pytest.raises(Trouble, match=r"has frames of shape .*, not \(N, V, 3\)"):
        mesh(tmp_path, frames=tmp_path / "shot.npy")


def test_a_file_without_frames_is_told(unreal: Unreal, tmp_path: Path) -> None:
    for name in ("none.npy", "mesh.npz"):
        np.savez(tmp_path / "mesh.npz", positions=FRAMES[0])
        with pytest.raises(Trouble, match=r"has no frames: give a \.npy"):
            mesh(tmp_path, frames=tmp_path / name)


def test_a_texture_for_each_frame(unreal: Unreal, tmp_path: Path) -> None:
    face = mesh(tmp_path)
    assert face.style((1001,)) == NO_UDIM
    face.show(display(tmp_path))
    assert unreal.imported == [str(tmp_path / f"face_f000{frame}.exr") for frame in (1, 2, 3)]
    textures = [thing for thing in unreal.saved if isinstance(thing, Texture2D)]
    assert len(textures) == 3
    for texture in textures:
        assert texture.values == {
            "srgb": False, "compression_settings": "TC_SINGLE_FLOAT",
            "virtual_texture_streaming": False, "address_x": "TA_CLAMP", "address_y": "TA_CLAMP",
        }  # fmt: skip


def test_tiles_are_imported_by_the_first_and_stream(unreal: Unreal, tmp_path: Path) -> None:
    face = mesh(tmp_path)
    assert face.style((1001, 1002)) == UDIM_LAST
    face.show(display(tmp_path, (1001, 1002)))
    names = [Path(file).name for file in unreal.imported]
    assert names == [f"face_f000{frame}.1001.exr" for frame in (1, 2, 3)]
    texture = unreal.saved[0]
    assert texture.values["virtual_texture_streaming"] is True
    assert "address_x" not in texture.values


@pytest.mark.parametrize(("unit", "magnitude"), [("cm", 2.0), ("m", 200.0), ("mm", 0.2)])
def test_displacement_has_its_true_size(
    unreal: Unreal, tmp_path: Path, unit: str, magnitude: float
) -> None:
    mesh(tmp_path, unit=unit).show(display(tmp_path))
    material = unreal.assets["/Game/Face/M_face_wrinkles"]
    scaling: Any = material.values.pop("displacement_scaling")
    assert (scaling.magnitude, scaling.center) == (pytest.approx(magnitude), 0.0)
    assert material.values == {"enable_tessellation": True, "used_with_nanite": True}
    assert unreal.compiled == [material]
    assert material in unreal.saved
    (sample,) = unreal.expressions
    assert sample.values == {"parameter_name": "Wrinkles", "texture": unreal.saved[0]}


def test_the_material_is_made_once(unreal: Unreal, tmp_path: Path) -> None:
    face = mesh(tmp_path)
    face.show(display(tmp_path))
    face.show(display(tmp_path, scale=3.0))
    (material,) = unreal.assets.values()
    scaling: Any = material.values["displacement_scaling"]
    assert scaling.magnitude == 3.0
    assert len(unreal.expressions) == 1


def test_what_python_cannot_connect_is_left_to_the_user(unreal: Unreal, tmp_path: Path) -> None:
    told = mesh(tmp_path).show(display(tmp_path))
    assert "lead R of its texture to Displacement" in told[1]
    assert "MP_DISPLACEMENT" not in stubs.cut(stubs.text(stubs.UNREAL), ["MaterialProperty"])


def test_what_unreal_refuses_is_told(unreal: Unreal, tmp_path: Path) -> None:
    unreal.refuses = True
    with pytest.raises(Trouble, match=r"Unreal has not imported .*face_f0001\.exr"):
        mesh(tmp_path).show(display(tmp_path))
    unreal.refuses = False
    unreal.assets["/Game/Face/M_face_wrinkles"] = Texture2D()
    with pytest.raises(Trouble, match="is no material"):
        mesh(tmp_path).show(display(tmp_path))


def test_progress_is_shown_and_cancelled(unreal: Unreal, tmp_path: Path) -> None:
    with mesh(tmp_path).working("Bake maps") as told:
        assert unreal.task.dialog
        assert told(0.25, "frame 3 of 9")
        assert unreal.task.done == pytest.approx(25)
        assert told(0.25, "frame 3 of 9")
        unreal.cancelled = True
        assert not told(1.0, "frame 9 of 9")
        assert unreal.task.done == pytest.approx(100)
    assert not unreal.task.open


def test_the_fake_knows_the_properties_of_the_stub() -> None:
    assert {"srgb", "address_x"} <= set(fake_properties("Texture2D"))
    with pytest.raises(RuntimeError, match="Failed to find property 'sRGB'"):
        Texture2D().set_editor_property("sRGB", False)
    assert STUB.methods("AssetImportTask", "get_objects")


def fake_properties(name: str) -> frozenset[str]:
    from fake_unreal import properties

    return properties(name)
