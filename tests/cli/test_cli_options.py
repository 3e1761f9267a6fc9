"""From options to settings."""

from __future__ import annotations

import argparse
import socket
from pathlib import Path

import pytest

from rhytid.api.server.listening import address_of, listen
from rhytid.cli import main
from rhytid.cli.program import build_parser
from rhytid.cli.service_options import local_settings
from rhytid.cli.skin_options import asset_settings, given_settings, skin_maps, skin_settings
from rhytid.cli.synthesize import grown_settings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import InputError, SettingsError
from rhytid.support.settings import misspelt_variables


def options(**given: object) -> argparse.Namespace:
    names = ("settings", "resolution", "wrinkles", "spacing", "lines", "seed", "region", "unit")
    nothing: dict[str, object] = {**dict.fromkeys(names), "set": []}
    return argparse.Namespace(**{**nothing, **given})


def test_no_options_are_no_settings() -> None:
    assert asset_settings(options()) == {}


@pytest.mark.parametrize("text", ['{"graph": {"agee": 1}}', "[]", "{"])
def test_a_file_of_settings_that_is_wrong_is_named(tmp_path: Path, text: str) -> None:
    file = tmp_path / "s.json"
    file.write_text(text)
    with pytest.raises(SettingsError, match=f"^{file}"):
        given_settings(options(settings=file))


def test_options_overrule_the_file(tmp_path: Path) -> None:
    file = tmp_path / "s.json"
    file.write_text('{"resolution": 512, "graph": {"seed": 3, "wrinkles": 500}, "depth": 0.1}')

    found = asset_settings(options(settings=file, resolution=1024, wrinkles=600))

    assert found == {"resolution": 1024, "graph": {"seed": 3, "wrinkles": 600}, "depth": 0.1}


def test_a_spacing_takes_the_place_of_a_number(tmp_path: Path) -> None:
    file = tmp_path / "s.json"
    file.write_text('{"graph": {"seed": 3, "wrinkles": 500}}')

    assert asset_settings(options(settings=file, spacing=0.1)) == {
        "graph": {"seed": 3, "spacing": 0.1}
    }


def test_options_of_skin_overrule_the_file(tmp_path: Path) -> None:
    file = tmp_path / "s.json"
    file.write_text('{"unit": "m", "graph": {"seed": 3, "age": 20, "scale": 2}}')
    given = {"seed": 4, "region": "lip", "unit": "mm", "set": [("age", 60.0)], "lines": "level"}

    assert asset_settings(options(settings=file, **given)) == {
        "unit": "mm",
        "graph": {"seed": 4, "age": 60.0, "scale": 2, "region": "lip", "lines": "level"},
    }


def test_a_small_map_is_one_tile() -> None:
    given = asset_settings(options(resolution=256))
    assert given == {"resolution": 256}
    assert AssetSettings.parse(given).tile_size == 256


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"resolutoin": 512}', "\xff"])
def test_bad_settings_are_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "s.json"
    file.write_text(text, encoding="latin-1")

    with pytest.raises(SettingsError):
        asset_settings(options(settings=file))


@pytest.mark.parametrize(("wrinkles", "seed"), [(5, None), (None, -1), (10**9, None)])
def test_graph_settings_are_checked(wrinkles: int | None, seed: int | None) -> None:
    given = {"wrinkles": wrinkles, "seed": seed}
    graph = {name: value for name, value in given.items() if value is not None}
    with pytest.raises(SettingsError, match=r"graph\.(wrinkles|seed)"):
        grown_settings({"graph": graph})


def test_options_overrule_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RHYTID_STORE", "from-environment")
    monkeypatch.setenv("RHYTID_DEVICE", "one")
    monkeypatch.setenv("RHYTID_QUEUE", "7")

    assert local_settings(None, None).store == Path("from-environment")
    found = local_settings(Path("given"), "two")
    assert (found.store, found.device, found.queue) == (Path("given"), "two", 7)


def test_a_free_port_is_told() -> None:
    with listen("127.0.0.1", 0) as listening:
        assert address_of(listening) == f"http://127.0.0.1:{listening.getsockname()[1]}"


