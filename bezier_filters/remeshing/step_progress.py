"""Progress of iterations whose steps take about the same time."""

from dataclasses import dataclass

from bezier_filters.runtime.parallel import Progress, report


@dataclass
class StepProgress:
    """Progress after the fit, in steps of iterations; cancels between steps and within them."""

    callback: Progress | None
    total: int
    done: int = 0

    def advance(self, steps: int = 1) -> None:
        """Report steps."""
        self.done = min(self.done + steps, self.total)
        report(self.callback, self.done, self.total)

    def finish(self) -> None:
        """Report the end."""
        self.advance(self.total)

    def within(self, done: int, total: int) -> bool | None:
        """A callback for parts of the current step."""
        return None if self.callback is None else self.callback(self.done, self.total)
