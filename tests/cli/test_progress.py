"""The bar that shows what is being done."""

import re
from io import StringIO

from rich.console import Console
from rich.progress import Progress

from bezier_filters.cli import console
from bezier_filters.cli.progress import TimeColumn, progress_lines


def test_stages_say_what_is_done(monkeypatch):
    screen = StringIO()
    monkeypatch.setattr(console, "err", lambda: Console(file=screen, force_terminal=True, width=100))
    with console.stages(quiet=False) as stage:
        stage("reading")
        move = stage("fitting")
        for done in range(1, 5):
            move(done, 4)
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())
    assert re.search(r"reading .* 0:00 so far", shown)
    assert re.search(r"fitting .* 0:00 so far", shown)
    assert "100%" not in shown  # what comes after the last step takes its time, too


def test_stages_tell_the_time_that_is_left():
    clock = [0.0]
    bar = Progress(get_time=lambda: clock[0])
    task = bar.add_task("fitting", total=100)
    for second in range(1, 5):
        clock[0] = 10.0 * second
        bar.update(task, completed=10 * second)
    assert TimeColumn().render(bar.tasks[0]).plain == "1:00 left"


def test_bars_are_for_terminals_and_short_runs_are_silent(monkeypatch):
    screen = StringIO()
    monkeypatch.setattr(console, "err", lambda: Console(file=screen))
    with console.stages(quiet=False) as stage:
        stage("fitting")(1, 2)
    with console.stages(quiet=True) as stage:
        assert stage("reading") is None
    assert screen.getvalue() == ""


def test_long_runs_print_a_line_every_ten_seconds():
    now, lines = [0.0], []
    move = progress_lines(lines.append, clock=lambda: now[0])("fitting")
    for second in range(41):
        now[0] = float(second)
        move(second, 40)
    assert lines == ["fitting: 25%, 0:30 left", "fitting: 50%, 0:20 left", "fitting: 75%, 0:10 left"]
