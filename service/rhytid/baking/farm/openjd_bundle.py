"""A bake as a job bundle of Open Job Description (OpenJD), version 2023-09, for render farms.

A bundle is a folder that submitters take. Its job template uses the extension TASK_CHUNKING:
https://github.com/OpenJobDescription/openjd-specifications. The template names no path: paths are
values of parameters, which a farm maps to where files are on its workers.

Beside the template are a snapshot of the asset, `parameter_values.json` with the paths of this
machine, and `asset_references.json` with the files that a farm copies to its workers, both as
Deadline Cloud reads them.
"""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rhytid.baking.baker import Baker
from rhytid.baking.frames import frame_sources, frames_list
from rhytid.baking.inputs import BakeInputs
from rhytid.baking.request import CHUNK, BakeRequest, BakeSummary
from rhytid.domain.methods import METHODS
from rhytid.domain.wording import plural
from rhytid.errors import InputError, LimitError
from rhytid.support.atomic_files import atomic_write, write_file, write_pieces
from rhytid.support.build_identity import drawing_version
from rhytid.support.console import working

Json = dict[str, Any]
VERSION = "jobtemplate-2023-09"
# Names of the files of a bundle.
TEMPLATE, VALUES, REFERENCES = (
    "template.json", "parameter_values.json", "asset_references.json",
)  # fmt: skip
SNAPSHOT, FRAMES_LIST = "asset.rhytid.tar", "frames.txt"
# Of the value of a parameter (OpenJD 2023-09, ParameterStringValue).
_LONGEST = 1024
# Seconds between SIGTERM and SIGKILL where a task is cancelled: rhytid finishes the maps
# that it is writing, and what SIGKILL cuts off is drawn again.
NOTICE = 10
# Texels per side that an asset may have.
_SIDES = [256 << power for power in range(7)]
_STORE = "{{Session.WorkingDirectory}}/assets"
_DRAWING = "What `rhytid --version` calls drawing, which workers must have; empty: any."


def write_job(request: BakeRequest, baker: Baker, inputs: BakeInputs) -> BakeSummary:
    """Write the bundle of a request. The summary says how it is run."""
    folder = request.openjd
    assert folder is not None
    frames, bundle = inputs.numbers, _bundle(request, baker, inputs)
    with working(f"writing {folder}"), baker.engine.snapshots.of(baker.asset.id) as asset:
        bundle.write(folder, asset.pieces())
    each = request.chunk or CHUNK
    tasks = len(frames.chunks(each))
    template = folder / TEMPLATE
    values = [f"{name}={value}" for name, value in bundle.paths().items()]
    command = ["openjd", "run", str(template), *(word for v in values for word in ("-p", v))]
    figures = {
        "asset": baker.asset.id,
        "bundle": str(folder),
        "frames": len(frames.numbers),
        "tasks": tasks,
        "command": command,
        **baker.warnings.all_figures(),
    }
    what = f"{plural(tasks, 'task')} of at most {plural(each, 'frame')}"
    text = f"bundle {folder}: {what}; to run them on this machine:\n{shlex.join(command)}"
    return BakeSummary(figures, text)


def _bundle(request: BakeRequest, baker: Baker, inputs: BakeInputs) -> JobBundle:
    places = inputs.frames.places
    files = frame_sources(places)
    # Only `binned` needs the range that was measured.
    method = request.query.method
    ready = METHODS if method == "binned" else [m for m in METHODS if m != "binned"]
    job = BakeJob(
        baker.asset.id,
        inputs.name,
        inputs.numbers.text(),
        request.chunk or CHUNK,
        method,
        ready,
        baker.asset.settings["resolution"],
        bool(files),
        _options(request),
    )
    folder = common_folder(files)
    return JobBundle(job, request.mesh, files, request.out, frames_list(places, folder))


