"""A bake as a job template of Open Job Description (OpenJD), version 2023-09.

https://github.com/OpenJobDescription/openjd-specifications, with the extension TASK_CHUNKING. A
template names no path: those are values of parameters, which a farm maps to where files are on its
workers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rhytid.support.build_identity import drawing_version

Json = dict[str, Any]
VERSION = "jobtemplate-2023-09"
# Names of the files beside the template.
SNAPSHOT, FRAMES_LIST = "asset.rhytid.tar", "frames.txt"
# Seconds between SIGTERM and SIGKILL where a task is cancelled: rhytid ends within one.
_NOTICE = 10
# Texels per side that an asset may have.
_SIDES = [256 << power for power in range(7)]
_STORE = "{{Session.WorkingDirectory}}/assets"
_DRAWING = "What `rhytid --version` calls drawing, which workers must have; empty: any."


@dataclass(frozen=True)
class BakeJob:
    """What a job bakes.

    asset: id, in the snapshot.  name: first part of the names of files.  frames: their numbers, as
    `--frame-range` has them.  chunk: frames per task.  method, resolution: defaults of parameters.
    methods: those that the asset is ready for.  options: of `rhytid bake`, the same in every task.
    listed: whether frames are in files that `frames.txt` names, not in the file of the mesh.
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
        """The template, as JSON."""
        return {
            "specificationVersion": VERSION,
            "extensions": ["TASK_CHUNKING"],
            "name": f"rhytid bake {self.name}",
            "description": "Displacement maps of a face's skin, one per UDIM and frame.",
            "parameterDefinitions": self.parameters(),
            "steps": [self._step()],
        }

    def parameters(self) -> list[Json]:
        """The parameters of the job, in the order in which a submitter shows them."""
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
        """The arguments of a task."""
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
    cancelation = {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": _NOTICE}
    return {"command": "{{Param.Rhytid}}", "args": arguments, "cancelation": cancelation}


def _text(name: str, description: str, default: str) -> Json:
    return {"name": name, "type": "STRING", "description": description, "default": default}


def _number(name: str, description: str, default: int) -> Json:
    return {"name": name, "type": "INT", "description": description, "default": default}


def _path(name: str, kind: str, flow: str, description: str) -> Json:
    kinds = {"objectType": kind, "dataFlow": flow}
    return {"name": name, "type": "PATH", **kinds, "description": description}
