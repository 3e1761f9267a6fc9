"""A store that several machines share: immutable objects, and a manifest per asset."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.errors import InputError

if TYPE_CHECKING:
    from rhytid.storage.shared.backend import Backend

_SCHEME = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")
_BUCKET = re.compile(r"s3://[a-z0-9][a-z0-9.-]{1,61}[a-z0-9](?:/[^/]+)*/?")


def backend_of(text: str) -> Backend:
    """The place that an option names: the path of a folder, or s3://BUCKET/PREFIX.

    Raises InputError where it is neither, or the extra that it needs is missing.
    """
    if not _SCHEME.match(text):
        from rhytid.storage.shared.folder_backend import FolderBackend

        return FolderBackend(Path(text))
    if not _BUCKET.fullmatch(text):
        raise InputError(f"shared store {text!r}: must be a folder, or like s3://bucket/prefix")
    from rhytid.storage.shared.bucket_backend import BucketBackend

    return BucketBackend(text)
