"""What the log has of handshakes."""

from __future__ import annotations

import logging
from typing import Any

import httpx
import pytest
from websockets.exceptions import InvalidStatus

from live.speaker import speaking

KEY = "rhytid_0123456789abcdef"


def test_a_key_of_a_query_is_in_no_record_and_the_path_is(
    server: httpx.Client, asset: str, caplog: pytest.LogCaptureFixture, monkeypatch: Any
) -> None:
    caplog.set_level("DEBUG")
    # As `rhytid serve` sets it.
    monkeypatch.setattr(logging.getLogger("uvicorn.error"), "level", logging.INFO)
    # The query of a refused handshake, and one that is accepted with nothing in it.
    with pytest.raises(InvalidStatus), speaking(server, asset, query=f"?key={KEY}"):
        pass
    with speaking(server, asset):
        pass
    ours = [record for record in caplog.records if not record.name.startswith("websockets.client")]
    assert [record.getMessage() for record in ours if KEY in record.getMessage()] == []
    told = [record.getMessage() for record in ours if "WebSocket" in record.getMessage()]
    assert told == [f"WebSocket /v1/assets/{asset}/live {status}" for status in (422, 101)]
