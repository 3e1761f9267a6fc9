"""The script for Maya, with a Maya that is made up. It was not run in Maya."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_maya import CUBE, FACES, UV, Maya, install

from rhytid_client.hosts import Display, MapSequence, Trouble
from rhytid_client.hosts.sequences import STANDARD, UNPADDED

TEXTURE, HEIGHT = "rhytid_head_map", "rhytid_head_height"


@pytest.fixture
def maya() -> Iterator[Maya]:
    scene = Maya()
    install(scene)
    yield scene
    for name in [n for n in sys.modules if n.partition(".")[0] in ("maya", "rhytid_maya")]:
        del sys.modules[name]


def mesh(name: str = "head", **how: Any) -> Any:
    return importlib.import_module("rhytid_maya").MayaMesh(name, **how)


def display(udims: tuple[int, ...] = (1001,), frames: range = range(3, 8), **how: Any) -> Display:
    style = STANDARD if udims == (1001,) else UNPADDED
    maps = MapSequence.of(Path("/shot/maps"), "head", style, udims, frames)
    return Display(maps, **{"start": 101, "scale": 0.5, "bound": 0.02, **how})


def test_the_rest_shape_is_that_before_deformers(maya: Maya) -> None:
    rest = mesh().rest()
    assert rest["positions"] == pytest.approx(CUBE)
    assert rest["faces"].tolist() == [t for a, b, c, d in FACES for t in ([a, b, c], [a, c, d])]
    assert rest["uv"][rest["face_uv"]][:2] == pytest.approx(
        np.array([[UV[0], UV[1], UV[2]], [UV[0], UV[2], UV[3]]])
    )


def test_a_mesh_without_deformers_is_its_own_rest_shape(maya: Maya) -> None:
    maya.deformed = False
    assert mesh("headShape").rest()["positions"] == pytest.approx(CUBE)


def test_positions_are_those_of_the_frame(maya: Maya) -> None:
    face = mesh()
    assert face.positions(10) == pytest.approx(CUBE * (2, 1, 1))
    assert face.positions(20) == pytest.approx(CUBE * (3, 1, 1))
    assert face.unit == "cm"


def test_frames_are_those_of_the_playback_range(maya: Maya) -> None:
    face = mesh()
    assert list(face.frames()) == list(range(1, 25))
    assert face.frame() == 5


def test_a_face_without_uv_is_told(maya: Maya) -> None:
    maya.uv_ids = maya.uv_ids[4:]
    with pytest.raises(Trouble, match="'head' has no UV map"):
        mesh().rest()


@pytest.mark.parametrize(
    ("name", "told"),
    [("nobody", "There is no 'nobody' in the scene"), ("camera", "'camera' is no polygon mesh")],
)
def test_what_is_no_mesh_is_told(maya: Maya, name: str, told: str) -> None:
    with pytest.raises(Trouble, match=told):
        mesh(name)


def test_nodes_for_a_sequence(maya: Maya) -> None:
    mesh(iterations=5).show(display())
    assert {n: maya.values[f"{TEXTURE}.{n}"] for n in ("colorSpace", "fileTextureName")} == {
        "colorSpace": "Raw",
        "fileTextureName": "/shot/maps/head.1001.0003.exr",
    }
    numbers = {
        "ignoreColorSpaceFileRules": 1, "uvTilingMode": 0, "useFrameExtension": 1, "aiFilter": 1,
        "frameOffset": 3 - 101,
    }  # fmt: skip
    assert {n: maya.values[f"{TEXTURE}.{n}"] for n in numbers} == numbers
    assert f"{TEXTURE}.fileTextureNamePattern" not in maya.values
    assert maya.links == {
        f"{TEXTURE}.uvCoord": f"{TEXTURE}_uv.outUV",
        f"{TEXTURE}.uvFilterSize": f"{TEXTURE}_uv.outUvFilterSize",
        f"{TEXTURE}.frameExtension": f"{TEXTURE}_frame.output",
        f"{HEIGHT}.displacement": f"{TEXTURE}.outColorR",
        "skinSG.displacementShader": f"{HEIGHT}.displacement",
    }


def test_displacement_has_its_true_size(maya: Maya) -> None:
    mesh(iterations=5).show(display())
    shape = {
        "aiSubdivType": 1, "aiSubdivIterations": 5, "aiSubdivUvSmoothing": 2, "aiDispHeight": 0.5,
        "aiDispZeroValue": 0, "aiDispPadding": 0.02, "aiDispAutobump": True,
    }  # fmt: skip
    assert {name: maya.values[f"headShape.{name}"] for name in shape} == shape
    assert maya.values[f"{HEIGHT}.scale"] == 1.0
    assert maya.values[f"{HEIGHT}.aiDisplacementZeroValue"] == 0.0


def test_every_material_of_the_mesh_is_displaced(maya: Maya) -> None:
    maya.kinds["lipsSG"] = "shadingEngine"
    maya.groups = ["skinSG", "lipsSG", "skinSG"]
    told = mesh().show(display())
    assert told[0].endswith("displace skinSG, lipsSG")
    for group in ("skinSG", "lipsSG"):
        assert maya.links[f"{group}.displacementShader"] == f"{HEIGHT}.displacement"


def test_tiles_have_tokens_and_frames_without_zeros(maya: Maya) -> None:
    face = mesh()
    assert face.style((1001, 1002)) == UNPADDED
    assert face.style((1001,)) == STANDARD
    face.show(display((1001, 1002)))
    assert maya.values[f"{TEXTURE}.uvTilingMode"] == 3
    pattern = maya.values[f"{TEXTURE}.fileTextureNamePattern"]
    assert pattern == "/shot/maps/head.<UDIM>.<f>.exr"


def test_one_frame_is_no_sequence(maya: Maya) -> None:
    mesh().show(display((1001, 1002), range(7, 8)))
    assert maya.values[f"{TEXTURE}.useFrameExtension"] == 0
    pattern = maya.values[f"{TEXTURE}.fileTextureNamePattern"]
    assert pattern == "/shot/maps/head.<UDIM>.7.exr"
    assert f"{TEXTURE}.frameExtension" not in maya.links


def test_maps_are_shown_again_by_the_same_nodes(maya: Maya) -> None:
    face = mesh()
    face.show(display())
    nodes = dict(maya.kinds)
    face.show(display(scale=2.0, start=3))
    assert maya.kinds == nodes
    assert maya.values["headShape.aiDispHeight"] == 2.0
    assert maya.values[f"{TEXTURE}.frameOffset"] == 0


def test_a_bound_that_is_unknown_is_left_to_the_user(maya: Maya) -> None:
    told = mesh().show(display(bound=None))
    assert told[-1].startswith("Left for you: Bounds Padding")
    assert maya.values["headShape.aiDispPadding"] == 0.0


def test_what_stands_in_the_way_is_told(maya: Maya) -> None:
    maya.arnold = False
    with pytest.raises(Trouble, match="load its plug-in 'mtoa'"):
        mesh().show(display())
    maya.arnold, maya.groups = True, ["initialShadingGroup"]
    with pytest.raises(Trouble, match="material of its own"):
        mesh().show(display())
    maya.groups, maya.kinds["other"] = ["skinSG"], "displacementShader"
    maya.links["skinSG.displacementShader"] = "other.displacement"
    with pytest.raises(Trouble, match="'skinSG' has a displacement of its own, 'other'"):
        mesh().show(display())
    assert maya.links["skinSG.displacementShader"] == "other.displacement"


def test_progress_is_shown_and_cancelled(maya: Maya) -> None:
    face = mesh()
    with face.working("Bake maps") as told:
        assert told(0.25, "frame 3 of 9")
        assert maya.window is not None
        assert maya.window["progress"] == 25
        assert maya.window["status"] == "frame 3 of 9"
        assert maya.window["isInterruptable"]
        maya.cancelled = True
        assert not told(0.5, "frame 5 of 9")
        face.positions(9)
    assert maya.window is None
    assert maya.time == 5


def test_the_window_closes_whatever_happens(maya: Maya) -> None:
    with pytest.raises(KeyError), mesh().working("Bake maps"):
        raise KeyError
    assert maya.window is None


def test_no_window_without_windows(maya: Maya) -> None:
    maya.batch = True
    with mesh().working("Bake maps") as told:
        assert maya.window is None
        assert told(0.5, "")
