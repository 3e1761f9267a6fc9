"""The sources of the kernels, by a digest."""

from __future__ import annotations

import rhytid_kernels


def kernels_digest() -> str:
    """Twelve hexadecimal digits that change with any kernel."""
    return rhytid_kernels.digest_of_all()
