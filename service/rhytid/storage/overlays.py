"""The present settings of a built asset, in a file that is replaced when they are changed."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from rhytid.domain.asset_settings import AssetSettings
from rhytid.storage.canonical import damaged, hashed, parse_canonical, parse_hashed
from rhytid.storage.homes import ASSET, OVERLAY
from rhytid.storage.manifest import read_file
from rhytid.storage.records import FACTS, OVERLAID, decode_settings, parse_settings
from rhytid.support.atomic_files import storage_errors


def write_overlay(label: str, settings: AssetSettings) -> bytes:
    """Settings that were changed since the asset `label` was built, as a file of their own."""
    return hashed({"label": label, "settings": settings.as_json()})


def read_overlay(label: str, data: bytes, path: Path) -> AssetSettings:
    """The inverse of `write_overlay`; raises StorageError naming `path`."""
    value = parse_hashed(data, path)
    if not isinstance(value, dict) or value.get("label") != label:
        raise damaged(path, f"not the settings of {label}")
    return parse_settings(value.get("settings"), path)


def changed_settings(home: Path) -> AssetSettings | None:
    """The present settings of a built asset, or None of one of an older version that never
    changed. Raises StorageError where they are damaged.

    home: the folder of the asset, which is called by its id.
    """
    path, facts = home / OVERLAY, home / ASSET / FACTS
    with storage_errors(f"{path} cannot be read"), suppress(FileNotFoundError):
        return read_overlay(f"{ASSET} {home.name}", path.read_bytes(), path)
    with storage_errors(f"{facts} cannot be read"):
        found = parse_canonical(facts.read_bytes(), facts)
    if isinstance(found, dict) and found.get(OVERLAID, False):
        raise damaged(path, "the file is missing")
    return None


def present_settings(home: Path) -> AssetSettings:
    """As `changed_settings`, or those that the asset was built with."""
    if (changed := changed_settings(home)) is not None:
        return changed
    folder = home / ASSET
    facts = read_file(folder, f"{ASSET} {home.name}", FACTS)
    return decode_settings(facts, folder / FACTS)
