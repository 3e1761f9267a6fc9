"""docs/binned.md has the numbers that the maps are drawn with."""

from __future__ import annotations

import pytest

from house.syntax import ROOT
from rhytid.pipeline import cushion, cushion_layer, grain

TEXT = " ".join((ROOT / "docs" / "binned.md").read_text(encoding="utf-8").split())
FACTORS = [str(factor) for factor in cushion_layer.FACTORS]


@pytest.mark.parametrize(
    "said",
    [
        f"clip01(a/{cushion_layer.THRESHOLD:g} − 1)",
        f"weights above {cushion_layer.THRESHOLD:g}, is {cushion_layer.CARRIED:g} samples",
        f"as wide the other is, {cushion_layer.UNEVEN:g} at most",
        f"√(w² − {cushion_layer.WIDENED:g})",
        f"no less than {cushion_layer.LEAST_HALF_WIDTH:g}",
        f"the largest of {', '.join(FACTORS[:-1])} and {FACTORS[-1]}",
        f"{cushion_layer.COARSE_BLOCK} samples are left a side",
        f"log({cushion._MEETING})/`shape.cushion_sharpness`",
        f"at {grain.CODES:g} codes, or at {grain.UNEVEN_CODES:g} codes",
        f"in all by {grain.MOST_UNDULATION:g} at most",
    ],
)
def test_the_numbers_are_those_of_the_page(said: str) -> None:
    assert said in TEXT
