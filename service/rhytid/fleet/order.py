"""The order of replicas for an asset, by rendezvous hashing."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b


def order(asset: str, replicas: Iterable[str]) -> list[str]:
    """The replicas, the one first that the asset is placed on. Without one of them the order of the
    others is the same."""
    return sorted(replicas, key=lambda name: (_weight(asset, name), name), reverse=True)


def _weight(asset: str, replica: str) -> bytes:
    return blake2b(f"{asset} {replica}".encode(), digest_size=8).digest()
