"""One server for all tests of the transport that need no special engine."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.asking import NPY, built, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload

# What these expect is what the fake engine answers: how many wrinkles, bins and files there are,
# when it warns; and that there is one device.
OF_THE_FAKE = {
    "test_the_graph_comes_as_lines_in_space",
    "test_an_asset_has_figures_of_its_graph",
    "test_the_manifest_counts_what_there_is",
    "test_a_mellow_merge_has_layers_of_bulges",
    "test_bad_queries_are_refused[?layer=pores-422-query-sample is missing: "
    "layer pores has 3, 0 to 2]",
    "test_the_zip_has_every_file_as_it_is",
    "test_files_have_their_types_and_tags",
    "test_a_range_is_given",
    "test_ranges_that_are_none",
    "test_an_asset_has_its_warnings",
    "test_frames_and_calibrations_have_theirs",
    "test_tiles_that_are_drawn_once_have_a_header",
    "test_strict_is_a_problem",
    "test_a_strict_asset_is_not_made",
    "test_an_allowed_code_is_no_problem",
    "test_an_asset_with_an_allowed_code_is_made",
    "test_devices_say_their_memory",
}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Over another engine than the fake one, tests run that ask the server alone."""
    if config.getoption("served_by") == "fake":
        return
    left = [item for item in items if not _asks_the_server_alone(item)]
    items[:] = [item for item in items if item not in left]
    config.hook.pytest_deselected(items=left)


def _asks_the_server_alone(item: pytest.Item) -> bool:
    if not isinstance(item, pytest.Function):
        return False
    if {item.name, item.originalname} & OF_THE_FAKE:
        return False
    own = inspect.signature(item.function).parameters
    return "server" in item.fixturenames and "engine" not in own


@pytest.fixture(scope="session")
def engine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What the server is over; `--served-by` says which."""
    with _engine(request.config.getoption("served_by"), tmp_path_factory.mktemp("api")) as made:
        yield made


@contextmanager
def _engine(kind: str, folder: Path) -> Iterator[Any]:
    if kind == "fake":
        yield FakeEngine()
    elif kind == "engine":
        from engine.engines import running

        with running(folder) as real:
            yield real
    else:
        from fleet.fleets import running_fleet

        with running_fleet(folder) as fleet:
            yield fleet


@pytest.fixture(scope="session")
def server(engine: Any) -> Iterator[httpx.Client]:
    with serving(engine, upload_limit=1 << 20) as client:
        yield client


@pytest.fixture
def client(server: httpx.Client) -> Iterator[httpx.Client]:
    """A client of the server, which still answers after the test."""
    yield server
    assert server.get("/healthz").json() == {"status": "alive"}


@pytest.fixture(scope="session")
def asset(server: httpx.Client) -> str:
    return built(server, upload())


@pytest.fixture
def frame(server: httpx.Client, asset: str) -> Iterator[str]:
    """The path of a stored frame, forgotten after the test."""
    path = f"/v1/assets/{asset}/frames/smile"
    server.put(path, content=npy(smile()), headers=NPY).raise_for_status()
    yield path
    server.delete(path)
