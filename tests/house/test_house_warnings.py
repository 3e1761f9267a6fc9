"""docs/warnings.md says of every warning when it is told, and what to do."""

from __future__ import annotations

import pytest

from house.markdown import bare, table
from house.syntax import ROOT
from rhytid.domain import warnings as limits
from rhytid.domain.mesh import FAR_SIZES
from rhytid.domain.notices import NOTICES
from rhytid_client.requests import FAR_SIZES as FAR_SIZES_OF_CLIENT

TEXT = (ROOT / "docs" / "warnings.md").read_text(encoding="utf-8")
ROWS = {bare(row["code"]): row for row in table(TEXT, "Warnings")}
NUMBERS = {
    limits.STRETCH_AT_CLAMP: (f"above {limits.CLAMP_MEDIAN:g} ",),
    limits.FRAME_SCALED: (f"{limits.SCALED_MEDIAN:g} or more", f" {limits.SCALED_SPREADS:g} times"),
    limits.CALIBRATION_STILL: (f"{limits.STILL_STRETCH:g} or less",),
    limits.FAR_FROM_ORIGIN: (f"more than {limits.STEP_OF_EDGE:g} of",),
    limits.MESH_SIZE: (
        f"{limits.LEAST_SIZE / 10:g} cm to {limits.MOST_SIZE / 1000:g} m in its unit",
    ),
    limits.NORMALS_INWARD: (f"below {limits.INWARD_COSINE:g} ",),
    limits.UV_MIRRORED: (f"more than {100 * limits.MIRRORED_SHARE:g} % ",),
    limits.UV_OVERLAP: (f"more than {100 * limits.OVERLAP_SHARE:g} % ",),
    limits.TEXEL_SIZE: (f"more than {limits.TEXEL_RATIO:g} times",),
    limits.SETTINGS_CHANGED: (),
    limits.SETTINGS_UNUSED: (),
    limits.ARRAYS_UNUSED: (),
    limits.FILES_REPLACED: (),
    limits.DEVICES_MIXED: (),
    limits.METHODS_MIXED: (),
    limits.PATCH_SIZE: (),
    limits.SCAN_DEPTH: (
        f"{limits.SHALLOWEST:g} to {limits.DEEPEST:g} mm deep",
        f"steeper than {limits.STEEPEST:g} to 1",
    ),
    limits.SCAN_BITS: (f"{limits.FEW_LEVELS:g} different",),
    limits.SCAN_BLOCKS: (f"more than {limits.BLOCK_RATIO:g} times",),
    limits.SCAN_MIDLEVEL: (),
    limits.SCAN_FLAT: (),
    limits.SCAN_MIRRORED: (f"more than {limits.FLIP_MARGIN:g}",),
    limits.SCAN_SEAMS: (f"more than {limits.SEAM_SHARE:g} of",),
    limits.SCAN_LINES: (f"more than {limits.LINES_LEFT:g} of",),
    limits.SCAN_FILL: (),
}


def test_every_code_has_a_row() -> None:
    assert set(ROWS) == set(limits.CODES) == set(NUMBERS)
    assert all(row["what to do"] for row in ROWS.values())


@pytest.mark.parametrize("code", limits.CODES)
def test_the_limits_are_those_of_the_table(code: str) -> None:
    assert [n for n in NUMBERS[code] if n not in ROWS[code]["when"]] == []


def test_the_tables_say_what_the_command_prints() -> None:
    for heading, meanings in (("Warnings", limits.WARNINGS), ("Notices", NOTICES)):
        rows = [tuple(row.values()) for row in table(TEXT, heading)]
        known = meanings.items()
        assert rows == [(f"`{code}`", m.of, m.when, m.remedy) for code, m in known]
    assert set(limits.WARNINGS) == set(limits.CODES)


def test_the_usual_spread_of_texels_is_told_alike() -> None:
    assert f"Up to {limits.TEXEL_USUAL:g} times is usual" in " ".join(TEXT.split())


def test_client_and_server_agree_on_what_is_far() -> None:
    assert FAR_SIZES == FAR_SIZES_OF_CLIENT
    assert f"more than {FAR_SIZES:g} times its own" in " ".join(TEXT.split())
