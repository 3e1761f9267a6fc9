"""The sheet of controls: patches as they are, in rows, with names and values."""

from __future__ import annotations

import numpy as np

from rhytid.pictures.sheet import ACROSS, MARGIN, PATCH, TITLE, LabelledPatch, control_sheet


def patches(first: int) -> list[LabelledPatch]:
    """Three of plain colours."""
    return [
        LabelledPatch(label, np.full((PATCH, PATCH, 3), (first, n, 7), np.uint8))
        for n, label in enumerate(("low", "[mid]", "high"))
    ]


def test_patches_are_as_they_are_and_in_order() -> None:
    names = [f"control {n}" for n in range(ACROSS + 1)]
    sheet = np.asarray(control_sheet({n: patches(i) for i, n in enumerate(names)}, "caption"))
    for control in range(len(names)):
        for value in range(3):
            inside = (sheet == (control, value, 7)).all(axis=-1)
            assert inside.sum() == PATCH * PATCH
            rows, columns = np.nonzero(inside)
            assert (np.ptp(rows), np.ptp(columns)) == (PATCH - 1, PATCH - 1)
            if control == 0:
                assert rows.min() == MARGIN + TITLE
                assert columns.min() == MARGIN + value * (PATCH + 4)
    second = np.nonzero((sheet == (ACROSS, 0, 7)).all(axis=-1))
    assert second[1].min() == MARGIN
    assert second[0].min() > MARGIN + TITLE + PATCH


def test_values_stand_below_their_patches() -> None:
    sheet = np.asarray(control_sheet({"control": patches(0)}, ""))
    top = MARGIN + TITLE + PATCH
    for value in range(3):
        left = MARGIN + value * (PATCH + 4)
        assert (sheet[top : top + 22, left : left + PATCH] < 128).any()
