"""The calls of the service, each a flow: the one description that both clients share."""

from rhytid_client.calls.asset_calls import (
    asset,
    assets,
    change_asset,
    create_asset,
    delete_asset,
    graph,
    mesh,
)
from rhytid_client.calls.frame_calls import (
    calibrate,
    delete_frame,
    frame,
    frames,
    positions,
    put_frame,
    stretch,
)
from rhytid_client.calls.job_calls import cancel, job, wait
from rhytid_client.calls.map_calls import bin_tile, bins, map, tile, tiles
from rhytid_client.calls.package_calls import package
from rhytid_client.calls.service_calls import devices, health, metrics, ready
from rhytid_client.calls.snapshot_calls import restore, snapshot

__all__ = [
    "asset",
    "assets",
    "bin_tile",
    "bins",
    "calibrate",
    "cancel",
    "change_asset",
    "create_asset",
    "delete_asset",
    "delete_frame",
    "devices",
    "frame",
    "frames",
    "graph",
    "health",
    "job",
    "map",
    "mesh",
    "metrics",
    "package",
    "positions",
    "put_frame",
    "ready",
    "restore",
    "snapshot",
    "stretch",
    "tile",
    "tiles",
    "wait",
]
