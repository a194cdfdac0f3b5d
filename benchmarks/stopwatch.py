"""Wall and CPU seconds of stages, and the peak memory, of the process that runs."""

import functools
import inspect
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# ru_maxrss is in KiB on Linux and in bytes on macOS.
BYTES_PER_RSS = 1 if sys.platform == "darwin" else 1024


class Stopwatch:
    """Seconds of stages, summed over calls.

    Attributes:
        seconds: wall and CPU seconds of each stage; CPU seconds are of all threads.
        counts: what `watch` was asked to count.
    """

    def __init__(self):
        self.seconds: dict[str, list[float]] = {}
        self.counts: dict[str, int] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time inside a `with` block to a stage."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        spent = self.seconds.setdefault(name, [0.0, 0.0])
        spent[0] += time.perf_counter() - wall
        spent[1] += time.process_time() - cpu

    def watch(
        self,
        owner: Any,
        function: str,
        stage: str,
        *,
        count: Callable[[Any], int] | None = None,
        **given: Any,
    ) -> None:
        """Time every later call of a function that a library calls itself.

        Args:
            owner: the module or class that holds it.
            function: its name there.
            stage: where the seconds go.
            count: reads a number from what the function returns, to be summed in `counts`.
            **given: arguments to replace.
        """
        original = getattr(owner, function)

        @functools.wraps(original)
        def timed(*args: Any, **named: Any) -> Any:
            with self.stage(stage):
                result = original(*args, **{**named, **given})
            if count is not None:
                self.counts[stage] = self.counts.get(stage, 0) + count(result)
            return result

        # A class method is bound to its class already.
        bound = inspect.isclass(owner) and inspect.ismethod(original)
        setattr(owner, function, staticmethod(timed) if bound else timed)

    def take(self, *stages: str) -> list[float]:
        """Wall and CPU seconds of some stages together, which start again from zero."""
        spent = [self.seconds.pop(stage) for stage in stages if stage in self.seconds]
        return [sum(wall for wall, _ in spent), sum(cpu for _, cpu in spent)]

    def clear(self) -> None:
        """Forget everything measured so far, such as a warm-up."""
        self.seconds.clear()
        self.counts.clear()

    def rows(self) -> dict[str, dict[str, float]]:
        """The stages, for JSON."""
        return {
            name: {"wall_s": round(wall, 3), "cpu_s": round(cpu, 3)}
            for name, (wall, cpu) in self.seconds.items()
        }


def peak_memory_gb() -> float:
    """Largest resident memory of this process until now [GB]."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * BYTES_PER_RSS / 1e9, 3)
