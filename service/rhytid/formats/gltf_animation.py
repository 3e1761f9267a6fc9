"""Animation of a glTF file: weights of its morph targets over time, as frames.

Channels of rotation, translation and scale are ignored, as transforms of nodes and skins are
(`gltf.py`). Before the first key and after the last a weight is constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.frame import check_positions
from rhytid.domain.mesh import ORIGIN, Centre
from rhytid.domain.wording import plural
from rhytid.errors import FrameError, MeshError
from rhytid.formats.frame_set import Clip, Frame, FrameSet, frames_between
from rhytid.formats.gltf import Document, glb_document, gltf_document
from rhytid.formats.limits import MAX_FRAME_NUMBERS, check_size

Numbers = NDArray[np.float64]
MODES = ("LINEAR", "STEP", "CUBICSPLINE")
# A frame this near to a key, in frames, is at the key: keys are float32 seconds.
_AT_KEY = 0.01


@dataclass(frozen=True)
class Keys:
    """Weights over time.  times: (K,) seconds, ascending.  values: (K, T), for CUBICSPLINE
    (K, 3, T): tangent before the key, value, tangent behind it."""

    times: Numbers
    values: Numbers
    mode: str

    def at(self, seconds: Numbers) -> Numbers:
        """(N, T) weights at times (N,)."""
        times = self.times
        values = self.values[:, 1] if self.mode == "CUBICSPLINE" else self.values
        if len(times) == 1:
            return np.repeat(values, len(seconds), axis=0)
        inside = np.clip(seconds, times[0], times[-1])
        key = np.searchsorted(times, inside, side="right") - 1
        if self.mode == "STEP":
            held: Numbers = values[key]
            return held
        key = np.minimum(key, len(times) - 2)
        span = (times[key + 1] - times[key])[:, None]
        t = (inside - times[key])[:, None] / span
        if self.mode == "LINEAR":
            mixed: Numbers = (1.0 - t) * values[key] + t * values[key + 1]
            return mixed
        behind, before = self.values[key, 2] * span, self.values[key + 1, 0] * span
        first = (2.0 * t**3 - 3.0 * t**2 + 1.0) * values[key] + (t**3 - 2.0 * t**2 + t) * behind
        last = (3.0 * t**2 - 2.0 * t**3) * values[key + 1] + (t**3 - t**2) * before
        total: Numbers = first + last
        return total


def animated(data: bytes, name: str) -> bool:
    """Whether the glTF file in `data`, called `name`, moves weights of its mesh."""
    return bool(_clips(_document(data, name)))


def read_gltf_frames(
    data: bytes, name: str, vertices: int, centre: Centre = ORIGIN, clip: Clip | None = None
) -> FrameSet:
    """The frames of a .gltf or .glb file: whole frames from the first key to the last, at
    `clip.fps` frames per second from time 0 on; the mesh itself where nothing moves its weights.

    Raises FrameError naming the animation, or those that there are; MeshError naming an object of
    the file; LimitError.
    """
    document, clip = _document(data, name), clip or Clip()
    where, primitive = document.primitive()
    base = document.attribute(where, primitive, "POSITION", 3)
    if len(base) != vertices:
        held = plural(len(base), "vertex", "vertices")
        raise FrameError(f"{where} has {held}, the neutral mesh has {vertices}")
    clips = _clips(document)
    if not clips and clip.clip is None:
        return FrameSet(1, lambda _: check_positions(base, vertices, centre))
    targets = document.objects_in(primitive, "targets", where)
    moving = [i for i, target in enumerate(targets) if target.get("POSITION") is not None]
    offsets = document.targets(where, primitive, vertices)[1]
    title, animation, channel = _chosen(clips, clip.clip)
    keys = _keys(document, animation, channel, title, len(targets))
    try:
        numbers = frames_between(*(keys.times[[0, -1]] * clip.fps))
    except FrameError as exc:
        raise FrameError(f"{title}: {exc}") from exc
    check_size(f"{title} weights", len(numbers) * max(len(targets), 1), MAX_FRAME_NUMBERS)
    weights = keys.at(_seconds(numbers, keys.times, clip.fps))[:, moving]

    def read(index: int) -> Frame:
        used = np.flatnonzero(weights[index])
        moved = base + np.tensordot(weights[index][used], offsets[used], 1)
        try:
            return check_positions(moved, vertices, centre)
        except FrameError as exc:
            raise FrameError(f"{title}, frame {numbers[index]}: {exc}") from exc

    return FrameSet(len(numbers), read, numbers)


def _document(data: bytes, name: str) -> Document:
    glb = PurePath(name).suffix.lower() == ".glb"
    return glb_document(data) if glb else gltf_document(data)


_Object = dict[str, Any]
_Named = tuple[str, _Object, _Object]


def _clips(document: Document) -> list[_Named]:
    """Titles of the animations that move weights of the one mesh, they, and their channels."""
    mesh = next(i for i, m in enumerate(document.objects("meshes")) if m.get("primitives"))
    nodes = [i for i, node in enumerate(document.objects("nodes")) if node.get("mesh") == mesh]
    found = []
    for number, animation in enumerate(document.objects("animations")):
        title = f"animation {number}"
        if isinstance(animation.get("name"), str):
            title += f" ({animation['name']!r:.60})"
        channels = [
            channel
            for channel in document.objects_in(animation, "channels", title)
            if _target(channel).get("path") == "weights" and _target(channel).get("node") in nodes
        ]
        if len(channels) > 1:
            raise MeshError(f"{title} moves the weights of the mesh by {len(channels)} channels")
        found += [(title, animation, channel) for channel in channels]
    return found


def _target(channel: Mapping[str, Any]) -> _Object:
    target = channel.get("target")
    return target if isinstance(target, dict) else {}


def _chosen(clips: list[_Named], name: str | None) -> _Named:
    if name is not None:
        for clip in clips:
            if name in (clip[1].get("name"), clip[0].split()[1]):
                return clip
    if name is None and len(clips) == 1:
        return clips[0]
    listed = ", ".join(title for title, _, _ in clips[:20]) or "none"
    asked = "one of them must be chosen by name" if name is None else f"none is {name!r}"
    raise FrameError(f"animations that move weights of the mesh: {listed}; {asked}")


def _keys(
    document: Document, animation: _Object, channel: _Object, title: str, targets: int
) -> Keys:
    samplers = document.objects_in(animation, "samplers", title)
    index = channel.get("sampler")
    if type(index) is not int or not 0 <= index < len(samplers):
        raise MeshError(f"{title}: no sampler {index!r:.40} of {len(samplers)}")
    sampler, where = samplers[index], f"{title} sampler {index}"
    mode = sampler.get("interpolation", "LINEAR")
    if mode not in MODES:
        raise MeshError(f"{where}: interpolation {mode!r:.40}: one of {', '.join(MODES)}")
    times = document.scalars(sampler.get("input"), f"{where} input")
    values = document.scalars(sampler.get("output"), f"{where} output")
    rows = (len(times), 3, targets) if mode == "CUBICSPLINE" else (len(times), targets)
    if not len(times) or len(values) != np.prod(rows):
        each = "three values" if mode == "CUBICSPLINE" else "a value"
        expected = f"{each} for each of {plural(len(times), 'key')} and {plural(targets, 'target')}"
        raise MeshError(f"{where}: {plural(len(values), 'weight')}, not {expected}")
    if not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise MeshError(f"{where}: times must ascend, and times and weights be finite")
    return Keys(times, values.reshape(rows), mode)


def _seconds(numbers: tuple[int, ...], keys: Numbers, fps: float) -> Numbers:
    """(N,) the times of frames; of those that are at a key, its time."""
    seconds = np.array(numbers, np.float64) / fps
    place = np.searchsorted(keys, seconds)
    near = np.stack([keys[np.maximum(place - 1, 0)], keys[np.minimum(place, len(keys) - 1)]])
    gaps = np.abs(near - seconds)
    nearest = np.where(gaps[0] <= gaps[1], near[0], near[1])
    return np.where(gaps.min(axis=0) * fps <= _AT_KEY, nearest, seconds)
