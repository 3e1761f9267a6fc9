"""Shell completion, as bash does it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from rhytid.cli import main

# Completes the words of its arguments as bash does at their end, by the function registered.
ASK = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
function=$(complete -p rhytid | sed -E 's/.* -F ([^ ]+) .*/\\1/')
"$function" rhytid "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD-1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    assert main(["completion", "bash"]) == 0
    file = tmp_path / "rhytid.bash"
    file.write_text(capsys.readouterr().out)
    return file


def completed(script: Path, *words: str) -> set[str]:
    """What bash offers after these words, the last of which is not finished."""
    bash = shutil.which("bash")
    assert bash is not None, "these tests need bash"
    command = [bash, "--norc", "-c", ASK, "bash", str(script), *words]
    found = subprocess.run(command, cwd=script.parent, capture_output=True, text=True, check=False)
    assert found.stderr == ""
    return set(found.stdout.split())


def test_commands_are_completed(script: Path) -> None:
    assert completed(script, "rhytid", "s") == {"serve", "snapshot", "synthesize"}
    assert {"bake", "demo", "completion"} <= completed(script, "rhytid", "")


def test_options_are_completed(script: Path) -> None:
    assert completed(script, "rhytid", "bake", "--st") == {
        "--stretch", "--stiffness", "--store", "--strict"
    }  # fmt: skip


def test_choices_are_completed(script: Path) -> None:
    assert completed(script, "rhytid", "bake", "--method", "") == {
        "neutral", "redraw", "binned", "convolved"
    }  # fmt: skip


def test_files_are_completed(script: Path) -> None:
    (script.parent / "head.obj").touch()
    (script.parent / "head.npz").touch()

    assert completed(script, "rhytid", "bake", "--mesh", "hea") == {"head.obj", "head.npz"}
    assert completed(script, "rhytid", "check", "hea") == {"head.obj", "head.npz"}


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name in script for name in ("synthesize", "bake", "demo", "region-mask"))
