"""One fleet for all tests of a session, behind the application of the single server."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.live import serving


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    from fleet.fleets import running_fleet

    with running_fleet(tmp_path_factory.mktemp("fleet")) as made:
        yield made


@pytest.fixture(scope="session")
def client(fleet: Any) -> Iterator[httpx.Client]:
    with serving(fleet) as asking:
        yield asking
