"""What a package hands out to be run elsewhere: templates of shaders, and stretch in Python and in
JavaScript. `stretch.py` and `folds.py` need numpy alone."""

from __future__ import annotations

from importlib.resources import files


def runtime(name: str) -> str:
    """The text of a file of this folder."""
    return (files(__name__) / name).read_text(encoding="utf-8")
