"""Makes the package of the Blender extension by Blender's own builder, and has it validated.

    python clients/blender/build.py --out dist                    # Blender on the PATH, or bpy
    python clients/blender/build.py --out dist --blender /opt/blender/blender

The SDK goes in as a wheel that is built here, of this repository: it needs numpy alone, which
Blender has. Nothing that is made here belongs in the repository.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).resolve().parent
SOURCE = HERE / "rhytid_blender"
SDK = HERE.parent / "python"


def main() -> None:
    """Stage, build, validate; the last line is the path of the package."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("dist"), help="folder of the package")
    parser.add_argument("--blender", help="a Blender from 4.2 on (the one on the PATH, else bpy)")
    options = parser.parse_args()
    tool = extension_tool(options.blender)
    options.out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        staged = stage(Path(folder) / "rhytid")
        package = options.out.resolve() / f"rhytid-{version(staged)}.zip"
        paths = ["--source-dir", str(staged), "--output-filepath", str(package)]
        subprocess.run([*tool, "build", *paths], check=True)
    subprocess.run([*tool, "validate", str(package)], check=True)
    sys.stdout.write(f"{package}\n")


def extension_tool(blender: str | None) -> list[str]:
    """The command that takes `build` and `validate`; ends the program where there is none."""
    found = blender or shutil.which("blender")
    if found:
        return [found, "--command", "extension"]
    spec = find_spec("bpy")
    folders = spec.submodule_search_locations if spec else None
    for folder in folders or []:
        for tool in Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"):
            return [sys.executable, str(tool)]
    raise SystemExit("no Blender: name one with --blender, or run this by a Python that has bpy")


def stage(folder: Path) -> Path:
    """The source of the extension with the SDK's wheel in it, named by the manifest."""
    shutil.copytree(SOURCE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(HERE.parents[1] / "LICENSE", folder)
    wheels = folder / "wheels"
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--wheel-dir", str(wheels), str(SDK)], check=True)
    listed = ", ".join(f'"./wheels/{path.name}"' for path in sorted(wheels.iterdir()))
    manifest = folder / "blender_manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    # Before the first table: what follows one would belong to it.
    top, table, rest = text.partition("\n[permissions]")
    manifest.write_text(f"{top}\nwheels = [{listed}]\n{table}{rest}", encoding="utf-8")
    return folder


def version(folder: Path) -> str:
    """The version that the manifest names."""
    lines = (folder / "blender_manifest.toml").read_text(encoding="utf-8").splitlines()
    line = next(line for line in lines if line.startswith("version = "))
    return line.split('"')[1]


if __name__ == "__main__":
    main()
