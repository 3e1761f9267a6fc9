"""Animated weights of morph targets: against formulas of the specification written out here."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from formats.writers import SQUARE, SQUARE_FACES, SQUARE_UV, glb, gltf
from rhytid.errors import FrameError, LimitError, MeshError
from rhytid.formats.caches import read_mesh_file
from rhytid.formats.frame_set import MOST_FRAMES, Clip, FrameSet
from rhytid.formats.gltf_animation import animated, read_gltf_frames

RNG = np.random.default_rng(5)
OFFSETS = RNG.normal(size=(2, 4, 3)).astype(np.float32)
# Keys at frames 2, 3 and 6 of 24 per second.
TIMES = np.array([2, 3, 6], np.float32) / np.float32(24)
WEIGHTS = np.array([[0.0, 0.25], [1.0, 0.5], [0.5, -1.0]], np.float32)
TANGENTS = RNG.normal(size=(3, 2, 2)).astype(np.float32)
SPLINE = np.stack([TANGENTS[:, 0], WEIGHTS, TANGENTS[:, 1]], axis=1)

Channel = tuple[Sequence[float] | np.ndarray[Any, Any], np.ndarray[Any, Any], str]


def animation(*clips: Channel, offsets: Any = OFFSETS, **names: str) -> dict[str, Any]:
    """A document with two targets, and an animation for each of (times, output, mode)."""
    arrays: dict[str, Any] = {
        "POSITION": SQUARE,
        "TEXCOORD_0": SQUARE_UV.astype(np.float32),
        "indices": SQUARE_FACES.reshape(-1, 1).astype(np.uint16),
    }
    arrays |= {f"_T{i}": offset for i, offset in enumerate(offsets)}
    for i, (times, output, _) in enumerate(clips):
        arrays |= {f"_I{i}": np.asarray(times, np.float32).reshape(-1, 1)}
        arrays |= {f"_O{i}": output.reshape(-1, 1)}
    document = gltf(arrays)
    primitive = document["meshes"][0]["primitives"][0]
    places = primitive["attributes"]
    primitive["targets"] = [{"POSITION": places.pop(f"_T{i}")} for i in range(len(offsets))]
    document["nodes"] = [{"children": [1]}, {"mesh": 0}]
    document["animations"] = [
        {
            "name": f"clip{i}",
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "weights"}}],
            "samplers": [
                {
                    "input": places.pop(f"_I{i}"),
                    "output": places.pop(f"_O{i}"),
                    "interpolation": mode,
                }
            ],
        }
        for i, (_, _, mode) in enumerate(clips)
    ]
    return document


def text(document: Any) -> bytes:
    return json.dumps(document).encode()


def read(document: Any, clip: Clip | None = None) -> FrameSet:
    return read_gltf_frames(text(document), "face.gltf", 4, clip=clip)


def positions(weights: Any) -> Any:
    return SQUARE + np.tensordot(np.asarray(weights, float), OFFSETS, 1)


def check(found: FrameSet, wanted: dict[int, Any]) -> None:
    assert found.numbers == tuple(wanted)
    for i, weights in enumerate(wanted.values()):
        np.testing.assert_allclose(found.read(i), positions(weights), atol=2e-7)


def test_linear() -> None:
    found = read(animation((TIMES, WEIGHTS, "LINEAR")))

    between = {4: WEIGHTS[1] * 2 / 3 + WEIGHTS[2] / 3, 5: WEIGHTS[1] / 3 + WEIGHTS[2] * 2 / 3}
    check(found, {2: WEIGHTS[0], 3: WEIGHTS[1], **between, 6: WEIGHTS[2]})
    exact = positions(WEIGHTS[1].astype(float)).astype(np.float32)
    np.testing.assert_array_equal(found.read(1), exact)


def test_step_holds_a_value_up_to_the_next_key() -> None:
    found = read(animation((TIMES, WEIGHTS, "STEP")))

    check(found, {2: WEIGHTS[0], 3: WEIGHTS[1], 4: WEIGHTS[1], 5: WEIGHTS[1], 6: WEIGHTS[2]})


def hermite(t: float, span: float) -> Any:
    """Between keys 1 and 2: the cubic with these ends and slopes, solved for its coefficients."""
    ends, slopes = WEIGHTS[1:].astype(float), (TANGENTS[1, 1] * span, TANGENTS[2, 0] * span)
    rows = [[1, 0, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0], [0, 1, 2, 3]]
    cubic = np.linalg.solve(rows, np.stack([*ends, *slopes]))
    return np.array([1, t, t**2, t**3]) @ cubic


def test_cubic_spline() -> None:
    found = read(animation((TIMES, SPLINE, "CUBICSPLINE")))

    between = {4: hermite(1 / 3, 3 / 24), 5: hermite(2 / 3, 3 / 24)}
    check(found, {2: WEIGHTS[0], 3: WEIGHTS[1], **between, 6: WEIGHTS[2]})


def test_the_rate_says_which_frames_there_are() -> None:
    found = read(animation((TIMES, WEIGHTS, "LINEAR")), Clip(fps=48))

    assert found.numbers == tuple(range(4, 13))
    np.testing.assert_allclose(found.read(1), positions((WEIGHTS[0] + WEIGHTS[1]) / 2), atol=2e-7)


def test_keys_far_from_0_are_met() -> None:
    """A float32 of many seconds is not the time of its frame, and a step must not be late."""
    frames = np.arange(86_400, 86_404)
    times = (frames / 24.0).astype(np.float32)
    weights = np.eye(2, dtype=np.float32)[[0, 1, 0, 1]]
    found = read(animation((times, weights, "STEP")))

    check(found, dict(zip(frames.tolist(), weights, strict=True)))


@pytest.mark.parametrize("mode", ["LINEAR", "STEP"])
def test_one_key_is_one_frame(mode: str) -> None:
    check(read(animation(([0.5], WEIGHTS[1:2], mode))), {12: WEIGHTS[1]})


@pytest.mark.parametrize("dtype", [np.uint8, np.int8, np.uint16])
def test_normalised_weights(dtype: Any) -> None:
    most = np.iinfo(dtype).max
    codes = np.array([[0, most], [most, 0]], dtype)
    document = animation(([0.0, 1 / 24], codes, "LINEAR"))
    with pytest.raises(MeshError, match="that are not normalized"):
        read(document)
    document["accessors"][-1]["normalized"] = True
    check(read(document), {0: [0, 1], 1: [1, 0]})


def test_targets_without_positions_keep_their_weights_apart() -> None:
    document = animation((TIMES, WEIGHTS, "LINEAR"))
    primitive = document["meshes"][0]["primitives"][0]
    primitive["targets"][0] = {"NORMAL": primitive["targets"][0]["POSITION"]}

    np.testing.assert_allclose(read(document).read(1), SQUARE + 0.5 * OFFSETS[1], atol=2e-7)


def test_several_animations_and_the_one_that_is_chosen() -> None:
    document = animation((TIMES, WEIGHTS, "LINEAR"), ([0.0], WEIGHTS[2:], "STEP"))

    assert read(document, Clip(clip="clip0")).numbers == (2, 3, 4, 5, 6)
    assert read(document, Clip(clip="1")).numbers == (0,)
    listed = r"animation 0 \('clip0'\), animation 1 \('clip1'\)"
    with pytest.raises(FrameError, match=f"{listed}; one of them must be chosen"):
        read(document)
    with pytest.raises(FrameError, match=f"{listed}; none is 'walk'"):
        read(document, Clip(clip="walk"))


def test_what_moves_something_else_is_passed_over() -> None:
    document = animation((TIMES, WEIGHTS, "LINEAR"), (TIMES, WEIGHTS, "LINEAR"))
    document["animations"][0]["channels"][0]["target"] = {"node": 1, "path": "rotation"}
    assert read(document).numbers == (2, 3, 4, 5, 6)

    document["animations"][1]["channels"][0]["target"]["node"] = 0
    assert not animated(text(document), "face.gltf")
    still = read(document)
    assert (still.count, still.numbers) == (1, None)
    np.testing.assert_array_equal(still.read(0), SQUARE)


@pytest.mark.parametrize("extension", ["gltf", "glb"])
def test_the_mesh_file_has_frames_and_shapes(tmp_path: Path, extension: str) -> None:
    document = animation((TIMES, WEIGHTS, "LINEAR"))
    file = tmp_path / f"face.{extension}"
    file.write_bytes(glb(document) if extension == "glb" else text(document))

    found = read_mesh_file(file)

    assert found.shapes is not None
    assert len(found.shapes) == 2
    assert found.expressions is found.shapes
    assert found.frame_set is not None
    np.testing.assert_allclose(found.frame_set.read(1), positions(WEIGHTS[1]), atol=2e-7)


def sampler(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document["animations"][0]["samplers"][0].update(values)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (sampler(interpolation="BEZIER"), "animation 0 .* sampler 0: interpolation 'BEZIER'"),
        (sampler(interpolation="CUBICSPLINE"), "6 weights, not three values for each of 3 keys"),
        (sampler(input=99), r"sampler 0 input: no accessors\[99\] of 7"),
        (sampler(output=5), "sampler 0: 3 weights, not a value for each of 3 keys and 2 targets"),
        (
            lambda document: document["animations"][0]["channels"][0].update(sampler=1),
            "no sampler 1 of 1",
        ),
        (
            lambda document: document["animations"][0]["channels"].append(
                document["animations"][0]["channels"][0]
            ),
            "moves the weights of the mesh by 2 channels",
        ),
        (
            lambda document: document["accessors"][6].update(count=4_000_000_000),
            "holds 4000000000 numbers",
        ),
        (
            lambda document: document["accessors"][6].update(count=4_000_000),
            "16000000 bytes promised, its bufferView has 24",
        ),
    ],
)
def test_a_wrong_animation_is_named(change: Any, told: str) -> None:
    document = animation((TIMES, WEIGHTS, "LINEAR"))
    change(document)
    with pytest.raises((MeshError, LimitError), match=told):
        read(document)


@pytest.mark.parametrize("times", [[0.0, 0.5, 0.5], [0.0, 1.0, 0.5], [0.0, math.nan, 1.0]])
def test_times_must_ascend(times: list[float]) -> None:
    with pytest.raises(MeshError, match="times must ascend, and times and weights be finite"):
        read(animation((times, WEIGHTS, "LINEAR")))


@pytest.mark.parametrize(
    ("times", "error", "told"),
    [
        ([-1.0, 0.0, 1.0], FrameError, "frame -24: the numbers of frames begin at 0"),
        ([0.01, 0.02, 0.03], FrameError, "no whole frame between 0.24 and 0.72"),
        ([0.0, 1.0, 1e9], LimitError, f"at most {MOST_FRAMES}"),
        ([0.0, 1.0, 3e38], LimitError, f"at most {MOST_FRAMES}"),
    ],
)
def test_times_that_are_no_frames(times: list[float], error: Any, told: str) -> None:
    with pytest.raises(error, match=told):
        read(animation((times, WEIGHTS, "LINEAR")))


def test_a_frame_beyond_float32_is_named() -> None:
    weights = WEIGHTS.copy()
    weights[1] = 3e38
    found = read(animation((TIMES, weights, "STEP"), offsets=100 * OFFSETS))

    with pytest.raises(FrameError, match=r"animation 0 \('clip0'\), frame 3: frame vertex 0"):
        found.read(1)


def test_the_vertices_of_another_mesh() -> None:
    with pytest.raises(FrameError, match="has 4 vertices, the neutral mesh has 5"):
        read_gltf_frames(text(animation((TIMES, WEIGHTS, "LINEAR"))), "face.gltf", 5)
