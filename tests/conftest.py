"""Fixtures and settings that every test shares."""

from __future__ import annotations

import gc
import logging
import os
import ssl
import threading
from collections import Counter
from collections.abc import Generator, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

import face_data
from longest import LONGEST
from meshes import SmallMesh, bumpy_grid
from storage.backends import bucket, place, s3

if TYPE_CHECKING:
    from rhytid.device.runtime import Device

# Here, so that the tests of all folders share one server that speaks S3.
__all__ = ["bucket", "place", "s3"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """OpenCL promises 32 KiB: `pytest --local-memory 32768 tests/kernels tests/pipeline`."""
    told = "run as if work-groups of the device had no more bytes of local memory"
    parser.addoption("--local-memory", type=int, help=told)
    over = "what the server of tests/api is over: a fake engine, a real one, or replicas of Ray"
    kinds = ("fake", "engine", "ray")
    parser.addoption("--served-by", choices=kinds, default=kinds[0], help=over)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Leave what collecting made out of garbage collection, which else goes through all of it, some
    800,000 objects, every few tests: up to a fifth of the processor time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    """Let workers begin files in the order of `pytest_collection_modifyitems`, and have one thread
    each for algebra: more wait for work on the cores of other workers, a tenth of all time."""
    config.option.loadscopereorder = False
    if getattr(config.option, "numprocesses", None):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before they start


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """Let `-n auto` start half as many workers again as there are cores: many tests wait for
    processes that start, end or hang, and one worker for each core leaves a fifth of them idle."""
    cores = yield
    return cores if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ else cores * 3 // 2


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let workers begin folders in places of their own. Where tests were never run, each then
    compiles a part of them and finds what the others compiled."""
    report = yield
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
    if isinstance(collector, pytest.Directory):
        count = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
        first = len(report.result) * int(worker.removeprefix("gw")) // count
        report.result = [*report.result[first:], *report.result[:first]]
    return report


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Longest files first, then those of most tests."""
    ranks = {name: rank for rank, name in enumerate(LONGEST)}
    counts = Counter(item.path for item in items)
    items.sort(key=lambda i: (ranks.get(i.path.stem, len(ranks)), -counts[i.path], str(i.path)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """The mark `face` skips where no data are named, whatever the test reads them by."""
    if item.get_closest_marker("face") and not face_data.available():
        pytest.skip(face_data.MISSING)


@pytest.fixture(scope="session", autouse=True)
def local_memory(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let every device have what `--local-memory` says."""
    given = request.config.getoption("local_memory")
    if given is None:
        yield
        return
    from rhytid.device import select

    found = tuple(replace(c, local_memory=given) for c in select.candidates())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(select, "candidates", lambda: found)
        yield


@pytest.fixture(scope="session", autouse=True)
def programs_are_shared() -> Iterator[None]:
    """All engines of a process take one context for each device and compile a program once.

    Even what PoCL has in its cache takes 40 ms to build, and an engine builds some 15.
    """
    from rhytid.device import driver

    compile_program = driver.compile_program

    @cache
    def compiled(context: Any, text: str, options: tuple[str, ...]) -> Any:
        return compile_program(context, text, list(options))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "open_context", cache(driver.open_context))
        patch.setattr(driver, "compile_program", lambda c, text, o: compiled(c, text, tuple(o)))
        yield


@pytest.fixture(scope="session", autouse=True)
def disks_are_not_awaited() -> Iterator[None]:
    """`fsync` looks whether its file is open and no more. A test that loses power has a disk of its
    own, and processes that tests start wait for the real one.

    Tests write thousands of small files, and a disk takes up to 10 ms for each.
    """

    def looked_at(file: int) -> None:
        os.fstat(file)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", looked_at)
        yield


@pytest.fixture(scope="session", autouse=True)
def certificates_are_read_once() -> Iterator[None]:
    """All clients of a process share one context of TLS, which takes 30 ms to make: the servers of
    tests speak HTTP."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ssl, "create_default_context", cache(ssl.create_default_context))
        yield


@pytest.fixture(autouse=True)
def log_as_before() -> Iterator[None]:
    """`serve` sets up the log of its process, which outlives a test."""
    loggers = [logging.getLogger(name) for name in ("rhytid", "uvicorn")]
    before = [(logger.handlers[:], logger.level) for logger in loggers]
    yield
    for logger, (handlers, level) in zip(loggers, before, strict=True):
        logger.handlers = handlers
        if logger.level != level:  # to set it makes all loggers forget what they are enabled for
            logger.setLevel(level)


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """What commands remember of the device goes to a folder of the tests."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RHYTID_CACHE", str(folder))
        yield folder


# The same examples on every machine, and no test that depends on how fast it is.
settings.register_profile("rhytid", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("rhytid")


@pytest.fixture(scope="session")
def face() -> face_data.Face:
    """The real face, for tests marked `face`."""
    return face_data.load_face()


@pytest.fixture(scope="session")
def small_mesh() -> SmallMesh:
    """200 triangles, two UV charts, uv indices of their own."""
    return bumpy_grid(10, seed=1)


@pytest.fixture
def decoded_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Images are decoded in this process, as in the one that decodes an upload: to start another
    for each takes a fifth of a second. What such a process does is tested in tests/formats."""
    from rhytid.formats import exr

    monkeypatch.setattr(exr, "_begun", lambda name: None)


@pytest.fixture(scope="module")
def no_maps_ahead() -> Iterator[None]:
    """Builds do not draw the maps of `binned`, which takes seconds where their kernels were never
    compiled. For modules that blend none."""
    from rhytid.engine.assets import builder

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(builder, "_BINS_SHARE", 0.0)
        yield


@pytest.fixture
def unknown(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """No float of fresh memory of the device is a number."""
    import numpy as np

    kind, empty = type(device), type(device).empty

    def poisoned(self: Device, count: int, dtype: Any) -> Any:
        if dtype is np.float32:
            return self.full(count, np.float32(np.nan))
        return empty(self, count, dtype)

    monkeypatch.setattr(kind, "empty", poisoned)


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The options of each program that is compiled."""
    return _options_given(monkeypatch, "compile_program")


@pytest.fixture
def driver_builds(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The options of each build by the driver; a program may take two."""
    return _options_given(monkeypatch, "_built")


def _options_given(monkeypatch: pytest.MonkeyPatch, function: str) -> list[list[str]]:
    """The options of each call of a function of the driver, as it is called. Engines that all tests
    share build programs ahead meanwhile: what threads do that were there before does not count."""
    from rhytid.device import driver

    options: list[list[str]] = []
    build, others = getattr(driver, function), set(threading.enumerate())
    others.discard(threading.current_thread())

    def noted(context: Any, text: str, given: list[str]) -> Any:
        if threading.current_thread() not in others:
            options.append(given)
        return build(context, text, given)

    monkeypatch.setattr(driver, function, noted)
    return options


@pytest.fixture(scope="session")
def device() -> Device:
    """The OpenCL device that RHYTID_DEVICE names, else the best; where none computes, tests fail.

    Imported here, so that tests without a device need no OpenCL loader.
    """
    from rhytid.device.runtime import Device
    from rhytid.device.select import choose
    from rhytid.support.settings import ServiceSettings

    settings = ServiceSettings.from_environment()
    return Device(choose(settings.device, settings.cache), settings.device_memory)
