"""Who asks: by this jobs of several callers take turns."""

from contextvars import ContextVar

# The key, or the address, that this thread or task works for; empty where it is for none.
caller: ContextVar[str] = ContextVar("caller", default="")
