"""The script for Houdini, with a Houdini that is made up. It was not run in Houdini."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_houdini import Houdini, Operation, VopNode, install
from fake_maya import CUBE

from rhytid_client.hosts import Display, MapSequence, Trouble
from rhytid_client.hosts.sequences import STANDARD


@pytest.fixture
def houdini() -> Iterator[Houdini]:
    session = Houdini()
    install(session)
    yield session
    for name in ("hou", "rhytid_houdini"):
        sys.modules.pop(name, None)


def mesh(**how: Any) -> Any:
    module = importlib.import_module("rhytid_houdini")
    given = {"rest": "/obj/face/neutral", "material": "/stage/library/skin", **how}
    return module.HoudiniMesh(given.pop("path", "/obj/face/OUT"), **given)


def display(udims: tuple[int, ...] = (1001,), frames: range = range(3, 8), **how: Any) -> Display:
    maps = MapSequence.of(Path("/shot/maps"), "face", STANDARD, udims, frames)
    return Display(maps, **{"start": 3, "scale": 0.5, "bound": 0.02, **how})


def outward(rest: Any) -> np.ndarray:
    """How far the normal of each triangle looks away from the middle."""
    a, b, c = np.moveaxis(rest["positions"][rest["faces"]].astype(np.float64), 1, 0)
    return (np.cross(b - a, c - a) * ((a + b + c) / 3 - 0.5)).sum(axis=1)


@pytest.mark.parametrize("uv", ["vertex", "point"])
def test_the_rest_shape_faces_outward(houdini: Houdini, uv: str) -> None:
    houdini.uv = uv
    rest = mesh().rest()
    assert rest["positions"] == pytest.approx(CUBE)
    assert (outward(rest) > 0).all()


def test_uv_stay_with_their_corners(houdini: Houdini) -> None:
    rest = mesh().rest()
    # In the fake the first face begins at vertex 0 with UV (0, 0), the corner after it is 2.
    corners = {(int(v), *uv) for v, uv in zip(rest["faces"][:2].ravel(), _uv(rest), strict=True)}
    assert corners == {(0, 0, 0), (2, 0.25, 0), (3, 0.25, 0.25), (1, 0, 0.25)}


def _uv(rest: Any) -> list[tuple[float, ...]]:
    return [tuple(map(float, uv)) for uv in rest["uv"][rest["face_uv"][:2]].reshape(-1, 2)]


def test_positions_are_those_of_the_frame(houdini: Houdini) -> None:
    face = mesh()
    assert face.positions(10) == pytest.approx(CUBE * (2, 1, 1))
    assert (face.frame(), list(face.frames())) == (5, list(range(1, 25)))


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ({"uv": ""}, "'face_OUT' has no UV map"),
        ({"kind": "curve"}, "has primitives that are no polygons"),
        ({"empty": True}, "/obj/face/neutral has no geometry"),
    ],
)
def test_what_cannot_be_sent_is_told(houdini: Houdini, how: dict[str, Any], told: str) -> None:
    vars(houdini).update(how)
    with pytest.raises(Trouble, match=told):
        mesh().rest()


def test_what_is_no_sop_is_told(houdini: Houdini) -> None:
    with pytest.raises(Trouble, match="/obj/cam is no SOP"):
        mesh(path="/obj/cam")


def test_nodes_for_a_sequence(houdini: Houdini) -> None:
    mesh().show(display())
    image, height = (houdini.material.node(f"rhytid_{n}") for n in ("map", "height"))
    assert isinstance(image, VopNode)
    assert isinstance(height, VopNode)
    assert image.values == {
        "file": "/shot/maps/face.1001.$F4.exr", "signature": "default", "default": 0.0,
        "uaddressmode": "clamp", "vaddressmode": "clamp", "filtertype": "linear",
        "filecolorspace": "Raw",
    }  # fmt: skip
    assert height.values == {"scale": 0.5}
    assert height.inputs == {"displacement": (image, "out")}
    (output,) = (n for n in houdini.material.children() if n.kind == "suboutput")
    assert output.inputs == {"displacement": (height, "out")}


@pytest.mark.parametrize(
    ("udims", "frames", "start", "file"),
    [
        ((1001, 1002), range(3, 8), 3, "face.<UDIM>.$F4.exr"),
        ((1001,), range(3, 8), 101, "face.1001.`padzero(4, $F + -98)`.exr"),
        ((1001, 1002), range(7, 8), 7, "face.<UDIM>.0007.exr"),
    ],
)
def test_files_follow_the_playbar(
    houdini: Houdini, udims: tuple[int, ...], frames: range, start: int, file: str
) -> None:
    mesh().show(display(udims, frames, start=start))
    image = houdini.material.node("rhytid_map")
    assert image is not None
    assert image.values["file"] == f"/shot/maps/{file}"


def test_maps_are_shown_again_by_the_same_nodes(houdini: Houdini) -> None:
    face = mesh()
    face.show(display())
    nodes = houdini.material.children()
    face.show(display(scale=2.0))
    assert houdini.material.children() == nodes


def test_a_material_with_an_output_for_each(houdini: Houdini) -> None:
    houdini.material.inside.clear()
    for name in ("surface", "displacement"):
        node = houdini.material.createNode("subnetconnector", f"{name}_output")
        node.values["parmname"] = name
    mesh().show(display())
    output = houdini.material.inside["displacement_output"]
    assert output.inputs["suboutput"][0] is houdini.material.node("rhytid_height")
    assert houdini.material.inside["surface_output"].inputs == {}


def test_the_bound_is_told(houdini: Houdini) -> None:
    assert "Displacement Bound 0.02;" in mesh().show(display())[-1]
    assert "the largest height of the maps" in mesh().show(display(bound=None))[-1]


def test_a_material_that_is_missing_is_told(houdini: Houdini) -> None:
    with pytest.raises(Trouble, match="There is no material '/mat/none'"):
        mesh(material="/mat/none").show(display())
    houdini.material.inside.clear()
    with pytest.raises(Trouble, match="no output for displacement"):
        mesh().show(display())


def test_progress_is_shown_and_interrupted(houdini: Houdini) -> None:
    with mesh().working("Bake maps") as told:
        dialog = Operation.last
        assert dialog is not None
        assert told(0.25, "frame 3 of 9")
        assert dialog.told == [(0.25, "frame 3 of 9")]
        dialog.interrupted = True
        assert not told(0.5, "frame 5 of 9")
    assert not dialog.open


def test_no_dialog_without_windows(houdini: Houdini) -> None:
    houdini.windows = False
    Operation.last = None
    with mesh().working("Bake maps") as told:
        assert told(0.5, "")
    assert Operation.last is None
