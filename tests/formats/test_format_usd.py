"""USD meshes and their animation: what is read, and what is refused with which words."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pxr", reason="usd-core has no wheel for this platform")

from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt

from formats.usd_files import (
    CORNERS,
    POINTS,
    TRIANGLES,
    UV,
    UV_TRIANGLES,
    add_mesh,
    matrix,
    new_stage,
    vectors,
    write_usd,
)
from formats.writers import same_mesh
from rhytid.errors import FrameError, InputError, LimitError, MeshError
from rhytid.formats.caches import read_cache, read_mesh_file
from rhytid.formats.frame_set import MOST_FRAMES, Clip
from rhytid.formats.meshes import MeshFile


def frame(number: float) -> Any:
    """Positions that no two frames share."""
    wave = np.sin(np.arange(POINTS.size).reshape(POINTS.shape) + number)
    return (POINTS + 0.125 * wave).astype(np.float32)


def samples(*times: float) -> dict[float, Any]:
    return {time: frame(time) for time in times}


def frames_of(read: MeshFile) -> dict[int, Any]:
    found = read.frame_set
    assert found is not None
    assert found.numbers is not None
    return {number: found.read(i) for i, number in enumerate(found.numbers)}


@pytest.mark.parametrize("extension", ["usda", "usdc", "usd"])
def test_mesh_frames_and_their_numbers(tmp_path: Path, extension: str) -> None:
    file = write_usd(tmp_path / f"face.{extension}", samples=samples(1001, 1002, 1003))

    read = read_mesh_file(file)

    same_mesh(read.mesh, POINTS, TRIANGLES, UV, UV_TRIANGLES)
    frames = frames_of(read)
    assert list(frames) == [1001, 1002, 1003]
    for number, positions in frames.items():
        np.testing.assert_array_equal(positions, frame(number))
        assert positions.dtype == np.float32


def test_a_mesh_without_samples_has_no_frames(tmp_path: Path) -> None:
    file = write_usd(tmp_path / "face.usda")

    assert read_mesh_file(file).frame_set is None
    found = read_cache(file, 5)
    assert (found.count, found.numbers) == (1, None)
    np.testing.assert_array_equal(found.read(0), POINTS)


def test_the_first_sample_is_the_neutral_where_there_is_no_default(tmp_path: Path) -> None:
    file = write_usd(tmp_path / "face.usda", points=None, samples=samples(5, 6))

    np.testing.assert_array_equal(read_mesh_file(file).mesh.positions, frame(5))


def test_between_samples_usd_interpolates(tmp_path: Path) -> None:
    """Writers leave out samples that repeat; samples within a frame are motion blur."""
    file = write_usd(tmp_path / "face.usda", samples=samples(1.75, 2, 4, 4.5))

    frames = frames_of(read_mesh_file(file))

    assert list(frames) == [2, 3, 4]
    np.testing.assert_array_equal(frames[2], frame(2))
    np.testing.assert_allclose(frames[3], (frame(2) + frame(4)) / 2, atol=1e-7)


def test_the_range_of_the_stage_says_which_frames_there_are(tmp_path: Path) -> None:
    file = write_usd(tmp_path / "face.usda", samples=samples(990, 1001, 1002))
    stage = Usd.Stage.Open(str(file))
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1004)
    stage.GetRootLayer().Save()

    frames = frames_of(read_mesh_file(file))

    assert list(frames) == [1001, 1002, 1003, 1004]
    np.testing.assert_array_equal(frames[1004], frame(1002))


def test_uv_by_vertex(tmp_path: Path) -> None:
    named = {"uv": UV[:5], "uv_indices": None, "interpolation": "vertex", "primvar": "UVMap"}
    read = read_mesh_file(write_usd(tmp_path / "face.usda", **named))

    same_mesh(read.mesh, POINTS, TRIANGLES, UV[:5], TRIANGLES)


def test_uv_by_vertex_with_indices(tmp_path: Path) -> None:
    order = [3, 0, 1, 4, 2]
    named = {"uv": UV[:5], "uv_indices": order, "interpolation": "varying"}
    read = read_mesh_file(write_usd(tmp_path / "face.usda", **named))

    same_mesh(read.mesh, POINTS, TRIANGLES, UV[:5], np.array(order)[TRIANGLES])


def test_corners_without_indices_share_what_is_the_same(tmp_path: Path) -> None:
    """Vertex 2 has one uv in both faces, vertex 1 two: there is the seam."""
    uv = UV.copy()
    uv[6] = uv[2]
    read = read_mesh_file(write_usd(tmp_path / "face.usda", uv=uv, uv_indices=None))

    wanted = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(read.mesh.triangle_uv(), uv[wanted])
    assert len(read.mesh.uv) == 6
    assert read.mesh.face_uv[0, 2] == read.mesh.face_uv[2, 2]
    assert read.mesh.face_uv[0, 1] != read.mesh.face_uv[2, 0]


def edited(tmp_path: Path, change: Any, **mesh: Any) -> Path:
    file = write_usd(tmp_path / "face.usda", **mesh)
    stage = Usd.Stage.Open(str(file))
    change(stage, UsdGeom.Mesh(stage.GetPrimAtPath("/root/face")))
    stage.GetRootLayer().Save()
    return file


def test_left_handed_faces_are_turned_over(tmp_path: Path) -> None:
    file = edited(tmp_path, lambda _, mesh: mesh.GetOrientationAttr().Set("leftHanded"))
    turn = [0, 2, 1]

    same_mesh(read_mesh_file(file).mesh, POINTS, TRIANGLES[:, turn], UV, UV_TRIANGLES[:, turn])


def test_holes_are_left_out(tmp_path: Path) -> None:
    file = edited(tmp_path, lambda _, mesh: mesh.GetHoleIndicesAttr().Set([0]))

    same_mesh(read_mesh_file(file).mesh, POINTS, TRIANGLES[2:], UV, UV_TRIANGLES[2:])


def test_transforms_are_applied_to_mesh_and_frames(tmp_path: Path) -> None:
    def move(stage: Any, mesh: Any) -> None:
        above = UsdGeom.Xformable(stage.GetPrimAtPath("/root"))
        above.AddTranslateOp().Set((1.0, 2.0, 3.0))
        UsdGeom.Xformable(mesh.GetPrim()).AddScaleOp().Set((2.0, 2.0, 2.0))

    read = read_mesh_file(edited(tmp_path, move, samples=samples(1, 2)))

    np.testing.assert_allclose(read.mesh.positions, 2.0 * POINTS + [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(frames_of(read)[2], 2.0 * frame(2) + [1, 2, 3], atol=1e-6)
    np.testing.assert_array_equal(read.mesh.faces, TRIANGLES)


def test_a_transform_that_moves_is_applied_frame_by_frame(tmp_path: Path) -> None:
    def move(stage: Any, _: Any) -> None:
        shift = UsdGeom.Xformable(stage.GetPrimAtPath("/root")).AddTranslateOp()
        for time in (1, 2):
            shift.Set((10.0 * time, 0.0, 0.0), time)

    read = read_mesh_file(edited(tmp_path, move, samples=samples(1, 2)))
    frames = frames_of(read)

    # Points have a default, the transform has none: the neutral is where the first frame is.
    np.testing.assert_allclose(read.mesh.positions, POINTS + np.array([10.0, 0, 0]), atol=1e-5)
    for number in (1, 2):
        wanted = frame(number) + np.array([10.0 * number, 0, 0])
        np.testing.assert_allclose(frames[number], wanted, atol=1e-5)


def test_a_mirroring_transform_turns_faces_over(tmp_path: Path) -> None:
    mirror = matrix(np.diag([-1.0, 1.0, 1.0, 1.0]))

    def move(_: Any, mesh: Any) -> None:
        UsdGeom.Xformable(mesh.GetPrim()).AddTransformOp().Set(mirror)

    read = read_mesh_file(edited(tmp_path, move))

    np.testing.assert_array_equal(read.mesh.positions, POINTS * [-1, 1, 1])
    np.testing.assert_array_equal(read.mesh.faces, TRIANGLES[:, [0, 2, 1]])


def test_far_from_the_origin_frames_are_less_the_centre_of_the_mesh(tmp_path: Path) -> None:
    def move(stage: Any, _: Any) -> None:
        UsdGeom.Xformable(stage.GetPrimAtPath("/root")).AddTranslateOp().Set((1e5 / 3, 0.1, 0.0))

    read = read_mesh_file(edited(tmp_path, move, samples=samples(1, 2)))

    assert read.mesh.centre.any()
    moved = frames_of(read)[2].astype(float) - read.mesh.positions
    np.testing.assert_allclose(moved, frame(2).astype(float) - POINTS, atol=3e-7)


@pytest.mark.parametrize(
    ("meters", "unit"), [(1.0, "m"), (0.01, "cm"), (0.001, "mm"), (0.0254, "in"), (None, None)]
)
def test_meters_per_unit_is_the_unit(tmp_path: Path, meters: float | None, unit: str) -> None:
    assert read_mesh_file(write_usd(tmp_path / "face.usda", meters)).unit == unit


def test_what_is_worth_knowing_is_noted(tmp_path: Path) -> None:
    assert read_mesh_file(write_usd(tmp_path / "plain.usda", 0.01)).notes == ()
    odd = read_mesh_file(write_usd(tmp_path / "odd.usda", 0.3, up="Z"))
    smooth = edited(tmp_path, lambda _, mesh: mesh.GetSubdivisionSchemeAttr().Set("catmullClark"))

    assert odd.unit is None
    assert "upAxis is Z and is kept" in odd.notes[0]
    assert "metersPerUnit is 0.3" in odd.notes[1]
    (told,) = read_mesh_file(smooth).notes
    assert told.startswith("/root/face has the subdivision scheme catmullClark")


def blend_shape(file: Path, weights: dict[float, float]) -> Path:
    """A mesh on a skeleton without joints, moved by one blend shape alone."""
    stage = new_stage(file)
    root = UsdSkel.Root.Define(stage, "/root")
    mesh = add_mesh(stage, "/root/face").GetPrim()
    animation = UsdSkel.Animation.Define(stage, "/root/skeleton/moves")
    animation.CreateBlendShapesAttr(["smile"])
    for time, weight in weights.items():
        animation.CreateBlendShapeWeightsAttr().Set([weight], time)
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/skeleton").GetPrim()
    UsdSkel.BindingAPI.Apply(skeleton).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    shape = UsdSkel.BlendShape.Define(stage, "/root/face/smile")
    shape.CreateOffsetsAttr(vectors(SMILE))
    binding = UsdSkel.BindingAPI.Apply(mesh)
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateBlendShapesAttr(["smile"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    assert root
    stage.GetRootLayer().Save()
    return file


SMILE = np.linspace(-0.25, 0.25, POINTS.size).reshape(POINTS.shape).astype(np.float32)


def test_blend_shapes_of_a_skeleton_are_frames(tmp_path: Path) -> None:
    file = blend_shape(tmp_path / "face.usda", {1: 0.0, 2: 0.5, 3: 1.0})
    before = file.read_bytes()

    read = read_mesh_file(file)

    same_mesh(read.mesh, POINTS, TRIANGLES, UV, UV_TRIANGLES)
    frames = frames_of(read)
    assert list(frames) == [1, 2, 3]
    for number, weight in ((1, 0.0), (2, 0.5), (3, 1.0)):
        np.testing.assert_allclose(frames[number], POINTS + weight * SMILE, atol=1e-7)
    assert file.read_bytes() == before
    assert not Sdf.Layer.FindOrOpen(str(file)).dirty


def several(tmp_path: Path) -> Path:
    stage = new_stage(tmp_path / "face.usda")
    for path in ("/a/head", "/a/eye", "/b/eye"):
        add_mesh(stage, path)
    stage.GetRootLayer().Save()
    return tmp_path / "face.usda"


def test_of_several_meshes_one_is_chosen(tmp_path: Path) -> None:
    file = several(tmp_path)

    same_mesh(read_mesh_file(file, Clip("head")).mesh, POINTS, TRIANGLES, UV, UV_TRIANGLES)
    same_mesh(read_mesh_file(file, Clip("/b/eye")).mesh, POINTS, TRIANGLES, UV, UV_TRIANGLES)


@pytest.mark.parametrize(
    ("prim", "told"),
    [
        (None, r"has 3 meshes, one must be chosen: /a/head \(5 points\), /a/eye .*, /b/eye"),
        ("eye", r"2 meshes are called 'eye': /a/eye .*, /b/eye"),
        ("/a", r"no mesh '/a' on the stage; there are: /a/head"),
    ],
)
def test_a_choice_that_is_none(tmp_path: Path, prim: str | None, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        read_mesh_file(several(tmp_path), Clip(prim))


def test_a_stage_without_a_mesh(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "empty.usda")
    stage.GetRootLayer().Save()
    with pytest.raises(MeshError, match="has no mesh"):
        read_mesh_file(tmp_path / "empty.usda")


@pytest.mark.parametrize("name", ["face.usda", "face.usdc", "face.usdz", "face.usd"])
def test_a_damaged_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"#usda 1.0\ndef {{{" if name.endswith("usda") else b"PXR-USDC")
    with pytest.raises(MeshError, match="USD cannot open it"):
        read_mesh_file(tmp_path / name)


@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        ({"counts": [4, 2], "corners": CORNERS[:6]}, "/root/face: faceVertexCounts: 2 corners"),
        ({"counts": [4, -3]}, "faceVertexCounts: -3 corners"),
        ({"counts": [4, 4]}, "add up to 8, not 7"),
        ({"counts": [2**31 - 1, 3]}, "add up to 2147483650, not 7"),
        ({"corners": [0, 1, 2, 3, 1, 5, 2]}, r"faceVertexIndices\[5\]: no point 5 of 5"),
        ({"corners": [0, 1, 2, -3, 1, 4, 2]}, r"faceVertexIndices\[3\]: no point -3 of 5"),
        ({"counts": [], "corners": []}, "no faces"),
        ({"uv": None}, "no primvar st of texture coordinates; pairs of numbers there: none"),
        ({"uv": UV[:6], "uv_indices": None}, "primvar st has 6 values, not 7"),
        ({"uv_indices": [0, 1, 2]}, "primvar st has 3 indices, not 7"),
        ({"uv_indices": [0, 1, 2, 3, 4, 5, 7]}, "primvar st, index 6: no value 7 of 7"),
        ({"interpolation": "uniform"}, "primvar st is uniform"),
        ({"points": None}, "/root/face has no points"),
        ({"points": np.where(POINTS == 2, np.inf, POINTS)}, "/root/face: position 4 is"),
    ],
)
def test_a_wrong_mesh_is_named(tmp_path: Path, mesh: dict[str, Any], told: str) -> None:
    with pytest.raises(MeshError, match=told):
        read_mesh_file(write_usd(tmp_path / "face.usda", **mesh))


def test_two_sets_of_uv_without_st(tmp_path: Path) -> None:
    def add(_: Any, mesh: Any) -> None:
        kind = Sdf.ValueTypeNames.Float2Array
        more = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("b", kind, "faceVarying")
        more.Set(vectors(UV, Vt.Vec2fArray))

    with pytest.raises(MeshError, match="pairs of numbers there: a, b"):
        read_mesh_file(edited(tmp_path, add, primvar="a"))


def test_topology_that_changes(tmp_path: Path) -> None:
    def change(_: Any, mesh: Any) -> None:
        corners = mesh.GetFaceVertexIndicesAttr()
        for time, order in ((1, CORNERS), (2, CORNERS), (3, CORNERS[::-1])):
            corners.Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(order)), time)

    with pytest.raises(MeshError, match="faceVertexIndices changes at time code 3"):
        read_mesh_file(edited(tmp_path, change))


def test_a_wrong_frame_is_named_and_the_others_are_read(tmp_path: Path) -> None:
    wrong = frame(2)
    wrong[3, 1] = np.nan
    file = write_usd(tmp_path / "face.usda", samples={1: frame(1), 2: wrong, 3: POINTS[:4]})
    found = read_cache(file, 5)

    np.testing.assert_array_equal(found.read(0), frame(1))
    with pytest.raises(FrameError, match=r"/root/face, frame 2: frame vertex 3 is \[.*nan"):
        found.read(1)
    with pytest.raises(FrameError, match=r"/root/face, frame 3: frame has 4 vertices, .* has 5"):
        found.read(2)


@pytest.mark.parametrize(
    ("times", "error", "told"),
    [
        ((-2, 1), FrameError, "/root/face: frame -2: the numbers of frames begin at 0"),
        ((0.25, 0.5), FrameError, "/root/face: there is no whole frame between 0.25 and 0.5"),
        ((1, 4e9), LimitError, f"4000000000 frames: at most {MOST_FRAMES}"),
    ],
)
def test_numbers_that_cannot_be_frames(
    tmp_path: Path, times: tuple[float, ...], error: type[Exception], told: str
) -> None:
    read = read_mesh_file(write_usd(tmp_path / "face.usda", samples=samples(*times)))
    with pytest.raises(error, match=told):
        _ = read.frame_set


def test_frames_are_the_expressions_of_the_mesh(tmp_path: Path) -> None:
    read = read_mesh_file(write_usd(tmp_path / "face.usda", samples=samples(7, 8)))

    shapes = read.expressions
    assert shapes is not None
    assert shapes.names == ("0000", "0001")
    np.testing.assert_array_equal(shapes.positions, np.stack([frame(7), frame(8)]))


def test_without_usd_core_the_message_says_what_to_install(tmp_path: Path) -> None:
    file = write_usd(tmp_path / "face.usda")
    program = (
        "import sys; sys.modules['pxr'] = None\n"
        "from pathlib import Path\n"
        "from rhytid.formats.caches import read_mesh_file\n"
        "from rhytid.errors import InputError\n"
        "try: read_mesh_file(Path(sys.argv[1]))\n"
        "except InputError as error: print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(file)], capture_output=True, text=True, check=True
    )
    assert "in a clone of rhytid: pip install '.[usd]'" in done.stdout


def test_alembic_says_what_to_do(tmp_path: Path) -> None:
    for read in (read_mesh_file, lambda file: read_cache(file, 5)):
        with pytest.raises(InputError, match="Alembic is not read here: convert it to USD"):
            read(tmp_path / "face.abc")
