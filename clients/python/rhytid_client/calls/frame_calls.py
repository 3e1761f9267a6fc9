"""Frames: the deformed mesh, kept by the server under a name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid_client import npy, parse
from rhytid_client.calls.asset_calls import asset_id, strictly
from rhytid_client.exchange import Flow
from rhytid_client.requests import NPY, get, request, with_positions
from rhytid_client.results import Asset, Frame, Job, Stretch
from rhytid_client.warned import tell


def put_frame(
    asset: Asset | str,
    frame: str,
    positions: ArrayLike,
    *,
    raw: bool = False,
    strict: bool = False,
    allow: str | Iterable[str] = (),
) -> Flow[Frame]:
    """Store positions (V, 3) under a name; what was there is replaced.

    They are sent as float32; as float64 where they are that and stand far from the origin.
    raw: sends bare little-endian float32 in place of .npy, always.
    strict: RequestError, and nothing is stored, where there would be `warnings`; allow: but for
    those of these codes.
    """
    place = ("v1", "assets", asset_id(asset), "frames", frame)
    response = yield with_positions(
        "PUT", *place, positions=positions, raw=raw, params=strictly(strict, allow)
    )
    stored = parse.one(Frame, response)
    tell(stored.warnings)
    return stored


def frames(asset: Asset | str) -> Flow[list[Frame]]:
    """Every frame of an asset, `neutral` among them."""
    return parse.many(Frame, (yield get("v1", "assets", asset_id(asset), "frames")))


def frame(asset: Asset | str, frame: str) -> Flow[Frame]:
    """A frame and the percentiles of its log stretch."""
    return parse.one(Frame, (yield get("v1", "assets", asset_id(asset), "frames", frame)))


def positions(asset: Asset | str, frame: str) -> Flow[NDArray[np.float32]]:
    """The positions of a frame, (V, 3) float32, read-only; float64 where the asset has a centre."""
    place = ("v1", "assets", asset_id(asset), "frames", frame)
    array: NDArray[Any] = npy.decode(parse.content((yield get(*place, headers={"Accept": NPY}))))
    return array


def delete_frame(asset: Asset | str, frame: str) -> Flow[None]:
    """Forget a frame; `neutral` stays."""
    parse.content((yield request("DELETE", "v1", "assets", asset_id(asset), "frames", frame)))


def stretch(asset: Asset | str, frame: str) -> Flow[Stretch]:
    """The stretch of every triangle: its axes in UV and its ratios."""
    place = ("v1", "assets", asset_id(asset), "frames", frame, "stretch")
    content = parse.content((yield get(*place)))
    return Stretch(*npy.unpack(content, "axes", "ratios", "folds"))


def calibrate(
    asset: Asset | str,
    positions: ArrayLike,
    *,
    raw: bool = False,
    strict: bool = False,
    allow: str | Iterable[str] = (),
) -> Flow[Job]:
    """Set the range of the precomputed maps from a typical frame; `wait` for the job.

    raw, strict, allow: as for `put_frame`.
    """
    place = ("v1", "assets", asset_id(asset), "calibration")
    response = yield with_positions(
        "PUT", *place, positions=positions, raw=raw, params=strictly(strict, allow)
    )
    job = parse.one(Job, response)
    tell(job.warnings)
    return job
