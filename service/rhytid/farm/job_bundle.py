"""A bake as a folder that submitters of render farms take: a job bundle.

Beside the template: `parameter_values.json`, with the paths of this machine, and
`asset_references.json`, with the files that a farm carries to its workers, both as Deadline Cloud
reads them.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rhytid.errors import InputError, LimitError
from rhytid.farm.job_template import FRAMES_LIST, SNAPSHOT, BakeJob
from rhytid.support.atomic_files import atomic_write, write_file, write_pieces

TEMPLATE, VALUES, REFERENCES = (
    "template.json", "parameter_values.json", "asset_references.json",
)  # fmt: skip
# Of the value of a parameter (OpenJD 2023-09, ParameterStringValue).
_LONGEST = 1024


@dataclass(frozen=True)
class JobBundle:
    """A job and where its files are on this machine.

    mesh: the neutral.  frames: the files of frames; none where the mesh file holds them.  out: the
    folder of the maps.  listing: text of `frames.txt`, whose names are relative to
    `common_folder(frames)`.
    """

    job: BakeJob
    mesh: Path
    frames: Sequence[Path]
    out: Path
    listing: str = ""

    def paths(self) -> dict[str, str]:
        """The values of parameters that have no default."""
        found = {"Mesh": self.mesh, "Out": self.out}
        if self.frames:
            found["FramesFolder"] = common_folder(self.frames)
        return {name: _plain(path) for name, path in found.items()}

    def write(self, folder: Path, snapshot: Iterable[bytes]) -> None:
        """Write the bundle; a new template is there last, when all that it needs is.

        snapshot: the pieces of the asset. Raises LimitError where a value is longer than a
        parameter can be.
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
    """The folder that all files are in, or below; the present one where there are none. Raises
    InputError where they are on several drives."""
    folders = [Path(_plain(file)).parent for file in files]
    try:
        return Path(os.path.commonpath(folders)) if folders else Path.cwd()
    except ValueError as exc:  # of Windows
        raise InputError(f"frames are on several drives, {folders[0]} is one: {exc}") from exc


def _plain(path: Path) -> str:
    """An absolute path without `..`: farms map paths by how they begin."""
    return os.path.abspath(path)  # noqa: PTH100 `resolve` would follow links


def _write_json(file: Path, content: Mapping[str, Any]) -> None:
    _write(file, f"{json.dumps(content, indent=2)}\n")


def _write(file: Path, text: str) -> None:
    with atomic_write(file) as aside:
        write_file(aside, text.encode())
