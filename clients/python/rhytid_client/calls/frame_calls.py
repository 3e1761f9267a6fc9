"""Frames: the deformed mesh, kept by the server under a name."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid_client import npy, parse
from rhytid_client.calls.asset_calls import asset_id
from rhytid_client.flow import Flow
from rhytid_client.requests import NPY, get, request, with_positions
from rhytid_client.results import Asset, Frame, Job, Stretch


def put_frame(
    asset: Asset | str, frame: str, positions: ArrayLike, *, raw: bool = False
) -> Flow[Frame]:
    """Store positions (V, 3), sent as float32, under a name; what was there is replaced.

    `raw` sends bare little-endian float32 in place of .npy.
    """
    place = ("v1", "assets", asset_id(asset), "frames", frame)
    return parse.one(Frame, (yield with_positions("PUT", *place, positions=positions, raw=raw)))


def frames(asset: Asset | str) -> Flow[list[Frame]]:
    """Every frame of an asset, `neutral` among them."""
    return parse.many(Frame, (yield get("v1", "assets", asset_id(asset), "frames")))


def frame(asset: Asset | str, frame: str) -> Flow[Frame]:
    """A frame and the percentiles of its log stretch."""
    return parse.one(Frame, (yield get("v1", "assets", asset_id(asset), "frames", frame)))


def positions(asset: Asset | str, frame: str) -> Flow[NDArray[np.float32]]:
    """The positions of a frame, (V, 3) float32, read-only."""
    place = ("v1", "assets", asset_id(asset), "frames", frame)
    array: NDArray[Any] = npy.decode(parse.content((yield get(*place, headers={"Accept": NPY}))))
    return array


def delete_frame(asset: Asset | str, frame: str) -> Flow[None]:
    """Forget a frame; `neutral` stays."""
    parse.content((yield request("DELETE", "v1", "assets", asset_id(asset), "frames", frame)))


def stretch(asset: Asset | str, frame: str) -> Flow[Stretch]:
    """The stretch of every triangle: its axes in UV and its ratios."""
    place = ("v1", "assets", asset_id(asset), "frames", frame, "stretch")
    axes, ratios = npy.unpack(parse.content((yield get(*place))), "axes", "ratios")
    return Stretch(axes, ratios)


def calibrate(asset: Asset | str, positions: ArrayLike, *, raw: bool = False) -> Flow[Job]:
    """Set the range of the precomputed maps from a typical frame; `wait` for the job."""
    place = ("v1", "assets", asset_id(asset), "calibration")
    return parse.one(Job, (yield with_positions("PUT", *place, positions=positions, raw=raw)))
