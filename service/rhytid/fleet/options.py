"""How a fleet is laid out: what `rhytid serve --ray` and `serve deploy` say of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from rhytid.errors import SettingsError

_COUNT = re.compile(r"([1-9][0-9]{0,4})(?:-([1-9][0-9]{0,4}))?", re.ASCII)


@dataclass(frozen=True)
class FleetOptions:
    """The layout.

    store: folder that all machines see under this path: of API keys, and of the assets where the
    settings name no shared store.  least, most: replicas;
    where they differ, Ray starts and ends replicas by how many calls wait.  calls: that one replica
    works on at once; where they differ, autoscaling aims at half of it.  ingresses: servers of
    HTTP, where Ray Serve has them.  spread: replicas on which one asset may be.  assets: that one
    replica keeps loaded.  local: folder of each machine for them; None: in that for temporary
    files.  cpus, gpus: that Ray counts for a replica.  without_keys: Ray's
    ingress asks nobody for an API key.
    """

    store: Path = Path("rhytid-store")
    least: int = 1
    most: int = 1
    calls: int = 64
    ingresses: int = 1
    spread: int = 2
    assets: int = 64
    local: Path | None = None
    cpus: float = 1.0
    gpus: float = 0.0
    without_keys: bool = False

    @classmethod
    def read(cls, given: Mapping[str, object]) -> FleetOptions:
        """Options by name; `replicas` is a number, or two with a hyphen, such as 2-8. Raises
        SettingsError naming an option that there is not, or that is wrong."""
        values = dict(given)
        least, most = replica_range(str(values.pop("replicas", "1")))
        found: dict[str, object] = {"least": least, "most": most}
        kinds = {field.name: field.type for field in fields(cls)}
        for name, value in values.items():
            if name not in kinds or name in ("least", "most"):
                known = ", ".join(sorted({*kinds, "replicas"} - {"least", "most"}))
                raise SettingsError(f"no option {name!r} of a fleet: there are {known}")
            found[name] = _value(name, str(kinds[name]), value)
        return cls(**found)  # type: ignore[arg-type]


def replica_range(text: str) -> tuple[int, int]:
    """Least and most replicas; raises SettingsError."""
    found = _COUNT.fullmatch(text)
    least, most = (int(part) for part in found.groups(found[1])) if found else (1, 0)
    if least > most:
        raise SettingsError(f"replicas {text!r}: a number from 1 on, or two such as 2-8")
    return least, most


def _value(name: str, kind: str, value: object) -> object:
    if "Path" in kind:
        return Path(str(value))
    if kind == "bool":
        return _flag(name, value)
    number = int if kind == "int" else float
    try:
        found = number(str(value))
    except ValueError:
        found = -1
    if not (0 <= found < 1e6) or (kind == "int" and found < 1):
        raise SettingsError(f"{name} is {value!r}: must be a number above 0")
    return found


def _flag(name: str, value: object) -> bool:
    text = str(value).lower()
    if text not in ("true", "false"):
        raise SettingsError(f"{name} is {value!r}: must be true or false")
    return text == "true"
