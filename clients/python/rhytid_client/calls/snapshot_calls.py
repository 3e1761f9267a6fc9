"""Snapshots: a built asset as one file, for other servers."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rhytid_client import parse
from rhytid_client.calls.asset_calls import asset_id
from rhytid_client.exchange import Flow
from rhytid_client.file_body import FileBody
from rhytid_client.requests import get, request
from rhytid_client.results import Asset

TAR = "application/x-tar"


def snapshot(asset: Asset | str, path: str | os.PathLike[str]) -> Flow[Path]:
    """Write a built asset into a file that any server takes: mesh, wrinkles, settings, stiffness
    maps. The same asset gives the same bytes.

    path: of the file, or of a folder, where it is called ASSET.rhytid.tar. It is there once all of
    it came. Returns its path. Raises OSError where it cannot be written.
    """
    file = Path(path)
    if file.is_dir():
        file /= f"{asset_id(asset)}.rhytid.tar"
    wanted = get("v1", "assets", asset_id(asset), "snapshot")
    parse.content((yield replace(wanted, into=file)))
    return file


def restore(
    path: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
) -> Flow[Asset]:
    """Send the file of a snapshot; the asset is ready at once, under the id that it had. One that
    is there already stays as it is. Takes a key with the scope admin.

    progress: called with bytes sent and bytes in all. Raises RequestError naming the place where
    the file is damaged.
    """
    body = FileBody(Path(path), TAR, progress)
    return parse.one(Asset, (yield request("POST", "v1", "snapshots", content=body)))
