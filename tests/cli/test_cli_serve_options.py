"""Options of `serve` that are refused before anything is opened, and the settings behind them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rhytid.api.server import listening
from rhytid.cli import main, serve
from rhytid.cli.serve import device_numbers
from rhytid.errors import AccessError, SettingsError
from rhytid.processes.interpreter import possible
from rhytid.support.settings import ServiceSettings


@pytest.mark.parametrize(
    ("text", "numbers"), [("all", ("all",)), ("0", ("0",)), ("2,0", ("2", "0"))]
)
def test_devices_are_all_or_numbers(text: str, numbers: tuple[str, ...]) -> None:
    assert device_numbers(text) == numbers


@pytest.mark.parametrize("text", ["", "all,0", "0,", "gpu", "-1", "²"])
def test_other_lists_of_devices_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="must be all, or numbers"):
        device_numbers(text)


@pytest.mark.parametrize("other", [("--device", "0"), ("--in-process",)])
def test_several_devices_are_in_processes_of_their_own(
    other: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "store"
    assert main(["serve", "--store", str(store), "--devices", "all", *other]) == 1
    assert f"--devices and {other[0]} cannot be given together" in capsys.readouterr().err
    assert not (store / "assets").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--replicas", "2"), "--replicas is for --ray"),
        (("--ray", "--in-process"), "--ray and --in-process cannot be given together"),
        (
            ("--ray", "--shared-store", "there"),
            "shared store there: no such folder; make it, or mount",
        ),
        (("--ray", "--replicas", "2-1"), "replicas '2-1': a number from 1 on, or two such as 2-8"),
    ],
)
def test_options_of_a_fleet_go_together(
    options: tuple[str, ...], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--port", "0", "--store", str(tmp_path / "store"), *options]) == 1
    assert told in capsys.readouterr().err
    assert not (tmp_path / "store").exists()


def test_a_fleet_without_ray_names_the_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "rhytid.fleet.app", raising=False)
    monkeypatch.setitem(sys.modules, "ray", None)
    assert main(["serve", "--port", "0", "--store", str(tmp_path / "store"), "--ray"]) == 1
    said = capsys.readouterr().err
    assert (
        "--ray needs the extra ray, and ray is missing; in a clone of rhytid: pip install '.[ray]'"
        in said
    )


@pytest.mark.skipif(not possible(), reason="a device has no process of its own here")
def test_the_process_of_the_device_is_begun_once_the_limit_of_files_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It inherits the limit, and is begun before the port is taken and numpy is imported."""
    done: list[str] = []

    @contextmanager
    def begun() -> Iterator[None]:
        done.append("begun")
        yield
        done.append("over")

    def listen(host: str, port: int) -> None:
        done.append("listen")
        raise AccessError("no port")

    monkeypatch.setattr(serve, "interpreter_ahead", begun)
    monkeypatch.setattr(listening, "allow_files", lambda connections: done.append("files"))
    monkeypatch.setattr(listening, "listen", listen)
    assert main(["serve", "--port", "0", "--store", str(tmp_path / "store")]) == 1
    assert done == ["files", "begun", "listen"]


def test_the_log_has_two_formats() -> None:
    named = ServiceSettings.from_environment({"RHYTID_LOG_FORMAT": "json"})
    assert (named.log_format, ServiceSettings.from_environment({}).log_format) == ("json", "text")
    with pytest.raises(SettingsError, match="RHYTID_LOG_FORMAT is 'xml': one of text, json"):
        ServiceSettings.from_environment({"RHYTID_LOG_FORMAT": "xml"})


def test_the_time_to_finish_is_a_whole_number() -> None:
    assert ServiceSettings.from_environment({"RHYTID_DRAIN_SECONDS": "3"}).drain_seconds == 3
    with pytest.raises(SettingsError, match="RHYTID_DRAIN_SECONDS"):
        ServiceSettings.from_environment({"RHYTID_DRAIN_SECONDS": "0"})
