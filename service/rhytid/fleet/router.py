"""Which replica a call goes to: each asset has its own order of the replicas, by rendezvous
hashing."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b

from ray.serve.request_router import PendingRequest, RequestRouter, RunningReplica

from rhytid.fleet.envelopes import Addressed


class AssetRouter(RequestRouter):  # type: ignore[misc]
    """Rendezvous hashing: a replica that comes or goes moves its own share of the assets alone.

    A call goes to the first replica of its asset; where as many calls as it may have wait there,
    drawing goes to the next of `spread`.
    """

    def initialize_state(self, spread: int = 2) -> None:
        """spread: replicas on which an asset may be."""
        self._spread = spread

    @property
    def max_num_routing_tasks(self) -> int:
        """As many as calls wait. Ray has two for each replica, so that a few calls that wait for
        one replica would keep all others from theirs."""
        waiting: int = self.num_pending_requests
        return waiting

    async def choose_replicas(
        self,
        candidate_replicas: list[RunningReplica],
        pending_request: PendingRequest | None = None,
    ) -> list[list[RunningReplica]]:
        """Replicas that may be asked, in the order in which they are tried."""
        if pending_request is None:
            return [candidate_replicas]
        pending_request.routing_context.should_backoff = True
        call = pending_request.args[0] if pending_request.args else None
        if not isinstance(call, Addressed) or not (call.asset or call.to):
            return [candidate_replicas]
        by_name = {one.replica_id.unique_id: one for one in candidate_replicas}
        if call.to in by_name:
            return [[by_name[call.to]]]
        if not call.asset:
            return [candidate_replicas]
        names = replica_order(call.asset, by_name)
        return [[by_name[name]] for name in names[: self._spread if call.spread else 1]]


def replica_order(asset: str, replicas: Iterable[str]) -> list[str]:
    """The replicas, the one first that the asset is placed on. Without one of them the order of the
    others is the same."""
    return sorted(replicas, key=lambda name: (_weight(asset, name), name), reverse=True)


def _weight(asset: str, replica: str) -> bytes:
    return blake2b(f"{asset} {replica}".encode(), digest_size=8).digest()
