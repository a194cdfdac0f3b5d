"""How a run tells what it is doing: a live line per stage, JSON lines, or nothing."""

import abc
import json
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from rich.console import Console


class AbstractTeller(abc.ABC):
    """Where the news of a run goes."""

    @abc.abstractmethod
    def started(self, stage: str, elapsed: float) -> AbstractContextManager:
        """A stage begins; the returned context lasts as long as the stage."""

    @abc.abstractmethod
    def detail(self, message: str, elapsed: float) -> None:
        """News of the stage at work."""

    @abc.abstractmethod
    def finished(self, stage: str, seconds: float, elapsed: float) -> None:
        """A stage ended after `seconds`."""

    @abc.abstractmethod
    def warned(self, message: str, elapsed: float) -> None:
        """Something the user should know that does not stop the run."""


class Silent(AbstractTeller):
    """Says nothing."""

    def started(self, stage: str, elapsed: float) -> AbstractContextManager:
        """See `AbstractTeller.started`."""
        return nullcontext()

    def detail(self, message: str, elapsed: float) -> None:
        """Says nothing."""

    def finished(self, stage: str, seconds: float, elapsed: float) -> None:
        """Says nothing."""

    def warned(self, message: str, elapsed: float) -> None:
        """Says nothing."""


class Live(AbstractTeller):
    """A spinner for the stage at work and a line with its time when it is done, on stderr."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._detail = ""

    def started(self, stage: str, elapsed: float) -> AbstractContextManager:
        """See `AbstractTeller.started`."""
        self._detail = ""
        return self._console.status(stage)

    def detail(self, message: str, elapsed: float) -> None:
        """See `AbstractTeller.detail`."""
        self._detail = message

    def finished(self, stage: str, seconds: float, elapsed: float) -> None:
        """See `AbstractTeller.finished`."""
        line = f"{stage:<10} {seconds:7.1f} s  {self._detail}".rstrip()
        self._console.print(line, markup=False, soft_wrap=True)

    def warned(self, message: str, elapsed: float) -> None:
        """See `AbstractTeller.warned`."""
        line = f"warning: {message}"
        self._console.print(line, style="yellow", markup=False, soft_wrap=True)


class JsonLines(AbstractTeller):
    """One JSON object a line on stderr: events `start`, `detail`, `done`, `warning`."""

    def started(self, stage: str, elapsed: float) -> AbstractContextManager:
        """See `AbstractTeller.started`."""
        self._event("start", elapsed, stage=stage)
        return nullcontext()

    def detail(self, message: str, elapsed: float) -> None:
        """See `AbstractTeller.detail`."""
        self._event("detail", elapsed, message=message)

    def finished(self, stage: str, seconds: float, elapsed: float) -> None:
        """See `AbstractTeller.finished`."""
        self._event("done", elapsed, stage=stage, seconds=round(seconds, 3))

    def warned(self, message: str, elapsed: float) -> None:
        """See `AbstractTeller.warned`."""
        self._event("warning", elapsed, message=message)

    def _event(self, event: str, elapsed: float, **values: object) -> None:
        line = {"event": event, "elapsed_s": round(elapsed, 3)} | values
        sys.stderr.write(json.dumps(line) + "\n")
        sys.stderr.flush()


class Progress:
    """Times every stage of a run, collects its warnings, and passes the news on.

    Attributes:
        seconds: wall time of each finished stage.
        warnings: what the user should know, in the order it was found.
    """

    def __init__(self, teller: AbstractTeller) -> None:
        self.seconds: dict[str, float] = {}
        self.warnings: list[str] = []
        self._teller = teller
        self._started = time.perf_counter()

    def total(self) -> float:
        """Seconds since the object was made."""
        return time.perf_counter() - self._started

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Wraps the work of one stage."""
        start = time.perf_counter()
        with self._teller.started(name, self.total()):
            yield
        seconds = time.perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        self._teller.finished(name, seconds, self.total())

    def detail(self, message: str) -> None:
        """News of the stage at work."""
        self._teller.detail(message, self.total())

    def warn(self, message: str) -> None:
        """Something the user should know that does not stop the run; told once."""
        if message not in self.warnings:
            self.warnings.append(message)
            self._teller.warned(message, self.total())
