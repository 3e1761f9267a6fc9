"""What schemathesis is told of our media types: they are bytes."""

from __future__ import annotations

import schemathesis

for media_type in ("application/x-tar", "application/x-npy", "application/vnd.safetensors"):
    schemathesis.serializer.alias(media_type, "application/octet-stream")
