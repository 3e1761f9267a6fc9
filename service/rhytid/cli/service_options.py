"""Options of what opens a device or a store. They are apart from those of `options`, which import
numpy: `serve` starts the process of its device before that."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from rhytid.support.settings import ServiceSettings

# A parser, or a group of its options in --help.
Arguments = argparse._ActionsContainer
MAX_PORT = 65535


def port_number(text: str) -> int:
    """A TCP port; 0 takes any free one."""
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 0 to {MAX_PORT}")
    return int(text)


def add_device(parser: Arguments, more: str = "") -> None:
    """Add `--device D`."""
    device = f"number or part of the name of a device{more} (default: RHYTID_DEVICE, or chosen)"
    parser.add_argument("--device", metavar="D", help=device)


def add_store(parser: Arguments) -> None:
    """Add `--store DIR`."""
    store = "folder of the assets (default: of RHYTID_STORE, else rhytid-store)"
    parser.add_argument("--store", type=Path, metavar="DIR", help=store)


def add_shared_store(parser: Arguments) -> None:
    """Add `--shared-store PLACE`."""
    place = (
        "where assets are that several machines share: a folder that all mount, or "
        "s3://BUCKET/PREFIX with the extra s3 (default: of RHYTID_SHARED_STORE, else none)"
    )
    parser.add_argument("--shared-store", metavar="PLACE", help=place)


def service_settings(
    store: Path | None, device: str | None, shared_store: str | None
) -> ServiceSettings:
    """The settings of the environment, with values of the command line in place of theirs."""
    found = ServiceSettings.from_environment()
    return replace(
        found,
        store=store or found.store,
        device=device or found.device,
        shared_store=shared_store or found.shared_store,
    )


def local_settings(store: Path | None, device: str | None) -> ServiceSettings:
    """The same without a shared store, and without a time limit of builds: nobody else waits for
    the device."""
    return replace(service_settings(store, device, None), shared_store=None, build_seconds=None)
