"""The log of a server: lines of text or of JSON, each with the id of its request."""

from __future__ import annotations

import json
import logging
from contextvars import ContextVar
from datetime import datetime, timezone

# The id of the request that this thread or task works for; empty where it is for none.
request_id: ContextVar[str] = ContextVar("request_id", default="")
# Whose lines are written: this package's, and those of the HTTP server.
_LOGGERS = ("rhytid", "uvicorn")


class _Lines(logging.Formatter):
    """process: `server` or `device`."""

    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:
        """ISO 8601 in UTC, with milliseconds."""
        at = datetime.fromtimestamp(record.created, timezone.utc)
        return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")


class TextLines(_Lines):
    """Lines `time LEVEL process [request] message`; traces follow on lines of their own."""

    def __init__(self, process: str) -> None:
        super().__init__(process)
        self._style = logging.PercentStyle("%(asctime)s %(levelname)s %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line."""
        wanted = request_id.get()
        about = f" [{wanted}]" if wanted else ""
        time = self.formatTime(record)
        return f"{time} {record.levelname} {self._process}{about} {record.message}"


class JsonLines(_Lines):
    """One JSON object a line, in ASCII. The entries of a record's `fields` are members of it."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        line = {
            "time": self.formatTime(record),
            "level": record.levelname.lower(),
            "process": self._process,
            "logger": record.name,
            "message": record.getMessage(),
        }
        if wanted := request_id.get():
            line["request_id"] = wanted
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps({**line, **getattr(record, "fields", {})}, default=str)


def log_to_stderr(format: str, level: int, process: str) -> None:
    """Write the log to stderr from now on.  format: text or json.  process: see `TextLines`."""
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines(process) if format == "json" else TextLines(process))
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers = [handler]
        logger.setLevel(level)
