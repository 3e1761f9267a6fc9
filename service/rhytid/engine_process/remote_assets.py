"""Assets of an engine in another process."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rhytid.domain.curves import Curves
from rhytid.domain.expressions import Expressions
from rhytid.domain.frame import counted_frame
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import AssetContent, AssetInfo, FollowedAsset, JobInfo, NewAsset
from rhytid.engine_process.caller import Caller
from rhytid.engine_process.device_process import DeviceProcess
from rhytid.engine_process.frame_ledger import FrameLedger
from rhytid.engine_process.remote_jobs import RemoteJobs
from rhytid.engine_process.remote_tiles import RemoteTiles
from rhytid.engine_process.requests import Request
from rhytid.engine_process.upload_holds import UploadHolds
from rhytid.errors import NotFoundError


class RemoteAssets:
    """The calls of `AssetService`."""

    def __init__(
        self,
        supervisor: Caller,
        frames: FrameLedger,
        jobs: RemoteJobs,
        uploads: UploadHolds,
        tiles: RemoteTiles,
    ) -> None:
        self._supervisor, self._frames, self._jobs = supervisor, frames, jobs
        self._uploads, self._tiles = uploads, tiles

    def create(
        self,
        new: NewAsset,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
        hold: Hold | None = None,
    ) -> AssetInfo:
        """As `AssetService.create`."""
        nbytes = 0 if new.frames is None else new.frames.nbytes
        token = self._uploads.take(nbytes, hold)
        named = {"strict": strict, "allow": tuple(allow)}
        request, asked = Request("create", (new, token), named), None
        since = self._frames.mark()

        def note(process: DeviceProcess) -> None:
            nonlocal asked
            asked = process
            self._uploads.sent(token, process)

        try:
            info: AssetInfo = self._supervisor.call(request, note)
        except BaseException:
            self._uploads.release(token)
            raise
        if nbytes and asked is not None:
            sent: NewAsset = request.packed.shared().positional[0]
            for index, positions in enumerate(() if sent.frames is None else sent.frames):
                name = counted_frame(index)
                with self._frames.sending(info.id, name):
                    # A copy: the whole upload lies in the memory that they are a part of.
                    self._frames.keep(info.id, name, np.array(positions), asked, since)
        return self._noted(info)

    def all(self) -> list[AssetInfo]:
        """Every asset."""
        found: list[AssetInfo] = self._supervisor.call(Request("assets.all"))
        return found

    def info(self, asset: str) -> AssetInfo:
        """One asset."""
        return self._noted(self._supervisor.call(Request("assets.info", (asset,))))

    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """As `AssetService.change`."""
        request = Request("assets.change", (asset, changes))
        found: AssetInfo = self._supervisor.call(request)
        self._supervisor.forget(asset)
        return found

    def delete(self, asset: str, *, shared: bool = False) -> None:
        """As `AssetService.delete`."""
        request = Request("assets.delete", (asset,), {"shared": shared})
        try:
            self._supervisor.call(request)
        except NotFoundError:
            self._frames.forget(asset)
            if request.sent == 1:
                raise
        self._forget(asset)

    def follow(self, asset: str, *, replace: bool) -> FollowedAsset | None:
        """As `AssetService.follow`."""
        request = Request("assets.follow", (asset,), {"replace": replace})
        found: FollowedAsset | None = self._supervisor.call(request)
        if found is not None and found.replaced:
            self._forget(asset)
        self._supervisor.forget(asset)
        return found

    def leave(self, asset: str) -> bool:
        """As `AssetService.leave`."""
        left: bool = self._supervisor.call(Request("assets.leave", (asset,)))
        if left:
            self._forget(asset)
        return left

    def content(self, asset: str) -> AssetContent:
        """As `AssetService.content`."""
        found: AssetContent = self._supervisor.call(Request("assets.content", (asset,)))
        return found

    def graph(self, asset: str) -> WrinkleGraph:
        """The wrinkle graph of a ready asset, and with what it is drawn now."""
        found: WrinkleGraph = self._supervisor.call(Request("assets.graph", (asset,)))
        return found

    def mesh(self, asset: str) -> Mesh:
        """The neutral mesh of a ready asset, out of the store."""
        found: Mesh = self._supervisor.call(Request("assets.mesh", (asset,)))
        return found

    def shapes(self, asset: str) -> Expressions:
        """As `AssetService.shapes`."""
        found: Expressions = self._supervisor.call(Request("assets.shapes", (asset,)))
        return found

    def shapes_nbytes(self, asset: str) -> int:
        """As `AssetService.shapes_nbytes`."""
        found: int = self._supervisor.call(Request("assets.shapes_nbytes", (asset,)))
        return found

    def curves(self, asset: str) -> Curves:
        """As `AssetService.curves`."""
        found: Curves = self._supervisor.call(Request("assets.curves", (asset,)))
        return found

    def calibrate(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> JobInfo:
        """As `AssetService.calibrate`."""
        named = {"strict": strict, "allow": tuple(allow)}
        request = Request("assets.calibrate", (asset, positions), named)
        return self._jobs.keep(self._supervisor.call(request))

    def _forget(self, asset: str) -> None:
        """The process has the asset no more, or another in its place, without frames."""
        self._frames.forget(asset)
        self._tiles.forget(asset)
        self._supervisor.forget(asset)

    def _noted(self, info: AssetInfo) -> AssetInfo:
        """The asset, whose job is remembered: a caller gets its id."""
        if info.state == "building" and info.job is not None:
            self._jobs.note(info.job, info.id)
        return info
