"""Work under a timer, with a window that is made up: bpy has none."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

TICK, ESC, MOUSE = (SimpleNamespace(type=kind) for kind in ("TIMER", "ESC", "MOUSEMOVE"))


@pytest.fixture
def context(blender: Any, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A window whose timers are listed."""
    from bl_ext.user_default.rhytid import working

    monkeypatch.setattr(working, "windowed", lambda context: True)
    timers: list[object] = []

    def add(seconds: float, window: object) -> object:
        timers.append(object())
        return timers[-1]

    manager = SimpleNamespace(
        event_timer_add=add, event_timer_remove=timers.remove, modal_handler_add=lambda what: True
    )
    return SimpleNamespace(window=object(), window_manager=manager, screen=None, timers=timers)


@pytest.fixture
def job(context: SimpleNamespace) -> Any:
    """Work of two steps, `fails` at the second where it is told to, that notes its end."""
    from bl_ext.user_default.rhytid import working

    from rhytid_client.hosts import Trouble

    class Job(working.Worker):
        bl_label = "Job"

        def __init__(self) -> None:
            self.fails, self.ended, self.reports = False, False, []

        def report(self, kind: set[str], text: str) -> None:
            self.reports.append(text)

        def steps(self, context: Any) -> Iterator[tuple[float, str, float]]:
            try:
                yield 0.0, "first", 0.0
                if self.fails:
                    raise Trouble("broken")
                yield 0.5, "second", 0.0
            finally:
                self.ended = True

    return Job()


def work() -> Any:
    from bl_ext.user_default.rhytid import state

    return state.work()


def test_a_step_a_tick(job: Any, context: SimpleNamespace) -> None:
    assert job.invoke(context, None) == {"RUNNING_MODAL"}
    assert job.modal(context, MOUSE) == {"PASS_THROUGH"}
    assert job.modal(context, TICK) == {"RUNNING_MODAL"}
    assert job.modal(context, TICK) == {"RUNNING_MODAL"}
    assert (work().share, work().text, work().running) == (0.5, "second", True)
    assert job.modal(context, TICK) == {"FINISHED"}
    assert context.timers == []
    assert not work().running


@pytest.mark.parametrize("how", ["escape", "button"])
def test_cancelled(job: Any, context: SimpleNamespace, how: str) -> None:
    job.invoke(context, None)
    job.modal(context, TICK)
    work().cancelled = how == "button"
    assert job.modal(context, ESC if how == "escape" else TICK) == {"CANCELLED"}
    assert job.ended
    assert job.reports == ["Cancelled"]
    assert context.timers == []


def test_trouble_ends_it(job: Any, context: SimpleNamespace) -> None:
    job.fails = True
    job.invoke(context, None)
    job.modal(context, TICK)
    assert job.modal(context, TICK) == {"CANCELLED"}
    assert job.reports == ["broken"]
    assert context.timers == []


def test_one_at_a_time(job: Any, context: SimpleNamespace) -> None:
    job.invoke(context, None)
    assert job.invoke(context, None) == {"CANCELLED"}
    assert job.reports == ["Wait until this is done: Job"]
    assert len(context.timers) == 1


def test_blender_ends_it(job: Any, context: SimpleNamespace) -> None:
    """As it does where another file is opened."""
    job.invoke(context, None)
    job.modal(context, TICK)
    job.cancel(context)
    assert job.ended
    assert context.timers == []
    assert job.invoke(context, None) == {"RUNNING_MODAL"}


def test_another_file_has_no_work(job: Any, context: SimpleNamespace) -> None:
    job.invoke(context, None)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not work().running
