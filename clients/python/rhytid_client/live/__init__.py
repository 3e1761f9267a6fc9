"""A live connection: frames go out, tiles come in (docs/live.md has the messages).

It needs the extra `live`: in a clone of rhytid `pip install './clients/python[live]'`.
"""

from rhytid_client.live.messages import LiveAnswer, LiveAsset, LiveTile

__all__ = ["LiveAnswer", "LiveAsset", "LiveTile"]
