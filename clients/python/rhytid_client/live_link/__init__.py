"""A bridge from Live Link Face, Epic's app for iPhones, to a live connection.

`python -m rhytid_client.live_link --help` runs it; `rhytid_client.live_link.bridge` has its parts.
"""

from rhytid_client.live_link.packet import ARKIT, FaceFrame, read_packet

__all__ = ["ARKIT", "FaceFrame", "read_packet"]
