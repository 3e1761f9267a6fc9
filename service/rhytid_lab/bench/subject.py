"""The subjects of the report: meshes with a few expressions, and wrinkles grown on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import busiest_udim
from rhytid.engine.frames import Frame, LogStretch
from rhytid.pipeline.stretch import StretchStage, r_max_of
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.progress import Progress, silent
from rhytid_lab.bench.skin import Skin
from rhytid_lab.samples.face import procedural_face
from rhytid_lab.samples.sphere import SPHERE_STRETCHES, sphere, sphere_stretch

FACE_KEYS = ("smile", "jaw_open", "brow_furrow", "brow_raise", "pucker")
MOST_FRAMES = len(FACE_KEYS)
# As dense as figures and studies are drawn, at this many texels per side: what they show depends on
# how many texels lie between pores.
USUAL_WRINKLES, USUAL_SIZE = 300_000, 4096


@dataclass(frozen=True, eq=False)
class Subject:
    """A mesh and named frames of it.

    title: as the report calls it.  r_max: the 90th percentile of |log stretch| of `strongest`, the
    frame that stretches most (section 2.4).
    """

    title: str
    mesh: Mesh
    frames: Mapping[str, Frame]
    strongest: str
    r_max: float

    @property
    def udim(self) -> int:
        """The UDIM that is drawn."""
        return busiest_udim(self.mesh)

    def skin(self, device: Device, grown: Grown, resolution: int, **changes: object) -> Skin:
        """Return its wrinkles on a device, with the fast method calibrated.  changes: settings as
        JSON."""
        settings = self.settings(grown, resolution, **changes)
        return Skin(device, self.mesh, grown.graph, settings, self.udim)

    def settings(self, grown: Grown, resolution: int, **changes: object) -> AssetSettings:
        """Return settings for these wrinkles, calibrated, with the paper's bins.  changes: more, as
        JSON."""
        usual = {"resolution": resolution, "preset": "paper"}
        settings = AssetSettings.parse({**usual, **changes})
        return settings.resolved(grown.spacing).with_r_max(self.r_max)


@dataclass(frozen=True, eq=False)
class Grown:
    """A wrinkle graph and the mean spacing of its pores, mesh units."""

    graph: WrinkleGraph
    spacing: float


def built_in_face(device: Device) -> Subject:
    """Return the procedural face in five expressions."""
    face = procedural_face()
    poses = {key: face.pose({key: 1.0}) for key in FACE_KEYS}
    return measured(device, "the built-in face", face.mesh, poses)


def built_in_sphere(device: Device) -> Subject:
    """Return the sphere of Fig. 5 under its four deformations."""
    mesh = sphere()
    poses = {name: sphere_stretch(mesh, *ab) for name, ab in SPHERE_STRETCHES.items()}
    return measured(device, "the sphere", mesh, poses)


def given_face(
    device: Device, title: str, mesh: Mesh, poses: Mapping[str, NDArray[np.float32]]
) -> Subject:
    """Return a user's face in those of its frames that stretch most.  poses: (V, 3) by name."""
    sizes = _sizes(device, mesh, [Frame.of(pose) for pose in poses.values()])
    names = list(poses)
    shown = {names[i]: poses[names[i]] for i in most_stretched(sizes)}
    return measured(device, title, mesh, shown)


def most_stretched(sizes: Sequence[float], most: int = MOST_FRAMES) -> list[int]:
    """Return indices of at most `most` frames: the largest of each equal part of the animation."""
    parts = np.array_split(np.arange(len(sizes)), min(most, len(sizes)))
    found = [int(part[np.argmax(np.asarray(sizes)[part])]) for part in parts]
    return sorted(found, key=lambda index: -sizes[index])


def measured(
    device: Device, title: str, mesh: Mesh, poses: Mapping[str, NDArray[np.float32]]
) -> Subject:
    """Return a subject that is calibrated from the frame that stretches most."""
    frames = {name: Frame.of(positions) for name, positions in poses.items()}
    sizes = _sizes(device, mesh, list(frames.values()))
    strongest = list(frames)[int(np.argmax(sizes))]
    return Subject(title, mesh, frames, strongest, max(sizes))


def grow(device: Device, mesh: Mesh, wrinkles: int, progress: Progress = silent) -> Grown:
    """Synthesise a graph of so many wrinkles: the even skin of the paper, whatever draws it."""
    settings = AssetSettings.parse({"preset": "paper", "graph": {"wrinkles": wrinkles}})
    made = synthesize(mesh, settings.graph, device, progress)
    return Grown(made.graph, made.spacing)


def _sizes(device: Device, mesh: Mesh, frames: Sequence[Frame]) -> list[float]:
    """Return r_max of each frame."""
    limit = AssetSettings().response.log_stretch_limit
    stage = StretchStage(device, mesh)
    sizes = []
    for frame in frames:
        found = stage.run(frame.positions, limit)
        sizes.append(r_max_of(stage.read(found)[0], limit))
        found.release()
    stage.release()
    return sizes


def describe(subject: Subject, skin: Skin) -> dict[str, dict[str, float]]:
    """Return percentiles of the clamped log stretch of each frame."""
    limit = skin.settings.response.log_stretch_limit
    return {
        name: LogStretch.of(skin.stretch(frame)[0]).percentiles(limit)
        for name, frame in subject.frames.items()
    }
