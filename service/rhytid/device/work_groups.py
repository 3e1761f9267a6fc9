"""How a launch that asks for no work-groups of its own is cut into them. No result depends on it.

Left to a driver, the size of a work-group follows from the size of the launch. PoCL compiles a
kernel anew for each such size (0.2 to 0.9 s), so each new number of triangles would be compiled;
where a prime number is launched it has one work-item per group, on GPUs too.
"""

from __future__ import annotations

from dataclasses import dataclass

# Work-items per group, at most. A multiple of every vector width and of the warps of GPUs.
_MOST = 64


@dataclass(frozen=True)
class LaunchPiece:
    """A part of a launch: its first work-item, its work-items, those of a work-group."""

    offset: tuple[int, ...] | None
    size: tuple[int, ...]
    group: tuple[int, ...]


def launch_pieces(size: tuple[int, ...], largest_group: int) -> list[LaunchPiece]:
    """The pieces of a launch over `size` work-items.

    One dimension: groups of 64, and what is left in groups of one.
    More dimensions: groups along the first, the largest power of two that divides it, so that
    get_global_size is that of the whole launch.
    """
    most = 1 << (min(_MOST, largest_group).bit_length() - 1)
    if len(size) > 1:
        first = min(size[0] & -size[0], most)
        return [LaunchPiece(None, size, (first, *[1] * (len(size) - 1)))]
    whole = size[0] // most * most
    pieces = [LaunchPiece(None, (whole,), (most,))] if whole else []
    if rest := size[0] - whole:
        pieces.append(LaunchPiece((whole,) if whole else None, (rest,), (1,)))
    return pieces
