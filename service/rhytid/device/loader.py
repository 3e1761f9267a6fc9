"""What the loader of OpenCL must find before pyopencl is imported."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from rhytid.device.caches import provide_cache_folder
from rhytid.support.atomic_files import atomic_write
from rhytid.support.temporary_folders import removed_at_exit

SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
# A pip driver for FPGA emulation is installed with the one for CPUs; it is ignored.
_CPU_DRIVER = "intel-cpu.icd"
# Of the folder of caches.
_KEPT = "rhytid-opencl"


def prepare_loader() -> None:
    """Let pyopencl, which is imported after this, find pip's drivers and a folder that drivers can
    write to: in this process, and in those that it starts.

    The loader inside pyopencl's wheel reads `.icd` files from one folder, the system's by default.
    A driver from pip leaves its file in the environment's own `etc/OpenCL/vendors`, often with a
    bare library name that only resolves inside `lib`. So a folder of our own gets both, with full
    paths. That is left alone where OCL_ICD_VENDORS is set, off Linux, and where pip installed no
    driver.
    """
    prefix = Path(sys.prefix)
    driver = pip_driver(prefix)
    kept = provide_cache_folder()
    if driver is not None and sys.platform == "linux" and "OCL_ICD_VENDORS" not in os.environ:
        os.environ["OCL_ICD_VENDORS"] = str(_vendor_folder(driver, kept))
    _pin_pocl()


def _pin_pocl() -> None:
    """Have PoCL keep each of its threads on a core of its own, unless the user set POCL_AFFINITY.

    Left to the system, threads that slept share a core for up to a quarter of a second: a blend
    took half as long again. PoCL numbers cores from 0, so it is left alone where this process may
    not use all of them.
    """
    if sys.platform == "linux" and os.sched_getaffinity(0) == set(range(os.cpu_count() or 0)):
        os.environ.setdefault("POCL_AFFINITY", "1")


def pip_driver(prefix: Path) -> Path | None:
    """The library of a CPU driver that pip put below `prefix`, or None."""
    entry = prefix / "etc" / "OpenCL" / "vendors" / _CPU_DRIVER
    if not entry.is_file():
        return None
    library = Path(entry.read_text(encoding="utf-8").strip())
    candidates = (library, prefix / "lib" / library.name)
    return next((path for path in candidates if path.is_absolute() and path.is_file()), None)


def _vendor_folder(driver: Path, kept: Path | None) -> Path:
    """A folder with the files of all drivers. Among the caches it is named by what it holds and
    stays for the next start, so that a process that is killed leaves nothing.

    kept: the folder of caches; where there is none, the folder goes with the process.
    """
    files = {entry.name: entry.read_bytes() for entry in sorted(SYSTEM_VENDORS.glob("*.icd"))}
    files[_CPU_DRIVER] = f"{driver}\n".encode()
    if kept is not None:
        with suppress(OSError):
            return _filled(kept / _KEPT / _digest(files), files)
    return _filled(removed_at_exit(Path(tempfile.mkdtemp(prefix="rhytid-opencl-"))), files)


def _digest(files: Mapping[str, bytes]) -> str:
    text = repr(sorted(files.items())).encode()
    return hashlib.sha256(text).hexdigest()[:16]


def _filled(folder: Path, files: Mapping[str, bytes]) -> Path:
    """The folder with these files. Those that are there as they are asked for stay: another process
    may read them."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    for name, data in files.items():
        file = folder / name
        if not (file.is_file() and file.read_bytes() == data):
            with atomic_write(file) as aside:
                aside.write_bytes(data)
    return folder
