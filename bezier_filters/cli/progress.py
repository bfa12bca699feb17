"""Progress: a bar on terminals, and lines elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn
from rich.text import Text

from bezier_filters.runtime.parallel import Progress as ProgressCallback

LINE_INTERVAL = 10.0  # seconds before the first line of progress, and between lines


class TimeColumn(ProgressColumn):
    """Remaining time of a stage if known, else elapsed time."""

    def render(self, task: Task) -> Text:
        """Time with a word that says which of the two it is."""
        left = task.time_remaining
        seconds, word = (task.elapsed or 0.0, "so far") if left is None or task.finished else (left, "left")
        return Text(f"{format_time(seconds)} {word}", style="progress.remaining")


def format_time(seconds: float) -> str:
    """A time in minutes and seconds.

    >>> format_time(75.2)
    '1:15'
    """
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


@contextmanager
def progress_bar(console: Console) -> Iterator[Callable[[str], ProgressCallback]]:
    """A transient bar: yields a function that begins a stage, given its name, and returns the stage's callback."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeColumn())
    with Progress(*columns, console=console, transient=True) as bar:

        def begin(name: str) -> ProgressCallback:
            def move(done: int, total: int) -> None:
                if done < total:
                    bar.update(bar.task_ids[0], completed=done, total=total)
                elif bar.tasks[0].total is not None:  # work after the last step has no known length
                    begin(name)

            for task in bar.task_ids:
                bar.remove_task(task)
            bar.add_task(name, total=None)
            bar.refresh()  # libraries may not let the bar move by itself
            return move

        yield begin


def progress_lines(
    show: Callable[[str], None], clock: Callable[[], float] = time.monotonic
) -> Callable[[str], ProgressCallback]:
    """Progress as lines for pipes and files: the function that begins a stage, as that of `progress_bar`.

    A run that ends within `LINE_INTERVAL` has no line.
    """
    shown = clock()

    def begin(name: str) -> ProgressCallback:
        begun = clock()

        def move(done: int, total: int) -> None:
            if 0 < done < total:
                left = (clock() - begun) * (total - done) / done
                _show_line(f"{name}: {done / total:.0%}, {format_time(left)} left")

        return move

    def _show_line(text: str) -> None:
        nonlocal shown
        if clock() - shown >= LINE_INTERVAL:
            shown = clock()
            show(text)

    return begin
