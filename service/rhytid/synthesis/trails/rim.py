"""Lines beside bare skin. Walkers cannot cross it and wear its rim twice as deep as other lines:
left alone, a ring of a crack goes round. Lines fade there instead, as they do towards a scar.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.seams.charts import trace
from rhytid.synthesis.surface import Surface

# How far around a line skin is looked at, in pore spacings, and in how many directions.
_REACH, _LOOKS = 2.0, 8
# Power of the share that is not bare. At the rim half is; lines along it are then as deep as
# others, within a tenth.
_FADING = 1.25


def beside_bare(
    surface: Surface,
    across: NDArray[np.int32],
    fields: Fields,
    triangle: NDArray[np.integer],
    uv: NDArray[np.floating],
    spacing: float,
) -> NDArray[np.float32]:
    """(N,) factors of the weight of lines whose middles are at uv (N, 2): 1 away from bare skin.

    across: (F, 3) neighbours of the triangles; what is painted beyond a chart does not count.
    spacing: of the pores of even skin, in units of the surface.
    """
    reach = _REACH * spacing * fields.spacing(triangle, uv).astype(np.float64)
    bare = np.zeros(len(triangle), np.float32)
    jacobian = surface.jacobian[triangle]
    # With JᵀJ = LLᵀ a step of L⁻ᵀe in UV is as long as e on the surface.
    uu = np.sqrt((jacobian[..., 0] ** 2).sum(-1))
    along = (jacobian[..., 0] * jacobian[..., 1]).sum(-1) / uu
    upward = surface.density[triangle] / uu
    for angle in 2.0 * np.pi * np.arange(_LOOKS) / _LOOKS:
        v = np.sin(angle) / upward
        step = reach[:, None] * np.stack([(np.cos(angle) - along * v) / uu, v], axis=-1)
        seen = np.flatnonzero(fields.bare(triangle, (uv + step).astype(np.float32)))
        line = trace(surface, across, triangle[seen], uv[seen].astype(np.float64), step[seen])
        bare[seen[line.share >= 1.0]] += 1.0
    found: NDArray[np.float32] = (1.0 - bare / np.float32(_LOOKS)) ** np.float32(_FADING)
    return found