def _options(request: BakeRequest) -> list[str]:
    """Options of `rhytid bake` that are the same in every task."""
    words = ["--stretch", request.query.stretch, "--sampling", request.query.sampling]
    words += ["--profile", *(profile.name for profile in request.profiles)]
    words += ["--compression", request.compression]
    words += ["--fps", repr(request.clip.fps)]
    if any(profile.lagging for profile in request.profiles):
        words += ["--blood-time", repr(request.blood_seconds)]
    if any(profile.of_slopes for profile in request.profiles):
        words += ["--base-roughness", repr(request.shine.roughness)]
    if request.shine.level is not None:
        words += ["--level", str(request.shine.level)]
    for name, value in (("prim", request.clip.prim), ("clip", request.clip.clip)):
        if value is not None and "{{" in value:
            raise InputError(f"--{name} {value}: a job cannot hold a name with '{{{{'")
        if value is not None:
            words.append(f"--{name}={value}")  # it may begin with a dash
    if request.geometry is not None:
        words += ["--geometry", request.geometry, "--subdivide", str(request.subdivide)]
    return words


@dataclass(frozen=True)
class JobBundle:
    """A job, and where its files are on this machine.

    mesh: file of the neutral.  frames: files of frames; empty where the mesh file holds them.  out:
    folder of the maps.  listing: text of `frames.txt`, whose names are relative to
    `common_folder(frames)`.
    """

    job: BakeJob
    mesh: Path
    frames: Sequence[Path]
    out: Path
    listing: str = ""

    def paths(self) -> dict[str, str]:
        """Values of the parameters that have no default."""
        found = {"Mesh": self.mesh, "Out": self.out}
        if self.frames:
            found["FramesFolder"] = common_folder(self.frames)
        return {name: _plain(path) for name, path in found.items()}

    def write(self, folder: Path, snapshot: Iterable[bytes]) -> None:
        """Write the bundle into a folder. The template is written last, so that it is never there
        without the files that it needs.

        snapshot: the pieces of the asset. Raises LimitError where a value is longer than OpenJD
        allows.
        """
        for name, value in {"Frames": self.job.frames, **self.paths()}.items():
            if len(value) > _LONGEST:
                raise LimitError(
                    f"{name} has {len(value)} characters, a parameter of a job at most {_LONGEST}"
                )
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / SNAPSHOT) as aside:
            write_pieces(aside, snapshot)
        if self.frames:
            _write(folder / FRAMES_LIST, self.listing)
        values = [{"name": name, "value": value} for name, value in self.paths().items()]
        _write_json(folder / VALUES, {"parameterValues": values})
        _write_json(folder / REFERENCES, self._references())
        _write_json(folder / TEMPLATE, self.job.template())

    def _references(self) -> Mapping[str, Any]:
        files = sorted({_plain(file) for file in (self.mesh, *self.frames)})
        return {
            "assetReferences": {
                "inputs": {"filenames": files, "directories": []},
                "outputs": {"directories": [_plain(self.out)]},
                "referencedPaths": [],
            }
        }


def common_folder(files: Sequence[Path]) -> Path:
    """The deepest folder above all files; the current one where there are no files. Raises
    InputError where they are on several drives."""
    folders = [Path(_plain(file)).parent for file in files]
    try:
        return Path(os.path.commonpath(folders)) if folders else Path.cwd()
    except ValueError as exc:  # of Windows
        raise InputError(f"frames are on several drives, {folders[0]} is one: {exc}") from exc


def _plain(path: Path) -> str:
    """An absolute path without `..`. Farms map paths by their beginnings."""
    return os.path.abspath(path)  # noqa: PTH100 `resolve` would follow links


def _write_json(file: Path, content: Mapping[str, Any]) -> None:
    _write(file, f"{json.dumps(content, indent=2)}\n")


def _write(file: Path, text: str) -> None:
    with atomic_write(file) as aside:
        write_file(aside, text.encode())


