"""A batch of 200 generated meshes, some of them broken: by one worker and by two, interrupted and resumed.

Every mesh has noise of its own, and its kind, size and scale differ; every tenth file is broken, in five ways. The
command line is run as users run it. The summary must have every good file done and every broken one failed, and
after an interrupt the next run must do just what is left.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab

from bezier_filters import surfaces

SHAPES = (surfaces.torus, surfaces.sphere, surfaces.ellipsoid, surfaces.bumpy_star)
EVERY = 10
"""Of how many files one is broken."""


def generate(folder: Path, count: int, resolution: int) -> int:
    """Write the meshes; the number of good ones."""
    rng = np.random.default_rng(0)
    for number in range(count):
        shape = SHAPES[number % len(SHAPES)](resolution=int(resolution * rng.uniform(0.7, 1.3)), jitter=0.3)
        noise = 0.002 * rng.standard_normal(len(shape.vertices))
        vertices = (shape.vertices + noise[:, None] * shape.normals) * rng.uniform(0.1, 100.0)
        path = folder / f"scan {number:03}.ply"
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(vertices, shape.faces))
        ms.save_current_mesh(str(path))
        if number % EVERY == 0:
            path.write_bytes(broken(path.read_bytes(), number // EVERY))
    return count - -(-count // EVERY)


def broken(data: bytes, number: int) -> bytes:
    """A file that is empty, text, cut in its header or its body, or without vertices."""
    return (
        b"",
        b"no mesh at all\n",
        data[:60],
        data[: len(data) // 2],
        b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n",
    )[number % 5]


def command(folder: Path, name: str, out: str, jobs: int) -> list[str]:
    patterns = [str(folder / "scans" / "*.ply"), "--out", str(folder / out), "--jobs", str(jobs), "--json"]
    return [sys.executable, "-m", "bezier_filters", "batch", name, *patterns]


def run(folder: Path, name: str, out: str, jobs: int) -> dict[str, Any]:
    """Run a batch to its end; its summary."""
    done = subprocess.run(command(folder, name, out, jobs), capture_output=True, text=True, check=False)
    summary: dict[str, Any] = json.loads(done.stdout)
    assert done.returncode == (1 if summary["failed"] else 0)
    print(
        f"  {jobs} worker{'s' * (jobs > 1)}: {summary['done']:4} done {summary['skipped']:4} skipped "
        f"{summary['failed']:4} failed {summary['seconds']:7.1f} s",
        flush=True,
    )
    return summary


def interrupt(folder: Path, name: str, out: str, jobs: int, after: int) -> int:
    """Interrupt a batch, as Ctrl-C does, when it has written so many results; how many there are then."""
    process = subprocess.Popen(
        command(folder, name, out, jobs), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ
    )
    while len(list((folder / out).glob("[!.]*.ply"))) < after and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    status = process.wait()
    left = [path for path in (folder / out).iterdir() if path.name.startswith(".")]
    written = len(list((folder / out).glob("*.ply")))
    print(f"  interrupted: status {status}, {written} results, {len(left)} temporary files left", flush=True)
    assert status != 0
    assert not left
    return written


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="number of meshes")
    parser.add_argument("--resolution", type=int, default=40, help="of the surfaces; 40 gives some 12,000 vertices")
    parser.add_argument("--commands", nargs="+", default=["curvature", "smooth"], help="commands of batch to run")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "scans").mkdir()
        good = generate(folder / "scans", options.count, options.resolution)
        bad = options.count - good
        for name in options.commands:
            print(f"{name}: {options.count} files, {bad} of them broken")
            seconds = []
            for jobs in (1, 2):
                summary = run(folder, name, f"{name} by {jobs}", jobs)
                assert (summary["done"], summary["skipped"], summary["failed"]) == (good, 0, bad)
                seconds.append(summary["seconds"])
            print(f"  two workers are {seconds[0] / seconds[1]:.2f} times as fast as one")
            written = interrupt(folder, name, f"{name} resumed", 2, good // 2)
            summary = run(folder, name, f"{name} resumed", 2)
            assert (summary["done"], summary["skipped"], summary["failed"]) == (good - written, written, bad)
            for path in (folder / f"{name} by 1").iterdir():
                for other in ("by 2", "resumed"):
                    assert path.read_bytes() == (folder / f"{name} {other}" / path.name).read_bytes()
            print("  the results are the same, byte by byte")
            for error in sorted({file["error"].split(": ", 1)[-1] for file in summary["files"] if file["error"]}):
                print(f"    failed: {error}")


if __name__ == "__main__":
    main()
