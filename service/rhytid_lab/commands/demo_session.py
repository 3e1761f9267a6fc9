"""The requests of the demo to the server, timed step by step, and its contact sheets."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypedDict

from numpy.typing import NDArray

from rhytid import __version__
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.notices import Notice
from rhytid.domain.tiles import busiest_udim, triangles_inside, udim_origin
from rhytid.domain.warnings import InputWarning
from rhytid.support.atomic_files import atomic_write
from rhytid.support.console import Stopwatch, counted, share_bar
from rhytid.support.ownership import is_real_folder
from rhytid_client import Asset, Client, Job, Method, Sampling, StretchModel, Tile, TileFormat
from rhytid_lab import contact_sheets
from rhytid_lab.commands.demo_face import MESH_ARRAYS, Animation

METHODS: tuple[Method, ...] = ("redraw", "binned")
FIGURES = "times.json"
_MAP = re.compile(r"face\.1\d{3}\.\d+\.exr", re.ASCII)
_SHEET = re.compile(r"contact_\d+\.png", re.ASCII)
# The stages of a build at which another step of the table begins.
_STEPS = {"placing pores and wrinkles": "placing", "making bins": "bins"}
SHEETS = 4


def remove_earlier(out: Path) -> None:
    """Remove the maps and sheets of an earlier run, perhaps of a longer animation. Its figures
    prove that there was a run; without them all files are somebody else's."""
    try:
        found = json.loads((out / FIGURES).read_bytes())
    except (OSError, ValueError):
        return
    if not (isinstance(found, dict) and {"key_frames", "wrinkles", "r_max"} <= found.keys()):
        return
    for folder, name in ((out, _SHEET), *((out / method, _MAP) for method in METHODS)):
        for file in folder.iterdir() if is_real_folder(folder) else ():
            if name.fullmatch(file.name) and not is_real_folder(file):
                file.unlink()


class Query(TypedDict):
    """The stretch model and the sampling of maps."""

    stretch: StretchModel
    sampling: Sampling


class Session:
    """One asset and its animation, through the SDK.  query: stretch and sampling of its maps."""

    def __init__(
        self,
        client: Client,
        face: Animation,
        out: Path,
        query: Query,
        warned: RunWarnings,
    ) -> None:
        self.client, self.face, self.out = client, face, out
        self.query, self.warned = query, warned
        self.watch = Stopwatch()
        self.asset: Asset
        # The 90th percentile of the absolute log stretch of every frame.
        self.sizes: list[float] = []

    @property
    def frames(self) -> list[FramePlace]:
        """Every frame of the animation."""
        return self.face.frames.places

    def build(
        self,
        settings: Mapping[str, Any],
        stiffness: Sequence[Path] = (),
        controls: Mapping[str, Sequence[Path]] | None = None,
    ) -> None:
        """Send the mesh, stiffness maps, and maps that guide synthesis; wait for its wrinkles."""
        mesh = self.face.mesh
        arrays = {name: getattr(mesh, name) for name in MESH_ARRAYS}
        with self.watch.step("upload"), share_bar("upload") as show:
            asset = self.client.create_asset(
                arrays,
                settings=settings,
                stiffness=stiffness,
                controls=controls,
                shapes=self.face.shapes,
                progress=lambda sent, total: show(sent / total, ""),
            )
        with share_bar("build") as show:
            clock = StepClock(self.watch, show)
            self.asset = self.client.wait(asset, progress=clock.follow)
            clock.stop()
        assert self.asset.statistics is not None
        resolved = AssetSettings.parse(self.asset.settings)
        spacing = self.asset.statistics["spacing"]
        self.warned.lengths(resolved, spacing, self.asset.wrinkles)
        self.warned.add_notices(Notice(n.code, n.detail) for n in self.asset.notices)

    def send_frames(self) -> None:
        """Send every frame, then calibrate from the one that stretches most."""
        for frame in counted(self.frames, "frames", "frame"):
            positions = self.face.frames.read(frame)
            with self.watch.step("stretch"):
                stored = self.client.put_frame(self.asset, frame.label, positions, raw=True)
            self.warned.frame((InputWarning(**asdict(w)) for w in stored.warnings), frame.name)
            self.sizes.append(stored.log_stretch["abs_p90"])
        most = self.frames[self.sizes.index(max(self.sizes))]
        with self.watch.step("calibrate, bins"), share_bar("calibrate") as show:
            job = self.client.calibrate(self.asset, self.face.frames.read(most))
            self.client.wait(job, progress=lambda job: show(job.progress, job.stage))
        self.asset = self.client.asset(self.asset)

    def draw(self) -> None:
        """Write every map of every method as the EXR file that the server sends, in place of what
        an earlier run wrote."""
        remove_earlier(self.out)
        for method in METHODS:
            folder = self.out / method
            folder.mkdir(exist_ok=True)
            for frame in counted(self.frames, method, "frame"):
                for udim in self.asset.udims:
                    with self.watch.step(f"{method}, as EXR"):
                        map = self.map(frame, udim, method, "exr")
                    with atomic_write(folder / f"face.{udim}.{frame.label}.exr") as aside:
                        aside.write_bytes(map.content)

    def map(self, frame: FramePlace, udim: int, method: Method, format: TileFormat = "npy") -> Tile:
        """A whole map of a frame."""
        stretch, sampling = self.query["stretch"], self.query["sampling"]
        return self.client.map(
            self.asset, frame.label, udim,
            method=method, stretch=stretch, sampling=sampling, format=format,
        )  # fmt: skip

    def figures(self) -> dict[str, Any]:
        """Return facts about the asset, the device and the maps, and how long each step took."""
        device = next(d for d in self.client.devices() if d.selected)
        settings = self.asset.settings
        return {
            "rhytid": __version__,
            "device": f"{device.name} ({device.platform})",
            "vertices": self.asset.vertices,
            "triangles": self.asset.triangles,
            "pores": self.asset.pores,
            "wrinkles": self.asset.wrinkles,
            "resolution": settings["resolution"],
            "udims": list(self.asset.udims),
            "frames": len(self.frames),
            **self.query,
            "r_max": round(settings["bins"]["r_max"], 4),
            "steps": self.watch.figures(),
        }


