"""Commands of `rhytid` that show and measure, found through the entry points `rhytid.commands`."""

from __future__ import annotations

from importlib.util import find_spec

from rhytid.domain.wording import install_hint
from rhytid.errors import RhytidError

# Read by `rhytid --help`, which imports no command for them.
SUMMARIES = {
    "bench": (
        "Time a frame on a device, in seconds and in map copies (a copy reads and writes "
        "R² float32 in the same run), beside other implementations of the same: graphics "
        "shaders, numba, numpy, OpenCV. What differs from ours is not timed. On the "
        "built-in face, or on one of your own with its frames."
    ),
    "demo": "Run the service on a face and write EXR sequences, contact sheets and times.",
    "reproduce": (
        "Remake the figures and the timing table of the paper and measure how close the "
        "fast method comes, as one HTML page with pictures and figures; minutes on a "
        "processor."
    ),
}


def check_client() -> None:
    """Raise RhytidError saying how to get it where the SDK is not installed."""
    if find_spec("rhytid_client") is None:
        hint = f"{install_hint('lab')} ./clients/python"
        raise RhytidError(f"this command goes through the SDK, rhytid-client; {hint}")
