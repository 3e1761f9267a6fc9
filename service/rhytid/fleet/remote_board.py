"""The board, asked from a thread of an ingress or a replica."""

from __future__ import annotations

from typing import Any

from ray.exceptions import RayError
from ray.serve.exceptions import RayServeException

from rhytid.errors import DeviceLostError
from rhytid.fleet.board import Positions, Report

# Seconds for an answer.
PATIENCE = 10.0


class RemoteBoard:
    """The calls of `Board`; each raises DeviceLostError where it does not answer.

    handle: of the deployment of the board.
    """

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def keep(self, asset: str, name: str, positions: Positions) -> int:
        """As of `Board`."""
        found: int = self._ask("keep", asset, name, positions)
        return found

    def remove(self, asset: str, name: str) -> int:
        """As of `Board`."""
        found: int = self._ask("remove", asset, name)
        return found

    def forget(self, asset: str) -> None:
        """As of `Board`."""
        self._ask("forget", asset)

    def versions(self, asset: str) -> dict[str, int]:
        """As of `Board`."""
        found: dict[str, int] = self._ask("versions", asset)
        return found

    def frame(self, asset: str, name: str) -> tuple[int, Positions | None]:
        """As of `Board`."""
        found: tuple[int, Positions | None] = self._ask("frame", asset, name)
        return found

    def report(self, report: Report) -> None:
        """As of `Board`."""
        self._ask("report", report)

    def reports(self) -> list[Report]:
        """As of `Board`."""
        found: list[Report] = self._ask("reports")
        return found

    def _ask(self, name: str, *arguments: Any) -> Any:
        response = None
        try:
            response = getattr(self._handle, name).remote(*arguments)
            return response.result(timeout_s=PATIENCE)
        except (RayError, RayServeException, TimeoutError) as error:
            if response is not None:
                response.cancel()
            raise DeviceLostError("the board of the fleet does not answer; try later") from error
