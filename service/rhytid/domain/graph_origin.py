"""What a wrinkle graph was made with, and of which mesh: what its file says beside the arrays."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import Mesh
from rhytid.domain.units import millimetres
from rhytid.errors import GraphError, SettingsError

_LEAST, _MOST = 1e-30, 1e30
MOST_SEED = 2**31 - 1
_TEXTS = {"unit": 16, "mesh": 64}


@dataclass(frozen=True)
class GraphOrigin:
    """Lengths as in `Lengths`, in `unit`; None where the file does not say.

    seed: of the relief between the lines, `graph.seed`.  mesh: the digest of the mesh that the
    graph was made for.
    """

    unit: str | None = None
    spacing: float | None = None
    depth: float | None = None
    sigma: float | None = None
    wave_frequency: float | None = None
    grain_size: float | None = None
    undulation_size: float | None = None
    seed: int | None = None
    mesh: str | None = None

    @classmethod
    def of(cls, mesh: Mesh, unit: str, lengths: Lengths, seed: int | None = None) -> GraphOrigin:
        """Of a graph for this mesh, in its unit."""
        return cls(unit, **asdict(lengths), seed=seed, mesh=mesh_digest(mesh))

    @classmethod
    def parse(cls, metadata: Mapping[str, str]) -> GraphOrigin | None:
        """From the metadata of a file; None where it says nothing of this. Other keys are left.

        Raises GraphError naming the key whose value cannot be used.
        """
        known = {field.name for field in fields(cls)}
        found = {key: _value(key, text) for key, text in metadata.items() if key in known}
        return cls(**found) if found else None  # type: ignore[arg-type]

    def metadata(self) -> dict[str, str]:
        """The inverse of `parse`: numbers in as many digits as they have."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: value if isinstance(value, str) else repr(value)
            for name, value in values.items()
            if value is not None
        }

    def lengths(self, unit: str, spacing: float) -> Lengths:
        """In another unit.  spacing: of the pores, in that unit, where the file does not say it.

        Raises SettingsError where lengths cannot be converted.
        """
        own = self.in_unit(unit)
        usual = Lengths.of(spacing if own.spacing is None else own.spacing)
        names = [field.name for field in fields(Lengths)]
        said = {n: getattr(own, n) for n in names if getattr(own, n) is not None}
        return replace(usual, **said)

    def in_unit(self, unit: str) -> GraphOrigin:
        """The same lengths in another unit; raises SettingsError where one of both is unknown."""
        if self.unit is None or self.unit == unit:
            return replace(self, unit=unit)
        one, other = millimetres(self.unit), millimetres(unit)
        if one is None or other is None:
            raise SettingsError(
                f"the graph is in {self.unit!r} and the mesh in {unit!r} (settings.unit): one of "
                "them is no known unit of length, so that depth and spacing cannot be converted"
            )
        factor = one / other
        names = ("spacing", "depth", "sigma", "grain_size", "undulation_size")
        changed: dict[str, Any] = {n: _times(getattr(self, n), factor) for n in names}
        changed["wave_frequency"] = _times(self.wave_frequency, 1.0 / factor)
        return replace(self, unit=unit, **changed)

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise GraphError where the graph was made for a mesh of other triangles or UV."""
        if self.mesh is not None and self.mesh != mesh_digest(mesh):
            raise GraphError(
                "the graph was made for another mesh: the triangles or the UV of this one differ; "
                "`force` (--force, or the form field of that name) takes it all the same"
            )


def mesh_digest(mesh: Mesh) -> str:
    """32 hexadecimal digits of the triangles and their texture coordinates (as float32): what a
    graph is tied to. Positions do not count: a graph fits every head of one topology."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.faces, "<i4").tobytes())
    digest.update(np.ascontiguousarray(mesh.triangle_uv(), "<f4").tobytes())
    return digest.hexdigest()[:32]


def _times(length: float | None, factor: float) -> float | None:
    return None if length is None else length * factor


def _value(key: str, text: str) -> str | float:
    if key == "seed":
        # Digits of ASCII alone: int() takes signs, spaces, underscores and other scripts, too.
        if not (text.isascii() and text.isdecimal() and len(text) <= 10 and int(text) <= MOST_SEED):
            raise GraphError(f"metadata seed is {text!r:.80}: must be from 0 to {MOST_SEED}, whole")
        return int(text)
    if key in _TEXTS:
        if not 0 < len(text) <= _TEXTS[key] or not text.isprintable():
            rule = f"1 to {_TEXTS[key]} printable characters"
            raise GraphError(f"metadata {key} is {text!r:.80}: must be {rule}")
        return text
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (_LEAST <= number <= _MOST):
        raise GraphError(f"metadata {key} is {text!r:.80}: must be a number above 0")
    return number
