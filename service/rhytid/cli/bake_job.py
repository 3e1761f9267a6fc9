"""`rhytid bake --openjd`: the bundle of a job in place of maps."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

from rhytid.cli.bake_inputs import BakeInputs
from rhytid.cli.bake_options import CHUNK
from rhytid.cli.baking import Baker
from rhytid.cli.frame_range import FrameRange, frame_numbers
from rhytid.cli.frames_list import frame_sources, frames_list
from rhytid.cli.progress import working
from rhytid.cli.reporting import report
from rhytid.domain.wording import plural
from rhytid.engine.messages import METHODS
from rhytid.errors import InputError
from rhytid.farm.job_bundle import TEMPLATE, JobBundle, common_folder
from rhytid.farm.job_template import BakeJob

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine


def write_job(
    arguments: argparse.Namespace, engine: Engine, baker: Baker, given: BakeInputs
) -> None:
    """Write the bundle of what the arguments would bake, and report how it is run."""
    frames = given.part or FrameRange.of(frame_numbers(given.frames.places))
    bundle = _bundle(arguments, baker, given, frames)
    with working(f"writing {arguments.openjd}"), engine.snapshots.of(baker.asset.id) as asset:
        bundle.write(arguments.openjd, asset.pieces())
    each = arguments.chunk or CHUNK
    tasks = len(frames.chunks(each))
    template = arguments.openjd / TEMPLATE
    values = [f"{name}={value}" for name, value in bundle.paths().items()]
    command = ["openjd", "run", str(template), *(word for v in values for word in ("-p", v))]
    figures = {
        "asset": baker.asset.id,
        "bundle": str(arguments.openjd),
        "frames": len(frames.numbers),
        "tasks": tasks,
        "command": command,
        **baker.warned.all_figures(),
    }
    what = f"{plural(tasks, 'task')} of at most {plural(each, 'frame')}"
    text = f"bundle {arguments.openjd}: {what}; to run them on this machine:\n{shlex.join(command)}"
    report(figures, text, arguments.json)


def _bundle(
    arguments: argparse.Namespace, baker: Baker, given: BakeInputs, frames: FrameRange
) -> JobBundle:
    places = given.frames.places
    files = frame_sources(places)
    # Only `binned` needs the range that was measured.
    ready = METHODS if arguments.method == "binned" else [m for m in METHODS if m != "binned"]
    job = BakeJob(
        baker.asset.id,
        given.name,
        frames.text(),
        arguments.chunk or CHUNK,
        arguments.method,
        ready,
        baker.asset.settings["resolution"],
        bool(files),
        _options(arguments, given),
    )
    folder = common_folder(files)
    return JobBundle(job, arguments.mesh, files, arguments.out, frames_list(places, folder))


def _options(arguments: argparse.Namespace, given: BakeInputs) -> list[str]:
    """The options that every task has as they were given."""
    words = ["--stretch", arguments.stretch, "--sampling", arguments.sampling]
    words += ["--profile", *(profile.name for profile in given.profiles)]
    words += ["--fps", repr(arguments.fps)]
    for name in ("prim", "clip"):
        value = getattr(arguments, name)
        if value is not None and "{{" in value:
            raise InputError(f"--{name} {value}: a job cannot hold a name with '{{{{'")
        if value is not None:
            words.append(f"--{name}={value}")  # it may begin with a dash
    if arguments.geometry is not None:
        words += ["--geometry", arguments.geometry, "--subdivide", str(arguments.subdivide)]
    return words