class StepClock:
    """Divides the time of a build among its steps, by the stages that its job reports."""

    def __init__(self, watch: Stopwatch, show: Callable[[float, str], None]) -> None:
        self._watch, self._show = watch, show
        self._step, self._start = "synthesis", time.perf_counter()

    def follow(self, job: Job) -> None:
        """Follow the progress of the job."""
        self._show(job.progress, job.stage)
        step = _STEPS.get(job.stage, self._step)
        if step != self._step:
            self.stop()
            self._step = step

    def stop(self) -> None:
        """Count the step that ends now."""
        now = time.perf_counter()
        self._watch.add(self._step, now - self._start)
        self._start = now


def key_frames(sizes: Sequence[float], most: int = SHEETS) -> list[int]:
    """Return indices of at most `most` frames, the largest first, with a part of the animation
    between them.

    Each frame excludes an eighth of the animation on both sides, rounded down: of a few key poses
    none is dropped. Frames below a fifth of the largest show little.
    """
    apart = len(sizes) // 8
    shown = [i for i, size in enumerate(sizes) if size >= 0.2 * max(sizes) > 0] or [0]
    left = sorted(shown, key=lambda i: -sizes[i])
    chosen: list[int] = []
    for index in left:
        if all(abs(index - other) > apart for other in chosen) and len(chosen) < most:
            chosen.append(index)
    return chosen


def write_sheets(session: Session, unit_mm: float) -> list[dict[str, Any]]:
    """Write a sheet for each key frame, the most stretched first; returns facts about each."""
    indices = key_frames(session.sizes)
    udim = busiest_udim(session.face.mesh)
    figures = []
    for index in counted(indices, "sheets", "sheet"):
        frame = session.frames[index]
        maps = _maps(session, frame, udim)
        with session.watch.step("contact sheet"):
            name = f"contact_{frame.label}.png"
            performance = _performance(session, frame, udim)
            note = f"Frame {frame.name}, UDIM {udim}."
            sheet = contact_sheets.contact_sheet(performance, maps, unit_mm=unit_mm, note=note)
            with atomic_write(session.out / name) as aside:
                sheet.save(aside)
        rms = contact_sheets.relative_rms(maps["binned"], maps["redraw"])
        figures.append(
            {
                "frame": frame.label,
                "abs_p90": session.sizes[index],
                "relative_rms": rms,
                "sheet": name,
            }
        )
    return figures


def _maps(session: Session, frame: FramePlace, udim: int) -> dict[str, NDArray[Any]]:
    maps: dict[str, NDArray[Any]] = {}
    for method in contact_sheets.METHODS:
        with session.watch.step(f"{method}, as npy"):
            map = session.map(frame, udim, method)
        maps[method] = map.array
    return maps


def _performance(session: Session, frame: FramePlace, udim: int) -> contact_sheets.Performance:
    mesh, stretch = session.face.mesh, session.client.stretch(session.asset, frame.label)
    inside = triangles_inside(mesh, udim)
    return contact_sheets.Performance(
        neutral=mesh.positions,
        deformed=session.face.frames.read(frame),
        faces=mesh.faces[inside],
        triangle_uv=mesh.triangle_uv()[inside] - udim_origin(udim),
        axes=stretch.axes[inside],
        ratios=stretch.ratios[inside],
    )
