"""Damages mesh files at random and runs the real command line on them: part of `make fuzz`.

Each file is given to ``bezier-filters`` in a process of its own, with bounded memory and time. It must end with exit
status 0 or 3 (with a remark) and a whole output with finite numbers, or with exit status 2, one line on stderr and
nothing written, an older output untouched. A reader of pymeshlab that ends its process is counted, and must have been
reported in plain words.

A quarter of the files are built with one damage, or oddly spelt (tests/helpers/misleading_files.py), so that their
contents are known: rows without finite coordinates or numbers, corners that are no vertices, wrong counts, missing
ends. Of these status 0 means that every row is in the output, in its place.
`python tools/fuzz_files.py --seed N` repeats one.
"""

import argparse
import collections
import os
import signal
import sys
import time
import traceback
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "helpers"), str(ROOT / "benchmarks")]

PATIENCE = 120
"""Seconds of processor time for one file."""
FAILED, NEEDS_A_LOOK = 2, 3
"""Exit statuses."""
MEMORY = 4 << 30
"""Bytes of writable memory for one file."""
COMMANDS = (
    ["curvature", "--rings", "2", "--alpha", "0.8"],
    ["normals", "--no-color"],
    ["torsion", "--rings", "2", "--alpha", "0.8"],
    ["smooth"],
    ["fill-holes"],
    ["info"],
)


def run_one(seed: int, folder: Path) -> str:
    """Run a command on one damaged file; what came of it: loaded, refused or crashed."""
    from file_mutations import mutated_file

    if seed % 4 == 2:
        return run_misleading(seed, folder)
    suffix, data = mutated_file(seed)
    source, target, said = folder / f"damaged{suffix}", folder / "out.ply", folder / "said"
    source.write_bytes(data)
    if suffix == ".npz" or seed % 4 == 0:
        return read_as_fields(source)
    old = b"old" if seed % 3 == 0 else None
    target.unlink(missing_ok=True)
    if old is not None:
        target.write_bytes(old)
    command = COMMANDS[seed % len(COMMANDS)]
    arguments = [command[0], str(source), *([] if command[0] == "info" else [str(target)]), *command[1:]]
    status = command_line(arguments, said)
    check(arguments, status, said.read_text(errors="replace"), target, old)
    for extra in (source, target, said):
        extra.unlink(missing_ok=True)
    left = sorted(path.name for path in folder.iterdir())
    assert not left, f"left behind: {left}"
    if status != FAILED:
        return "loaded"
    return "crashed" if "crashed" in check.last else "refused"


def run_misleading(seed: int, folder: Path) -> str:
    """Run a command on one file of which it is known what is in it."""
    import numpy as np
    from misleading_files import NOTICED, REFUSED, WHOLE, misleading_file

    from bezier_filters import load_mesh

    file = misleading_file(seed)
    source, target, said = folder / f"misleading{file.suffix}", folder / "out.ply", folder / "said"
    source.write_bytes(file.data)
    command = ["curvature", "--rings", "2", "--alpha", "0.8"] if seed % 8 == 2 else ["normals", "--no-color"]
    arguments = [command[0], str(source), str(target), *command[1:], *["--skip"] * file.skip]
    status = command_line(arguments, said)
    check(arguments, status, said.read_text(errors="replace"), target, None)
    expected = {WHOLE: (0,), REFUSED: (FAILED,), NOTICED: (FAILED, NEEDS_A_LOOK)}[file.outcome]
    assert status in expected, f"{file.what}, exit status {status}: {check.last[-1000:]}"
    if status == 0:
        ms = load_mesh(target)
        mesh, (least, most) = ms.current_mesh(), file.triangles
        assert least <= mesh.face_number() <= most, f"{file.what}: not {least} to {most} triangles"
        welded = file.suffix == ".stl"
        assert welded or np.array_equal(mesh.vertex_matrix(), file.vertices), f"{file.what}: other vertices"
        assert file.skip == ("were left out" in check.last), f"{file.what}: {check.last}"
    return "crashed" if "crashed" in check.last else f"{file.outcome} as it must be"


def command_line(arguments: list[str], said: Path) -> int:
    """Exit status of the command line in a process of its own, whose messages go to a file."""
    import resource

    from bezier_filters.cli.commands import serve_command_line
    from bezier_filters.runtime.supervision import child_exit

    reading, writing = os.pipe()
    child = os.fork()  # of a process that has loaded everything: faster than another interpreter
    if child:
        os.close(writing)
        with open(reading, "rb") as notes:
            sent = notes.read()
        status, reason = child_exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), sent)
        if reason:
            with said.open("a", encoding="utf-8") as file:
                file.write(f"bezier-filters: {reason}\n")
        return status
    try:
        os.close(reading)
        os.dup2(writing, 0)
        os.close(writing)
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.argv = ["bezier-filters", *arguments]
        serve_command_line()
    finally:
        traceback.print_exc()
        os._exit(99)


def check(arguments: list[str], status: int, said: str, target: Path, old: bytes | None) -> None:
    """Raise AssertionError unless the end was one of the promised ones."""
    import numpy as np

    from bezier_filters import read_fields

    ours = [line for line in said.splitlines() if line.startswith("bezier-filters: ")]
    check.last = said
    assert status in (0, FAILED, NEEDS_A_LOOK), f"exit status {status}: {said[-3000:]}"
    assert status != NEEDS_A_LOOK or "look at " in said, f"no remark: {said[-3000:]}"
    assert "Traceback" not in said, said[-3000:]
    assert "SIGXCPU" not in said, "took too long"
    if status == FAILED:
        assert len(ours) == 1, f"no clear message: {said[-3000:]}"
        assert (target.read_bytes() if target.exists() else None) == old, "wrote something, and failed"
    elif arguments[0] != "info":
        fields = read_fields(target) if arguments[0] not in ("smooth", "fill-holes") else {}
        assert all(np.isfinite(values).all() for values in fields.values()), "wrote numbers that are not finite"
        assert target.read_bytes()[:3] == b"ply"


def read_as_fields(path: Path) -> str:
    """Read it with our own readers, which must not crash."""
    from bezier_filters import FieldFileError, read_fields

    reason = ""
    try:
        read_fields(path)
    except FieldFileError as error:
        reason = str(error)
    path_is_named = str(path) in reason
    path.unlink()
    assert path_is_named or not reason, reason
    return "fields refused" if reason else "fields read"


def load_everything() -> None:
    """Load the libraries and compiled functions that every process inherits."""
    import pymeshlab

    from bezier_filters.meshlab.scripts import FILTERS

    for function in FILTERS:
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=2)
        function(ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="number of files")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seed", type=int, help="repeat one file")
    options = parser.parse_args()
    os.environ.setdefault("BEZIER_FILTERS_THREADS", "1")
    load_everything()
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    seeds = [options.seed] if options.seed is not None else range(options.first, options.first + options.count)
    begin, ends, failures = time.perf_counter(), collections.Counter(), []
    for number, seed in enumerate(seeds, 1):
        with TemporaryDirectory() as folder:
            try:
                ends[run_one(seed, Path(folder))] += 1
            except Exception as error:
                failures.append((seed, f"{type(error).__name__}: {error}"))
                print(f"seed {seed}: {failures[-1][1]}", flush=True)
        if number % 1000 == 0:
            print(f"{number:,} files: {dict(ends)}, {len(failures)} failures", flush=True)
    seconds = time.perf_counter() - begin
    print(f"{len(seeds):,} files in {seconds:.0f} s: {dict(ends)}, {len(failures)} failures")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
