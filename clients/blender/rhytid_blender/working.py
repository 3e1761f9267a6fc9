"""Long work of an operator: step by step under a timer where there is a window, else at once."""

from __future__ import annotations

from collections.abc import Generator
from time import sleep

import bpy

from rhytid_client.hosts import Trouble
from rhytid_client.hosts.work import Step

from . import state
from .typed import OperatorPart, Result, window_manager_of

TICK_SECONDS = 0.1


def windowed(context: bpy.types.Context) -> bool:
    """Whether there are events: none in background mode, though a file may bring its windows."""
    return context.window is not None and not bpy.app.background


class Worker(OperatorPart):
    """A part of an operator: `steps` does the work, and leaves things sound where it is closed."""

    def steps(self, context: bpy.types.Context) -> Generator[Step, None, None]:
        """The work; raises Trouble."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> Result:
        """All of it, before anything else happens."""
        try:
            for _, _, seconds in self.steps(context):
                sleep(seconds)
        except Trouble as trouble:
            self.report({"ERROR"}, str(trouble))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> Result:
        """Step by step, Esc ends it."""
        work = state.work()
        if not windowed(context):
            return self.execute(context)
        if work.running:
            self.report({"ERROR"}, f"Wait until this is done: {work.text}")
            return {"CANCELLED"}
        work.running, work.cancelled, work.share, work.text = True, False, 0.0, self.bl_label
        self._steps, manager = self.steps(context), window_manager_of(context)
        self._timer = manager.event_timer_add(TICK_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> Result:
        """One step a tick of the timer."""
        work = state.work()
        if event.type == "ESC" or work.cancelled:
            return self._end(context, {"CANCELLED"}, "Cancelled")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            work.share, work.text, _ = next(self._steps)
        except StopIteration:
            return self._end(context, {"FINISHED"}, "")
        except Trouble as trouble:
            self.report({"ERROR"}, str(trouble))
            return self._end(context, {"CANCELLED"}, "")
        except BaseException:
            self._end(context, {"CANCELLED"}, "")
            raise
        _redraw(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends it: another file is opened, or the window is closed."""
        self._end(context, {"CANCELLED"}, "")

    def _end(self, context: bpy.types.Context, result: Result, message: str) -> Result:
        try:
            self._steps.close()
        finally:
            state.work().running = False
            window_manager_of(context).event_timer_remove(self._timer)
        if message:
            self.report({"INFO"}, message)
        _redraw(context)
        return result


def _redraw(context: bpy.types.Context) -> None:
    for area in context.screen.areas if context.screen else ():
        if area.type == "VIEW_3D":
            area.tag_redraw()
