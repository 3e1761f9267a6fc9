"""Imports go one way."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

import pytest

from house.syntax import PACKAGES, ROOT, Import, imported_room, imports, room, sources, tree
from longest import LONGEST

# What each part of `rhytid` may import of `rhytid`, beside itself.
_FACTS = {"errors", "domain", "support"}
_TOOLS = _FACTS | {"device", "formats"}
_WORK = {"pipeline", "synthesis", "storage"}
ALLOWED = {
    "__init__": set(),
    "__main__": {"cli"},
    "errors": set(),
    "support": {"errors"},
    "domain": {"errors"},
    "device": _FACTS,
    "formats": _FACTS,
    "pictures": _FACTS,
    "meshes": _FACTS | {"formats", "synthesis"},
    "pipeline": _TOOLS,
    "synthesis": _TOOLS,
    "tracing": _TOOLS | {"pipeline", "synthesis"},
    "storage": _TOOLS,
    "exports": _FACTS | {"formats", "pipeline"},
    "engine": _TOOLS | _WORK | {"exports", "tracing"},
    "processes": _TOOLS | {"engine", "meshes", "storage"},
    "fleet": _TOOLS | {"api", "engine", "processes", "storage"},
    "api": _TOOLS | {"engine", "exports", "processes", "storage"},
    "baking": _TOOLS | {"engine", "exports", "meshes", "storage", "synthesis"},
    "cli": _TOOLS
    | _WORK
    | {"api", "baking", "engine", "fleet", "processes"}
    | {"exports", "meshes", "pictures", "tracing"},
}
# Modules of `rhytid.support` that only what runs a service may import: the rest is told.
SERVICES = {"api", "baking", "cli", "engine", "fleet", "processes", "support"}
OF_SERVICES = ("rhytid.support.settings", "rhytid.support.logs")
# The only parts that may import a package from outside; other packages are free.
ONLY_IN = {
    "pyopencl": {"device"},
    "fastapi": {"api"},
    "starlette": {"api"},
    "uvicorn": {"api"},
    "rhytid_kernels": {"device", "support"},
    "rhytid_viewer": {"api", "exports"},
    "trimesh": {"exports", "meshes"},
    "OpenImageIO": {"exports", "formats"},
    "dask": {"baking"},
    "distributed": {"baking"},
    "fsspec": {"storage"},
    "s3fs": {"storage"},
    "ray": {"fleet"},
}
# The only readers of the environment: the settings, and what OpenCL's loader must find there.
ENVIRONMENT = (
    "support/settings.py",
    "device/caches.py",
    "device/loader.py",
    # Hands it on to the child, with the number of heaps.
    "processes/interpreter.py",
    # Hands it on to processes, with one more filter of warnings.
    "baking/farm/dask_cluster.py",
)


def everything(package: str) -> Iterator[Import]:
    for file in sources(package):
        yield from imports(file)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_is_found(package: str) -> None:
    assert sources(package)


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_are_absolute(package: str) -> None:
    assert [str(i) for i in everything(package) if i.level] == []


def test_scripts_import_what_there_is() -> None:
    """mypy reads the packages alone, and pytest never runs the scripts beside the tests."""
    folders = (ROOT / "tests", ROOT / "docs")
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    wrong = [
        str(i) for file in files for i in imports(file) if i.top in PACKAGES and missing(i.module)
    ]

    assert wrong == []


@cache
def missing(name: str) -> bool:
    """Whether `name` is neither a module nor something in one."""
    try:
        resolve_name(name)
    except (ImportError, AttributeError):
        return True
    return False


def test_imports_go_down() -> None:
    wrong = [
        str(found)
        for found in everything("rhytid")
        if (target := imported_room(found)) not in (None, room(found.file))
        and target not in ALLOWED[room(found.file)]
    ]

    assert wrong == []


def test_only_services_read_the_settings_and_set_up_the_log() -> None:
    wrong = [
        str(found)
        for found in everything("rhytid")
        if found.module.startswith(OF_SERVICES) and room(found.file) not in SERVICES
    ]

    assert wrong == []


def test_every_part_has_a_rule() -> None:
    assert {room(file) for file in sources("rhytid")} <= set(ALLOWED)


@pytest.mark.parametrize("outside", ONLY_IN)
def test_an_outside_package_has_its_place(outside: str) -> None:
    wrong = [
        str(found)
        for found in everything("rhytid")
        if found.top == outside and room(found.file) not in ONLY_IN[outside]
    ]

    assert wrong == []


@pytest.mark.parametrize("above", ["rhytid_lab", "rhytid_client", "matplotlib"])
def test_the_service_never_imports_what_is_built_on_it(above: str) -> None:
    assert [str(found) for found in everything("rhytid") if found.top == above] == []


def test_domain_knows_numpy_alone() -> None:
    known = {"rhytid", "numpy", *sys.stdlib_module_names}
    wrong = [
        str(i) for i in everything("rhytid") if room(i.file) == "domain" and i.top not in known
    ]

    assert wrong == []


@pytest.mark.parametrize(
    ("package", "outside"),
    [("rhytid_kernels", set()), ("rhytid_viewer", set()), ("rhytid_client", {"httpx", "numpy"})],
)
def test_kernels_and_clients_stand_alone(package: str, outside: set[str]) -> None:
    known = {package, *outside, *sys.stdlib_module_names}

    assert [str(i) for i in everything(package) if i.top not in known] == []


def test_the_environment_is_read_in_one_place() -> None:
    base = PACKAGES["rhytid"] / "rhytid"
    allowed = {base / name for name in ENVIRONMENT}
    files = [file for package in PACKAGES for file in sources(package) if file not in allowed]

    assert [reader for file in files for reader in environment_readers(file)] == []


def environment_readers(file: Path) -> list[str]:
    """Every mention of the environment: `os.environ`, `getenv`, and their like."""
    names = {"environ", "environb", "getenv", "getenvb", "putenv", "unsetenv"}
    if not any(name in file.read_text(encoding="utf-8") for name in names):
        return []
    found = [
        node.lineno
        for node in ast.walk(tree(file))
        if (isinstance(node, ast.Attribute) and node.attr in names)
        or (isinstance(node, ast.ImportFrom) and names & {alias.name for alias in node.names})
    ]
    return [f"{file.relative_to(ROOT)}:{line}" for line in found]


def test_files_that_are_begun_first_are_there() -> None:
    """A file that is split or renamed else goes to the end, unnoticed."""
    there = {file.stem for file in (ROOT / "tests").rglob("test_*.py")}
    assert set(LONGEST) <= there
    assert len(LONGEST) == len(set(LONGEST))
