"""Skin packages: all that the fast method reads at run time, for engines and web pages."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from rhytid_client import parse
from rhytid_client.calls.asset_calls import asset_id
from rhytid_client.calls.job_calls import Progress, wait
from rhytid_client.errors import BadAnswer
from rhytid_client.exchange import Flow
from rhytid_client.requests import Request, get
from rhytid_client.results import Asset, Job

ZIP = ".zip"
_ACCEPTED = 202


def package(
    asset: Asset | str,
    path: str | os.PathLike[str],
    *,
    levels: int = 1,
    progress: Progress | None = None,
    timeout: float | None = None,
) -> Flow[Path]:
    """Write the skin package of a built asset: mesh, textures, shaders, manifest.

    path: of a zip, where it ends in .zip, else of a folder, whose files of the same names are
    replaced.  levels: of the maps; 1 is the finest alone.  progress, timeout: of the job that makes
    it, as `wait` has them. Returns the path. Raises OSError where it cannot be written, Conflict
    where the asset has a setting that packages do not know.
    """
    there = Path(path)
    wanted = get("v1", "assets", asset_id(asset), "package", params={"levels": levels})
    if there.suffix.lower() == ZIP:
        yield from _fetched(replace(wanted, into=there), progress, timeout)
        return there
    there.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".package-", dir=there.parent) as aside:
        file = Path(aside) / "package.zip"
        yield from _fetched(replace(wanted, into=file), progress, timeout)
        try:
            with ZipFile(file) as came:
                came.extractall(there)
        except BadZipFile as exc:
            raise BadAnswer(f"the answer is no zip: {exc} [{wanted}]") from exc
    return there


def _fetched(wanted: Request, progress: Progress | None, timeout: float | None) -> Flow[None]:
    """Write the answer, once the job that makes it has ended."""
    while True:
        came = yield wanted
        parse.content(came)
        if came.status != _ACCEPTED:
            return
        yield from wait(parse.one(Job, came), progress=progress, timeout=timeout)
