"""Frames of an engine in another process."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.warnings import InputWarning
from rhytid.engine import call_context
from rhytid.engine.messages import FrameInfo, FrameStretch
from rhytid.engine_process.caller import Caller
from rhytid.engine_process.device_process import DeviceProcess
from rhytid.engine_process.frame_ledger import FrameLedger
from rhytid.engine_process.requests import Request
from rhytid.errors import DeviceLostError, NotFoundError


class RemoteFrames:
    """The calls of `FrameService` that a server makes."""

    def __init__(self, supervisor: Caller, ledger: FrameLedger) -> None:
        self._supervisor, self._ledger = supervisor, ledger

    def put(
        self,
        asset: str,
        frame: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> FrameInfo:
        """As `FrameService.put`; the positions are kept here, too."""
        named = {"strict": strict, "allow": tuple(allow)}
        request, asked = Request("frames.put", (asset, frame, positions), named), None

        def note(process: DeviceProcess) -> None:
            nonlocal asked
            asked = process

        with self._changing(asset, frame):
            since = self._ledger.mark()
            info: FrameInfo = self._supervisor.call(request, note)
            if asked is not None:
                kept = np.asarray(request.packed.shared().positional[2], np.float32)
                self._ledger.keep(asset, frame, kept, asked, since)
        return info

    def warnings(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> tuple[InputWarning, ...]:
        """As `FrameService.warnings`."""
        named = {"strict": strict, "allow": tuple(allow)}
        request = Request("frames.warnings", (asset, positions), named)
        found: tuple[InputWarning, ...] = self._supervisor.call(request)
        return found

    def all(self, asset: str) -> list[FrameInfo]:
        """Every frame of an asset, `neutral` first."""
        found: list[FrameInfo] = self._of(Request("frames.all", (asset,)), asset)
        return found

    def info(self, asset: str, frame: str) -> FrameInfo:
        """What is known of a frame."""
        found: FrameInfo = self._of(Request("frames.info", (asset, frame)), asset, frame)
        return found

    def positions(self, asset: str, frame: str) -> NDArray[np.float32]:
        """(V, 3) positions of a frame; those of the neutral mesh for `neutral`."""
        request = Request("frames.positions", (asset, frame))
        found: NDArray[np.float32] = self._of(request, asset, frame)
        return found

    def delete(self, asset: str, frame: str) -> None:
        """Forget a frame."""
        request = Request("frames.delete", (asset, frame))
        with self._changing(asset, frame):
            try:
                self._of(request, asset, frame)
            except NotFoundError:
                if request.sent == 1:
                    raise
            self._ledger.forget(asset, frame)

    def stretch(self, asset: str, frame: str) -> FrameStretch:
        """Axes and unclamped ratios of every triangle in a frame (section 2.2)."""
        request = Request("frames.stretch", (asset, frame))
        found: FrameStretch = self._of(request, asset, frame)
        return found

    def _of(self, request: Request, asset: str, *names: str) -> Any:
        """The answer of a process that has these frames of an asset, or all."""
        bring = partial(self._ledger.bring, asset=asset, names=names or None)
        return self._supervisor.call(request, bring)

    @contextmanager
    def _changing(self, asset: str, frame: str) -> Iterator[None]:
        """Held while a frame is stored or deleted. Such a call is not given up where its client is
        gone: the process would do it later, after what is stored by then."""
        with self._ledger.sending(asset, frame), call_context.never_abandoned():
            try:
                yield
            except DeviceLostError:
                self._ledger.doubt(asset, frame)
                raise
