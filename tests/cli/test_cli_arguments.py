"""What the command line understands, and how it says no."""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import rhytid
from rhytid.cli import main
from rhytid.cli.program import COMMANDS, GROUP, build_parser
from rhytid.support import build_identity

NAMES = ["bake", "bench", "demo", "devices", "graph", "reproduce", "serve", "synthesize"]
NAMES += ["check", "completion", "convert", "transfer", "warnings"]


def ends(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert isinstance(end.value.code, int)
    return end.value.code


@pytest.mark.parametrize("name", NAMES)
def test_help_has_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ends([name, "--help"]) == 0
    assert f"example: rhytid {name} " in capsys.readouterr().out


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert ends(["--help"]) == 0
    told = capsys.readouterr().out
    assert all(f"    {name}" in told for name in NAMES)


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_what_is_told_of_all_commands_imports_nothing_that_computes(option: str) -> None:
    code = (
        "import sys; from rhytid.cli import main\ntry: main(sys.argv[1:])\n"
        "finally: print({'numpy', 'tqdm', 'rhytid.cli.check', 'pyopencl'} & set(sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code, option], capture_output=True, text=True)
    assert "rhytid" in told.stdout
    assert told.stdout.splitlines()[-1] == "set()"


def test_the_summaries_in_the_help_of_all_are_those_of_the_commands(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert ends(["--help"]) == 0
    assert capsys.readouterr().out == build_parser().format_help()


@pytest.mark.parametrize("summaries", [{}, {"visit": "See a friend."}])
def test_the_help_of_all_has_commands_of_other_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, summaries: dict[str, str]
) -> None:
    package, metadata = tmp_path / "friends", tmp_path / "friends-1.dist-info"
    package.mkdir(), metadata.mkdir()
    (package / "__init__.py").write_text(f"SUMMARIES = {summaries}")
    (package / "visit.py").write_text(
        "from rhytid.cli.parser import new_command\n"
        "def add_command(commands):\n"
        "    new_command(commands, 'visit', 'See a friend.', '').set_defaults(run=print)\n"
    )
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: friends\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\nvisit = friends.visit\n")
    code = (
        "import sys; from rhytid.cli import main\ntry: main(sys.argv[1:])\n"
        "finally: print('friends.visit' in sys.modules, file=sys.stderr)"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for words, imported in ((["--help"], not summaries), (["visit", "--help"], True)):
        command = [sys.executable, "-c", code, *words]
        told = subprocess.run(command, capture_output=True, text=True)
        assert "See a friend." in told.stdout
        assert told.stderr.strip() == str(imported)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert ends(["--version"]) == 0
    drawing, revision = build_identity.drawing_version(), build_identity.revision()
    wanted = f"rhytid {rhytid.__version__} (drawing {drawing}, revision {revision})\n"
    assert capsys.readouterr().out == wanted


@pytest.mark.parametrize(
    ("command", "option", "pattern"),
    [
        ("synthesize {} --out g", "--map", "density={}"),
        ("synthesize {} --out g", "--region-mask", "lip={}"),
        ("bake --mesh {} --out o", "--stiffness", "{}"),
        ("bake --mesh {} --out o", "--frames", "{}"),
        ("demo", "--frames", "{}"),
    ],
)
def test_an_option_of_several_values_may_be_given_again(
    tmp_path: Path, command: str, option: str, pattern: str
) -> None:
    files = [tmp_path / name for name in "abcd"]
    for file in files:
        file.touch()
    words = command.format(files[3]).split()
    one, two, three = (pattern.format(file) for file in files[:3])
    parser, name = build_parser(), option[2:].replace("-", "_")
    again = vars(parser.parse_args([*words, option, one, two, option, three]))[name]
    assert again == vars(parser.parse_args([*words, option, one, two, three]))[name]
    assert len(again) == 3


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["nothing"],
        ["serve", "--port", "65536"],
        ["serve", "--port", "-1"],
        ["serve", "--port", "٣"],
        ["bake", "--out", "x"],
        ["bake", "--stretch", "sideways"],
        ["bake", "--mesh", "no-such.obj", "--out", "x"],
        ["synthesize", "no-such.obj", "--out", "x"],
        ["demo", "--unit", "inch"],
    ],
)
def test_usage_errors_end_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert ends(arguments) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert re.match("rhytid( [a-z]+)?: error: ", line)


def test_a_folder_in_place_of_files_is_told_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends(["bake", __file__, "--frames", str(tmp_path), "--out", "x"]) == 2
    assert (
        f"argument --frames: {tmp_path} is a folder: name a file in it" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("arguments", "program", "told"),
    [
        ("bak", "rhytid", "argument COMMAND: invalid choice: 'bak' (.*); did you mean bake[?]"),
        (
            "bake --allow texel-siez",
            "rhytid bake",
            "argument --allow: invalid choice: 'texel-siez' (.*); did you mean texel-size[?]",
        ),
        (
            "xyz",
            "rhytid",
            "argument COMMAND: invalid choice: 'xyz' (.*); rhytid --help says more",
        ),
    ],
)
def test_a_mistyped_choice_is_told_what_may_be_meant(
    arguments: str, program: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends(arguments.split()) == 2
    assert re.fullmatch(f"{program}: error: {told}\n", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("bake --wrinkels 3", "--wrinkels; did you mean --wrinkles?"),
        ("bake {} --out o --wrinkels=3", "--wrinkels; did you mean --wrinkles?"),
        ("bake {} --out o --res 256", "--res; did you mean --residual or --resolution?"),
        ("bake {} --out o -resolution 256", "-resolution 256; did you mean --resolution?"),
        ("synthesize {} --out o --age 65", "--age; it is a setting: --set age=VALUE"),
        ("bake {} --out o --anatomy=fine", "--anatomy; it is a setting: --set anatomy=VALUE"),
        ("look maps --bnd /a", "--bnd; did you mean --bind?"),
        ("look maps --out x", "--out; rhytid look --help says more"),
        ("template {} --preview x", "--preview; rhytid template --help says more"),
        ("demo --xyz x", "--xyz; rhytid demo --help says more"),
        ("check {} --dask", "--dask; rhytid check --help says more"),
        ("check {} {}", "{}; rhytid check --help says more"),
        ("keys create --scope read", "--scope; did you mean --scopes?"),
        ("--verison", "--verison; did you mean --version?"),
        ("export --mesh {} --out x", "--out; rhytid export --help says more"),
    ],
)
def test_a_mistyped_option_is_one_line_of_its_command(
    arguments: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mesh.obj"
    file.touch()
    words = arguments.replace("{}", str(file)).split()
    program = "rhytid" if words[0].startswith("-") else f"rhytid {words[0]}"
    assert ends(words) == 2
    expected = f"{program}: error: unrecognized arguments: {told.replace('{}', str(file))}\n"
    assert capsys.readouterr().err == expected


@pytest.mark.parametrize("name", ["bake", "check", "controls", "convert", "synthesize", "template"])
def test_the_mesh_is_an_argument_or_an_option(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "mesh.obj", ["--out", "o"] if name != "check" else []
    file.touch()
    parser = build_parser()
    for words in ([str(file), *out], [*out, str(file)], ["--mesh", str(file), *out]):
        assert parser.parse_args([name, *words]).mesh == file
    assert ends([name, str(file), "--mesh", str(file), *out]) == 2
    assert "--mesh: not allowed with" in capsys.readouterr().err
    assert ends([name, *out]) == 2
    assert "--mesh is required" in capsys.readouterr().err


def test_the_demo_takes_a_mesh_or_none(tmp_path: Path) -> None:
    file = tmp_path / "mesh.obj"
    file.touch()
    parser = build_parser()
    assert parser.parse_args(["demo"]).mesh is None
    assert parser.parse_args(["demo", str(file)]).mesh == file
    assert parser.parse_args(["demo", "--mesh", str(file)]).mesh == file


def test_the_help_of_bake_has_its_options_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    assert ends(["bake", "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    heads = [line for line in lines if re.fullmatch("[a-z, ]+:", line)]
    assert heads == [
        "options:", "input:", "skin:", "scanned displacement:", "output:",
        "assets, devices and many machines:", "what is reported:",
    ]  # fmt: skip
    groups = subparsers()["bake"]._action_groups
    assert [len(group._group_actions) for group in groups[:2]] == [0, 3]


def test_frames_of_the_demo_need_a_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = tmp_path / "frame.obj"
    frame.touch()

    assert ends(["demo", "--frames", str(frame)]) == 2
    assert "--frames needs --mesh" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.b", "a/b", "..", "-a", "", "a" * 65, "é"])
def test_names_of_files_are_plain(name: str, tmp_path: Path) -> None:
    mesh = tmp_path / "mesh.obj"
    mesh.touch()

    assert ends(["bake", "--mesh", str(mesh), "--out", "x", f"--name={name}"]) == 2


def test_graph_and_wrinkles_exclude_each_other(tmp_path: Path) -> None:
    file = tmp_path / "mesh.obj"
    file.touch()
    given = ["bake", "--mesh", str(file), "--out", "x"]

    assert ends([*given, "--wrinkles", "500", "--graph", str(file)]) == 2


@pytest.mark.parametrize(
    ("arguments", "both"),
    [
        ("synthesize {} --out g.safetensors --ages 20 65", ("--ages", "--preview")),
        ("bake --mesh {} --out o --graph {} --lines level", ("--lines", "--graph")),
        ("bake --mesh {} --out o --graph {} --shapes {}", ("--shapes", "--graph")),
        ("bake --mesh {} --out o --graph {} --region lip", ("--region", "--graph")),
        ("bake --mesh {} --out o --graph {} --set age=60", ("--set", "--graph")),
        ("bake --mesh {} --out o --graph {} --map scale={}", ("--map", "--graph")),
        ("bake --mesh {} --out o --graph {} --region-mask lip={}", ("--region-mask", "--graph")),
    ],
)
def test_an_option_without_effect_is_an_error_that_names_both(
    arguments: str, both: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mesh.obj"
    file.touch()
    assert ends(arguments.replace("{}", str(file)).split()) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert all(option in told for option in both)


@pytest.mark.parametrize("name", [*NAMES, None])
def test_no_option_is_understood_by_its_beginning(name: str | None) -> None:
    parser = build_parser()
    commands = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    assert not (parser if name is None else commands.choices[name]).allow_abbrev


def test_bake_takes_no_set_for_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mesh.obj"
    file.touch()
    assert ends(["bake", "--mesh", str(file), "--out", "x", "--set", str(file)]) == 2
    assert "argument --set: " in capsys.readouterr().err


def subparsers() -> dict[str, argparse.ArgumentParser]:
    actions = build_parser()._actions
    return next(a for a in actions if isinstance(a, argparse._SubParsersAction)).choices


@pytest.mark.parametrize("name", NAMES)
def test_help_shows_every_default(name: str) -> None:
    parser = subparsers()[name]
    formatter = parser._get_formatter()
    valued = [a for a in parser._actions if a.option_strings and not a.required and a.nargs != 0]
    told = {a.dest: formatter._expand_help(a) for a in valued}

    assert [dest for dest, words in told.items() if "(default: " not in words] == []
    for action in valued:
        if action.default not in (None, []) and "implementations methods".find(action.dest) < 0:
            assert f"(default: {action.default}" in told[action.dest]


@pytest.mark.parametrize("name", NAMES)
def test_every_command_can_be_quiet_or_verbose(name: str) -> None:
    options = {option for action in subparsers()[name]._actions for option in action.option_strings}
    assert {"-q", "--quiet", "-v", "--verbose"} <= options


SKIN = {"--unit", "--seed", "--region", "--map", "--set", "--region-mask", "--lines", "--shapes"}
SKIN |= {"--spacing", "--wrinkles"}


def test_skin_has_the_same_options_in_every_command() -> None:
    def told(name: str) -> dict[str, tuple[object, ...]]:
        actions = [a for a in subparsers()[name]._actions if SKIN & set(a.option_strings)]
        return {
            a.option_strings[0]: (a.nargs, a.type and a.type.__name__, a.default, a.metavar)
            for a in actions
        }

    assert set(told("bake")) == SKIN
    assert told("bake") == told("synthesize") == told("demo")


def test_json_goes_to_a_file_or_to_stdout() -> None:
    parser = build_parser()

    assert parser.parse_args(["devices"]).json is None
    assert parser.parse_args(["devices", "--json"]).json == Path("-")
    assert parser.parse_args(["devices", "--json", "x"]).json == Path("x")


def test_serve_is_for_this_machine_alone_unless_told() -> None:
    arguments = build_parser().parse_args(["serve"])

    assert (arguments.host, arguments.port) == ("127.0.0.1", 8717)


FOR_JOB = (["--progress", "openjd"], ["--progress=openjd"])


@pytest.mark.parametrize("progress", FOR_JOB)
@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["bake", "--mesh", "no-such.obj", "--out", "x"], "no such file: no-such.obj"),
        (["bake", "--mesh", "", "--out", "x"], "a name of no characters: name a file"),
        (["bake", "--mesh", __file__, "--out", "x", "--chunk", "3"], "--chunk says how many"),
        (["restore", "no-such.tar"], "no such file: no-such.tar"),
        (["restore", __file__, "--nothing"], "unrecognized arguments: --nothing"),
    ],
)
def test_a_farm_is_told_what_is_wrong_with_arguments(
    arguments: list[str], reason: str, progress: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends([*arguments, *progress]) == 2
    told = capsys.readouterr()
    [line] = told.out.splitlines()
    assert line.startswith("openjd_fail: rhytid")
    assert reason in line
    assert reason in told.err

    assert ends(arguments) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_no_file_that_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert ends(["synthesize", str(pipe), "--out", "g.safetensors"]) == 2
    assert "is a pipe or a device" in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_alone_has_the_help_that_it_has_among_all(name: str) -> None:
    def helped(parser: argparse.ArgumentParser) -> str:
        (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        return str(commands.choices[name].format_help())

    assert helped(build_parser(name)) == helped(build_parser())
