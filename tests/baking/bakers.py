"""Bakers of frames full of one value each, over an engine that draws nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from baking.fake_engine import ASSET, FakeEngine
from rhytid.baking.baker import Baker
from rhytid.baking.frame_names import FramePlace, FrameRange
from rhytid.baking.frames import FrameFiles
from rhytid.baking.output import Output
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import MapQuery
from rhytid.exports.textures.profiles import profiles_of
from rhytid.formats.meshes import MeshFile
from rhytid.support.console import Stopwatch

SQUARE = Mesh(
    positions=[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    faces=[[0, 1, 2], [0, 2, 3]],
    uv=[[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]],
    face_uv=[[0, 1, 2], [0, 2, 3]],
)

QUERY = ("method", "stretch", "sampling")


def baker(engine: FakeEngine, folder: Path, values: list[float], **changes: Any) -> Baker:
    """A baker of frames full of one value each."""
    frames = np.stack([np.full((4, 3), value, np.float32) for value in values])
    part = FrameRange.parse(changes["part"]) if "part" in changes else None
    output = Output(folder, "face", profiles_of(changes.get("profiles", ["float"])), part)
    query = MapQuery(**{key: changes[key] for key in QUERY if key in changes})
    files = FrameFiles(MeshFile(SQUARE, frames), [])
    return Baker(
        cast("Any", engine),
        ASSET,
        SQUARE,
        query,
        files,
        output,
        Stopwatch(),
        RunWarnings("bake", False),
    )


def bake(engine: FakeEngine, folder: Path, values: list[float], **changes: Any) -> Baker:
    folder.mkdir(exist_ok=True)
    baking = baker(engine, folder, values, **changes)
    baking.run()
    return baking


def maps(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.glob("*.exr"))


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def interrupted_after_one(places: Sequence[FramePlace]) -> Iterator[FramePlace]:
    yield places[0]
    raise KeyboardInterrupt