@dataclass(frozen=True)
class BakeJob:
    """The job that a template describes.

    asset: its id, in the snapshot.  name: first part of the names of files.  frames: range of
    numbers.  chunk: frames per task.  method, resolution: defaults of parameters.  methods: those
    that the asset is ready for.  listed: whether `frames.txt` names the frames; else the mesh file
    holds them.  options: of `rhytid bake`, the same in every task.
    """

    asset: str
    name: str
    frames: str
    chunk: int
    method: str
    methods: Sequence[str]
    resolution: int
    listed: bool
    options: Sequence[str] = field(default=())

    def template(self) -> Json:
        """The template as JSON."""
        return {
            "specificationVersion": VERSION,
            "extensions": ["TASK_CHUNKING"],
            "name": f"rhytid bake {self.name}",
            "description": "Displacement maps of a face's skin, one per UDIM and frame.",
            "parameterDefinitions": self.parameters(),
            "steps": [self._step()],
        }

    def parameters(self) -> list[Json]:
        """The parameters, in the order in which a submitter shows them."""
        frames = "Frames to bake by their numbers: 1-10,15,20-30:2."
        method = "How maps are drawn."
        if "binned" not in self.methods:
            method += " A bundle written with --method binned offers that, too."
        listed = [
            _path("FramesList", "FILE", "IN", "A text file that names the files of frames.")
            | {"default": FRAMES_LIST},
            _path("FramesFolder", "DIRECTORY", "NONE", "The folder that they are relative to."),
        ]
        return [
            _text("Frames", frames, self.frames) | {"minLength": 1},
            _number("FramesPerTask", "Frames that a task bakes.", self.chunk) | {"minValue": 1},
            _text("Method", method, self.method) | {"allowedValues": list(self.methods)},
            _number("Resolution", "Texels per side of a map.", self.resolution)
            | {"allowedValues": _SIDES},
            _path("Mesh", "FILE", "IN", "The neutral mesh."),
            *(listed if self.listed else []),
            _path("Out", "DIRECTORY", "OUT", "The folder of the maps."),
            _path("Asset", "FILE", "IN", "The built skin of the mesh.") | {"default": SNAPSHOT},
            _text("Rhytid", "The program, as workers find it.", "rhytid"),
            _text("Drawing", _DRAWING, drawing_version()),
        ]

    def _step(self) -> Json:
        chunks = {
            "defaultTaskCount": "{{Param.FramesPerTask}}",
            "rangeConstraint": "NONCONTIGUOUS",
        }
        frames = {
            "name": "Frames",
            "type": "CHUNK[INT]",
            "range": "{{Param.Frames}}",
            "chunks": chunks,
        }
        restore = [
            "restore", "{{Param.Asset}}", "--store", _STORE, "--progress", "openjd",
        ]  # fmt: skip
        environment = {
            "name": "Skin",
            "description": "Puts the built skin into the session, once for all of its tasks.",
            "script": {"actions": {"onEnter": _action(restore)}},
        }
        return {
            "name": "Bake",
            "stepEnvironments": [environment],
            "parameterSpace": {"taskParameterDefinitions": [frames]},
            "script": {"actions": {"onRun": _action(self._bake())}},
        }

    def _bake(self) -> list[str]:
        """The arguments of `rhytid` in a task."""
        given = {
            "--mesh": "{{Param.Mesh}}",
            "--out": "{{Param.Out}}",
            "--name": self.name,
            "--asset": self.asset,
            "--store": _STORE,
            "--resolution": "{{Param.Resolution}}",
            "--method": "{{Param.Method}}",
            "--frame-range": "{{Task.Param.Frames}}",
            "--drawing-version": "{{Param.Drawing}}",
            "--progress": "openjd",
        }
        if self.listed:
            where = ("{{Param.FramesList}}", "{{Param.FramesFolder}}")
            given |= dict(zip(("--frames-list", "--frames-folder"), where, strict=True))
        return ["bake", *(word for pair in given.items() for word in pair), *self.options]


def _action(arguments: list[str]) -> Json:
    cancelation = {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": NOTICE}
    return {"command": "{{Param.Rhytid}}", "args": arguments, "cancelation": cancelation}


def _text(name: str, description: str, default: str) -> Json:
    return {"name": name, "type": "STRING", "description": description, "default": default}


def _number(name: str, description: str, default: int) -> Json:
    return {"name": name, "type": "INT", "description": description, "default": default}


def _path(name: str, kind: str, flow: str, description: str) -> Json:
    kinds = {"objectType": kind, "dataFlow": flow}
    return {"name": name, "type": "PATH", **kinds, "description": description}
