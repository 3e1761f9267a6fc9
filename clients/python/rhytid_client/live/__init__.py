"""A live connection: frames go out, tiles come in (docs/live.md has the messages).

It needs the extra `live`: `pip install 'rhytid-client[live]'`.
"""

from rhytid_client.live.messages import LiveAnswer, LiveAsset, LiveTile

__all__ = ["LiveAnswer", "LiveAsset", "LiveTile"]