def test_the_end_of_an_answer_does_not_wait_for_an_acknowledgement() -> None:
    with (
        listen("127.0.0.1", 0) as listening,
        socket.create_connection(listening.getsockname()),
        listening.accept()[0] as accepted,
    ):
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_taken_port_is_refused() -> None:
    with listen("127.0.0.1", 0) as listening:
        port = listening.getsockname()[1]
        with pytest.raises(InputError, match=f"cannot listen on 127.0.0.1 port {port}: Address"):
            listen("127.0.0.1", port)


def test_variables_that_are_misspelt_are_named() -> None:
    given = {
        "RHYTID_STOER": "x", "RHYTID_HOST_MEMORY": "x", "RHYTID_KEY_FILE": "x",
        "RHYTID_STALL_SECOND": "x", "PATH": "x", "RHYTID_STORE": "x",
        # Of tests, of clients, and what Kubernetes makes of a Service called rhytid.
        "RHYTID_FACE_DATA": "x", "RHYTID_SCREENSHOTS": "x", "RHYTID_KEY": "x", "RHYTID_URL": "x",
        "RHYTID_TEST_FAULT": "x", "RHYTID_PORT": "x", "RHYTID_SERVICE_HOST": "x",
        "RHYTID_SERVICE_PORT_HTTP": "x", "RHYTID_PORT_8717_TCP_ADDR": "x",
    }  # fmt: skip
    assert misspelt_variables(given) == [
        "RHYTID_STOER is not known: did you mean RHYTID_STORE?",
        "RHYTID_HOST_MEMORY is not known: did you mean RHYTID_HOST_MEMORY_MB?",
        "RHYTID_KEY_FILE is not known: did you mean RHYTID_KEYS_FILE?",
        "RHYTID_STALL_SECOND is not known: did you mean RHYTID_STALL_SECONDS?",
    ]


def test_a_variable_that_another_stands_for_is_named() -> None:
    given = {"FORWARDED_ALLOW_IPS": "*"}
    assert misspelt_variables(given) == [
        "FORWARDED_ALLOW_IPS is not read: RHYTID_PROXIES stands for it"
    ]
    assert misspelt_variables({**given, "RHYTID_PROXIES": "10.1.2.3"}) == []


def test_commands_warn_of_misspelt_variables(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("RHYTID_STORE", str(tmp_path))
    monkeypatch.setenv("RHYTID_SPOOLMB", "1")
    assert main(["keys", "list"]) == 0
    told = "rhytid keys: warning: RHYTID_SPOOLMB is not known: did you mean RHYTID_SPOOL_MB?\n"
    assert capsys.readouterr().err == told


def test_settings_of_a_file_are_grown(tmp_path: Path) -> None:
    file = tmp_path / "s.json"
    file.write_text('{"graph": {"rank": 2, "anatomy": "coarse"}, "response": {"folds": 0}}')
    command = ["synthesize", str(file), "--out", "g.safetensors", "--settings", str(file)]
    given = build_parser().parse_args([*command, "--set", "rank=0.5"])
    settings = grown_settings(skin_settings(given, given_settings(given)))
    assert (settings.rank, settings.anatomy) == (0.5, "coarse")


def test_a_setting_may_be_a_word(tmp_path: Path) -> None:
    file = tmp_path / "mesh.obj"
    file.touch()
    command = ["synthesize", str(file), "--out", "g.safetensors", "--set", "anatomy=coarse"]
    given = build_parser().parse_args(command)
    assert grown_settings(skin_settings(given)).anatomy == "coarse"


def test_a_mask_of_a_region_has_two_names(tmp_path: Path) -> None:
    file = tmp_path / "mask.png"
    file.touch()
    masks = [f"mouth={file}", f"region_mouth={file}"]
    command = ["synthesize", str(file), "--out", "g.safetensors", "--region-mask", *masks]
    assert skin_maps(build_parser().parse_args(command)) == {"region_mouth": [file, file]}
