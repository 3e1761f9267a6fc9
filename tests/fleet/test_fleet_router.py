"""Which replica Ray asks, by the router itself, over replicas that only say how busy they are."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

import pytest
from ray.serve._private.common import (
    DeploymentHandleSource,
    DeploymentID,
    ReplicaID,
    RequestMetadata,
)
from ray.serve.request_router import PendingRequest

from rhytid.fleet.envelopes import Addressed, Parcel
from rhytid.fleet.router import AssetRouter, replica_order

DEPLOYMENT = DeploymentID("Replicas", "rhytid")
NAMES = ("one", "two", "three")
ASSET = "0123456789abcdef"
# Calls that a replica works on at once.
MOST = 4


@dataclass
class Replica:
    """A replica that works on so many calls."""

    name: str
    busy: int = 0
    max_ongoing_requests: int = MOST

    @property
    def replica_id(self) -> ReplicaID:
        return ReplicaID(self.name, DEPLOYMENT)

    async def get_queue_len(self, *, deadline_s: float) -> int:
        return self.busy


class Asking:
    """A router over three replicas, and what is asked of it."""

    def __init__(self) -> None:
        self.replicas = {name: Replica(name) for name in NAMES}
        self._router = AssetRouter(DEPLOYMENT, DeploymentHandleSource.REPLICA)
        self._router.initialize_state(spread=2)
        made: Any = list(self.replicas.values())
        self._router.update_replicas(made)
        self._asked = 0

    def fill(self, *names: str) -> None:
        for name in names:
            self.replicas[name].busy = MOST

    async def name_for(self, asset: str = ASSET, to: str = "", spread: bool = False) -> str:
        """The replica that a call goes to."""
        self._asked += 1
        about = RequestMetadata(str(self._asked), str(self._asked))
        call = Addressed(asset, to, spread, Parcel(b"", ()))
        pending = PendingRequest([call], {}, about)
        found = await self._router._choose_replica_for_request(pending)
        return str(found.replica_id.unique_id)


def soon(call: Any) -> Any:
    return asyncio.wait_for(call, 5)


def test_a_call_goes_to_the_first_replica_and_drawing_to_the_next_where_that_is_full() -> None:
    async def use() -> None:
        asking = Asking()
        first, second, third = replica_order(ASSET, NAMES)
        assert await soon(asking.name_for()) == first
        assert await soon(asking.name_for(spread=True)) == first
        assert await soon(asking.name_for(to=third)) == third
        assert await soon(asking.name_for(to="gone")) == first
        assert await soon(asking.name_for(asset="")) in NAMES
        asking.fill(first)
        assert await soon(asking.name_for(spread=True)) == second
        asking.fill(second)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(asking.name_for(spread=True), 0.3)

    asyncio.run(use())


def test_calls_that_wait_for_a_full_replica_keep_no_others() -> None:
    async def use() -> None:
        asking = Asking()
        first, *_, last = replica_order(ASSET, NAMES)
        asking.fill(first)
        waiting = [asyncio.create_task(asking.name_for()) for _ in range(40)]
        await asyncio.sleep(0.1)
        assert await soon(asking.name_for(to=last)) == last
        assert not any(task.done() for task in waiting)
        asking.replicas[first].busy = 0
        assert await soon(asyncio.gather(*waiting)) == [first] * len(waiting)

    asyncio.run(use())
