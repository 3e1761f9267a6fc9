"""`rhytid keys`: the API keys that a server asks for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path

from rhytid.api.keys import COMPUTE, READ, SCOPES, ApiKey, changing, new_key, read_keys, utc_now
from rhytid.cli.options import add_json, add_several, base_name
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import local_settings
from rhytid.cli.summaries import SUMMARIES
from rhytid.errors import InputError
from rhytid.support.console import report, table

HEADER = ("name", "id", "scopes", "made", "expires", "requests/s", "jobs")
ACTIONS = ("create", "list", "revoke")
# What those who draw need: all but removing what others use.
USUAL = (READ, COMPUTE)
# Days; some 100 years.
LONGEST = 36_500
MOST = 10**6


def add_command(commands: Commands) -> None:
    """Add `keys` to the parser."""
    summary = SUMMARIES["keys"]
    example = "rhytid keys create farm --scopes read --expires 90"
    parser = new_command(commands, "keys", summary, example)
    add = parser.add_argument
    action = "create prints a new key, which is shown this once; list; revoke takes one away"
    add("action", choices=ACTIONS, help=action)
    name = "whose key it is, to create or revoke: a person, a program, a farm"
    add("name", nargs="?", type=base_name, metavar="NAME", help=name)
    scopes = "what a new key allows: read asks, compute sends meshes and frames, admin removes "
    scopes += f"assets (default: {' '.join(USUAL)})"
    add_several(parser, "--scopes", choices=SCOPES, help=scopes)
    days = "days after which a new key is not valid any more"
    add("--expires", type=_days, metavar="DAYS", help=days)
    rate = "requests per second of a new key (default: RHYTID_KEY_RATE of the server)"
    add("--rate", type=_count, metavar="N", help=rate)
    jobs = "unfinished jobs of a new key (default: RHYTID_KEY_JOBS of the server)"
    add("--jobs", type=_count, metavar="N", help=jobs)
    store = "folder of the assets, which has the keys in keys.json where RHYTID_KEYS_FILE names no "
    store += "other file (default: of RHYTID_STORE, else rhytid-store)"
    add("--store", type=Path, metavar="DIR", help=store)
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.error)


def run(arguments: argparse.Namespace) -> None:
    """Create, list or revoke keys. Raises InputError for a name that is taken or unknown."""
    listed = arguments.action == "list"
    if listed == (arguments.name is not None):
        arguments.usage_error(f"{arguments.action} takes {'no' if listed else 'a'} NAME")
    path = local_settings(arguments.store, None).key_file
    {"create": _create, "list": _list, "revoke": _revoke}[arguments.action](path, arguments)


def _create(path: Path, arguments: argparse.Namespace) -> None:
    days = arguments.expires
    expires = None if days is None else utc_now().replace(microsecond=0) + timedelta(days=days)
    scopes = arguments.scopes or USUAL
    shown, key = new_key(arguments.name, scopes, expires, arguments.rate, arguments.jobs)
    with changing(path) as keys:
        if any(known.name == key.name for known in keys):
            raise InputError(f"there is a key {key.name} already: revoke it, or take another name")
        keys.append(key)
    print(f"{path} has the key {key.name}. It is shown this once:", file=sys.stderr)
    report({"key": shown, **_figures(key)}, shown, arguments.json)


def _list(path: Path, arguments: argparse.Namespace) -> None:
    keys: list[ApiKey] = []
    with suppress(FileNotFoundError):
        keys = read_keys(path)
    report([_figures(key) for key in keys], table(HEADER, _rows(keys)), arguments.json)


def _revoke(path: Path, arguments: argparse.Namespace) -> None:
    with changing(path) as keys:
        found = [key for key in keys if key.name == arguments.name]
        if not found:
            raise InputError(f"{path} has no key {arguments.name}")
        keys.remove(found[0])
    report(_figures(found[0]), f"revoked {arguments.name}", arguments.json)


def _rows(keys: Iterable[ApiKey]) -> Iterable[tuple[object, ...]]:
    now = utc_now()
    for key in keys:
        scopes = " ".join(scope for scope in SCOPES if scope in key.scopes)
        expires = "never" if key.expires is None else _day(key.expires)
        over = "" if key.valid(now) else " (over)"
        limits = (key.rate or "", key.jobs or "")
        yield (key.name, key.id, scopes, _day(key.created), expires + over, *limits)


def _figures(key: ApiKey) -> dict[str, object]:
    return {
        "name": key.name,
        "id": key.id,
        "scopes": [scope for scope in SCOPES if scope in key.scopes],
        "created": key.created.isoformat(),
        "expires": None if key.expires is None else key.expires.isoformat(),
        "valid": key.valid(utc_now()),
        "rate": key.rate,
        "jobs": key.jobs,
    }


def _day(time: datetime) -> str:
    return time.strftime("%Y-%m-%d")


def _days(text: str) -> int:
    return _whole(text, LONGEST)


def _count(text: str) -> int:
    return _whole(text, MOST)


def _whole(text: str, most: int) -> int:
    if not (text.isascii() and text.isdigit() and 0 < int(text[:12]) <= most):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 1 to {most}")
    return int(text)
