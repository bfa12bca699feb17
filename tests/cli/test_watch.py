import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bezier_filters.files.field_files import read_fields

pytestmark = pytest.mark.slow

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
WATCH = [sys.executable, "-u", "-m", "bezier_filters", "watch"]


@pytest.fixture
def watching(tmp_path):
    """Starts the command, and ends it at last; what it says goes to a file."""
    processes = []

    def start(*arguments):
        log = tmp_path / "log.txt"
        with log.open("w", encoding="utf-8") as stream:
            processes.append(
                subprocess.Popen([*WATCH, *map(str, arguments)], stdout=stream, stderr=stream, cwd=tmp_path)
            )
        return processes[-1], log

    yield start
    for process in processes:
        process.kill()
        process.wait()


def wait_for(log, text, count, seconds=60):
    end = time.monotonic() + seconds
    while log.read_text(encoding="utf-8").count(text) < count:
        assert time.monotonic() < end, log.read_text(encoding="utf-8")
        time.sleep(0.05)


def test_a_mesh_is_computed_again_whenever_it_is_saved(tmp_path, watching):
    source, target = tmp_path / "part.ply", tmp_path / "shown.ply"
    shutil.copy(SAMPLES / "sphere.ply", source)
    process, log = watching(source, target, "--run", "curvature --quality gaussian --rings 2")
    wait_for(log, "done: reload", 1)
    first = read_fields(target)["bz_k_max"]
    source.write_bytes(b"ply\n")  # as if another program were not done
    wait_for(log, "could not be run", 1)
    shutil.copy(SAMPLES / "bumpy_star.ply", source)
    wait_for(log, "done: reload", 2)
    assert abs(read_fields(target)["bz_k_max"] - first).max() > 0.1
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20) == 130
    assert "interrupted" in log.read_text(encoding="utf-8")


def test_its_own_result_in_place_starts_nothing(tmp_path, watching):
    source = tmp_path / "part.ply"
    shutil.copy(SAMPLES / "sphere.ply", source)
    _, log = watching(source, "--overwrite", "--run", "curvature --rings 2")
    wait_for(log, "done: reload", 1)
    assert "bz_k_max" in read_fields(source)
    time.sleep(1.5)
    assert log.read_text(encoding="utf-8").count("done: reload") == 1


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["part.ply"], "is the input; give --overwrite"),
        (["none.ply", "shown.ply"], "there is no file"),
        (["part.ply", "shown.ply", "--run", "paint"], "got 'paint', expected one of"),
        (["part.ply", "shown.ply", "--run", "curvature --sharpness 2"], "No such option"),
    ],
)
def test_what_cannot_be_watched_is_refused(tmp_path, arguments, reason):
    shutil.copy(SAMPLES / "sphere.ply", tmp_path / "part.ply")
    result = subprocess.run([*WATCH, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 2
    assert reason in result.stderr
