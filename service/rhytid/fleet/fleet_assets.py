"""Assets of a fleet, as an ingress sees them."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor

from rhytid.engine.messages import AssetInfo
from rhytid.engine.operations import OPERATIONS
from rhytid.engine_process.envelope import Request
from rhytid.errors import NotFoundError, SharedDamageError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.shared_folder import Revisions, SharedFolder

# Assets that are asked for at once when all are listed.
_AT_ONCE = 8
_log = logging.getLogger(__name__)


class FleetAssets:
    """Lists the assets of the shared folder."""

    def __init__(self, caller: FleetCaller, shared: SharedFolder) -> None:
        self._caller, self._shared = caller, shared
        self._known: dict[str, tuple[Revisions, AssetInfo]] = {}

    def all(self) -> list[AssetInfo]:
        """Every asset of the shared folder but those that are known to be damaged. What is said of
        a ready one there is taken: it is not loaded. What was found is kept."""
        ids = self._shared.ids()
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            found = [info for info in pool.map(self._found, ids) if info is not None]
        # A list: others may list meanwhile.
        self._known = {one: known for one, known in list(self._known.items()) if one in ids}
        return found

    def _found(self, asset: str) -> AssetInfo | None:
        now = (self._shared.revision(asset), self._shared.settings_revision(asset))
        known = self._known.get(asset)
        if known is not None and known[0] == now:
            return known[1]
        try:
            info = self._shared.info(asset, now) or self._asked(asset)
        except NotFoundError:  # removed since
            return None
        except SharedDamageError as error:
            _log.error("asset %s is not listed: %s", asset, error)
            return None
        if info.state == "ready" and now[0] is not None:
            self._known[asset] = (now, info)
        return info

    def _asked(self, asset: str) -> AssetInfo:
        found: AssetInfo = self._caller.call(Request(OPERATIONS["assets.info"], (asset,)))
        return found
