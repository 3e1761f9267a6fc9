"""What the Dockerfile takes away is not needed; compose.yaml says the same of health."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from house.syntax import ROOT

DOCKER = ROOT / "docker"


@pytest.mark.slow
def test_nothing_of_scipy_is_imported_that_the_image_lacks() -> None:
    loop = re.search(r"for part in ([a-z ]+); do", (DOCKER / "slim").read_text())
    assert loop is not None
    gone = loop[1].split()
    assert len(gone) > 5
    code = (
        "import sys, pkgutil, importlib\n"
        f"sys.modules.update(dict.fromkeys([f'scipy.{{part}}' for part in {gone}]))\n"
        "import scipy.ndimage, scipy.sparse.csgraph, scipy.spatial, trimesh.graph\n"
        "import trimesh.triangles, rhytid\n"
        "for found in pkgutil.walk_packages(rhytid.__path__, 'rhytid.'):\n"
        "    if found.name != 'rhytid.__main__':\n"
        "        importlib.import_module(found.name)\n"
    )
    found = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True)
    assert found.returncode == 0, found.stderr.decode()


def test_only_these_parts_of_scipy_are_used() -> None:
    """Also within functions, which the test above does not call."""
    text = "\n".join(file.read_text() for file in (ROOT / "service/rhytid").rglob("*.py"))
    used = set(re.findall(r"\bscipy\.(\w+)", text))
    used |= set(re.findall(r"from scipy import (\w+)", text))
    assert used == {"ndimage", "sparse", "spatial"}


def test_compose_asks_for_health_as_the_image_does() -> None:
    in_image = re.search(r"^HEALTHCHECK (.+)$", (DOCKER / "Dockerfile").read_text(), re.MULTILINE)
    assert in_image is not None
    compose = (DOCKER / "compose.yaml").read_text()
    command = in_image[1].partition("CMD [")[2].rstrip("]")
    assert f'test: ["CMD", {command}]' in compose
    for option, key in (("interval", "interval"), ("timeout", "timeout")):
        value = re.search(rf"--{option}=(\w+)", in_image[1])
        assert value is not None
        assert f"{key}: {value[1]}" in compose


@pytest.mark.parametrize("wanted", ["USER 10001:10001", "--locked", "AS nvidia", "AS cpu"])
def test_the_dockerfile_keeps_its_promises(wanted: str) -> None:
    assert wanted in (DOCKER / "Dockerfile").read_text()


def test_what_the_dockerfile_copies_reaches_the_build() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    lines = [line.split()[1:-1] for line in text.splitlines() if line.startswith("COPY ")]
    copied = [name for names in lines for name in names if not names[0].startswith("--from")]
    allowed = {
        line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line[:1] == "!"
    }
    assert {name.split("/")[0] for name in copied} <= allowed
    assert [name for name in copied if not (ROOT / name).exists()] == []
