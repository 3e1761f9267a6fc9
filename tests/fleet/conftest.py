"""One fleet for all tests of a session, behind the application of the single server."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.live import serving
from storage.backends import credentials


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory, s3: str) -> Iterator[Any]:
    from fleet.fleets import running_fleet

    with pytest.MonkeyPatch.context() as patch:
        for name, value in credentials(s3).items():  # processes of Ray have the environment of now
            patch.setenv(name, value)
        with running_fleet(tmp_path_factory.mktemp("fleet")) as made:
            yield made


@pytest.fixture(scope="session")
def client(fleet: Any) -> Iterator[httpx.Client]:
    with serving(fleet) as asking:
        yield asking
