"""Former names of the frames of a mesh file, which earlier versions counted from 0000.

Of these names only `0000` is unused today; the others are names of other frames now. So 0.1 answers
`0000` with the frame that had this name, and a notice; 0.2 does not.
"""

from __future__ import annotations

import logging
import re
from collections import OrderedDict
from collections.abc import Awaitable
from threading import Lock

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.domain.frame import counted_frame, frame_label

NOTICE = "X-Rhytid-Notice"
FORMER, NOW = frame_label(0), counted_frame(0)
TEXT = (
    f"frame {FORMER} of a mesh file is named {NOW} now: the frames of a mesh file are counted from "
    f"{NOW}, as bake counts them; 0.2 does not know the name {FORMER}"
)
# Assets that are remembered; of more the first are forgotten.
MOST = 10_000
_PATH = re.compile(rf"(/v1/assets/([^/]+)/frames/){FORMER}(?=/|$)")
_log = logging.getLogger(__name__)


class FormerNames:
    """Remembers the assets whose frame `0001` came with their mesh. For these `0000` means that
    frame, unless a frame named `0000` was stored."""

    def __init__(self) -> None:
        self._lock = Lock()
        # Whether the former name is answered; not where somebody has stored a frame of that name.
        self._assets: OrderedDict[str, bool] = OrderedDict()

    def sent(self, asset: str) -> None:
        """Note that a mesh file with frames was sent."""
        with self._lock:
            self._note(asset, self._assets.get(asset, True))

    def stored(self, asset: str, frame: str) -> None:
        """Note that a frame was stored under its own name."""
        with self._lock:
            if frame == FORMER:
                self._note(asset, False)
            elif frame == NOW and self._assets.get(asset):
                del self._assets[asset]

    def deleted(self, asset: str, frame: str) -> None:
        """Note that a frame was deleted."""
        if frame in (FORMER, NOW):
            with self._lock:
                self._assets.pop(asset, None)

    def removed(self, asset: str) -> None:
        """Note that the asset was removed, with its frames."""
        with self._lock:
            self._assets.pop(asset, None)

    def _note(self, asset: str, answered: bool) -> None:
        self._assets[asset] = answered
        self._assets.move_to_end(asset)
        if len(self._assets) > MOST:
            self._assets.popitem(last=False)

    def known(self, asset: str) -> bool:
        """Whether `0000` is answered for the asset."""
        return self._assets.get(asset, False)


class FormerFrames:
    """ASGI middleware: replaces a former name in the path of a request by the present one, and adds
    a notice to the answer."""

    def __init__(self, app: ASGIApp, names: FormerNames) -> None:
        self._app, self._names = app, names
        self._told: set[str] = set()

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Pass the request on, with the present name of the frame where its path has a former
        one."""
        asset = self._asset(scope)
        if asset is None:
            return self._app(scope, receive, send)
        self._tell(asset)

        async def noted(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)[NOTICE] = TEXT
            await send(message)

        # In place: the middleware around this reads the route from the scope afterwards.
        scope["path"] = _PATH.sub(rf"\g<1>{NOW}", scope["path"], count=1)
        return self._app(scope, receive, noted)

    def _asset(self, scope: Scope) -> str | None:
        """The asset of a request that reads a frame by a former name; None for any other
        request."""
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
            return None
        found = _PATH.search(scope["path"]) if f"/frames/{FORMER}" in scope["path"] else None
        return found[2] if found is not None and self._names.known(found[2]) else None

    def _tell(self, asset: str) -> None:
        """Log the notice once for an asset. All assets are forgotten where there are many."""
        if asset not in self._told:
            if len(self._told) >= MOST:
                self._told.clear()
            self._told.add(asset)
            _log.warning("asset %s: %s", asset, TEXT)
