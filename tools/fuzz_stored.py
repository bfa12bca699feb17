"""Damages what is kept between runs and runs again on it: part of `make fuzz`.

Three kinds in turn. Entries of the cache of compiled kernels, in a folder of its own (NUMBA_CACHE_DIR), are lost,
emptied, cut short, changed in one bit or exchanged: estimates, smoothing and fills must be the same to the last bit,
nothing may be said but which kernels are compiled, and the next run must find all entries. One bit is changed in the
store of a run in tiles, which must end with the result of a whole one or name the file. One bit is changed in the
input of a batch, under its old time, or in the records of the batch: the results must be those of the files as they
are, or the table must say why not. `python tools/fuzz_stored.py --seed N` repeats one.
"""

import argparse
import collections
import contextlib
import io
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "helpers"), str(ROOT / "benchmarks")]

PATIENCE = 300
"""Seconds for one run, which may have to compile every kernel."""
WORK = """
import hashlib
import numpy as np
from bezier_filters import estimate_vertex_geometry, fill_holes, smooth
from bezier_filters.surfaces import torus
ring = torus(resolution=12, jitter=0.2)
vertices = ring.vertices + np.random.default_rng(0).normal(scale=0.01, size=ring.vertices.shape)
faces = ring.faces[ring.vertices[ring.faces].mean(axis=1)[:, 0] < 1.2]
geometry = estimate_vertex_geometry(vertices, faces)
smoothed, filled = smooth(vertices, faces), fill_holes(vertices, faces)
parts = geometry.mean_curvature, geometry.normals, smoothed.vertices, filled.vertices
print(hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest())
"""


def run_on_cache(cache: Path) -> tuple[str, str]:
    """What a process prints whose compiled kernels are in a folder: a checksum of its results, and its remarks."""
    variables = os.environ | {"NUMBA_CACHE_DIR": str(cache), "BEZIER_FILTERS_THREADS": "1"}
    command = [sys.executable, "-c", WORK]
    done = subprocess.run(command, capture_output=True, text=True, env=variables, timeout=PATIENCE, check=False)
    assert done.returncode == 0, f"exit status {done.returncode}: {done.stderr[-2000:]}"
    return done.stdout, done.stderr


class Fuzz:
    """Undamaged caches and results, made once, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "cache").mkdir()
        self.printed = ""

    def damage_cache(self, rng: np.random.Generator) -> str:
        """Damage entries of a copy of the cache; they are compiled again."""
        from stored_mutations import damage_files

        if not self.printed:
            self.printed, _ = run_on_cache(self.folder / "cache")
        cache = self.folder / "damaged"
        shutil.copytree(self.folder / "cache", cache)
        try:
            done = damage_files(cache, rng)
            printed, said = run_on_cache(cache)
            assert printed == self.printed, f"other results after {done}"
            strange = [line for line in said.splitlines() if not line.startswith("compiling ")]
            assert not strange, f"{done}: {strange}"
            names = [{path.name for path in place.rglob("*.nbc")} for place in (self.folder / "cache", cache)]
            assert names[0] == names[1], f"entries missing after {done}"
            assert run_on_cache(cache) == (self.printed, ""), f"compiled once more after {done}"
        finally:
            shutil.rmtree(cache)
        return "cache compiled again"

    def damage_store(self, rng: np.random.Generator) -> str:
        """Damage the store of a run in tiles that was stopped; the rest is computed, or the file named."""
        from scale_cases import clean, save_arrays
        from stored_mutations import damage_files, flip

        from bezier_filters.errors import CancelledError, FieldFileError
        from bezier_filters.scale import FitOptions, estimate_file

        options = {"scheduler": "synchronous", "workers": 1, "tile_vertices": 256}
        options["options"] = FitOptions(rings=2, alpha=0.8)
        with TemporaryDirectory(dir=self.folder) as name:
            folder = Path(name)
            files, target, stop = save_arrays(folder, *clean()), folder / "out.ply", int(rng.integers(1, 9))
            estimate_file(files, folder / "whole.ply", **options)
            with contextlib.suppress(CancelledError):
                estimate_file(
                    files, target, progress=lambda stage, done, _: not (stage == "fit" and done >= stop), **options
                )
            done = damage_files(Path(f"{target}.tiles"), rng, most=1, damages=(flip,))
            refusal = ""
            try:
                estimate_file(files, target, resume=True, **options)
            except FieldFileError as error:
                refusal = str(error)
            if refusal:
                assert done[0].split()[1] in refusal, f"{done}: {refusal}"
                assert not target.exists(), f"{done}: refused, but written"
                return "store refused"
            assert target.read_bytes() == (folder / "whole.ply").read_bytes(), f"other results after {done}"
        return "store gone on with"

    def damage_batch(self, rng: np.random.Generator) -> str:
        """Damage an input or the records of a batch; all results are those of the files as they are now."""
        from file_mutations import sound_files
        from stored_mutations import damage_files, flip

        meshes = [data for suffix, data in sound_files() if suffix == ".ply"]
        with TemporaryDirectory(dir=self.folder) as name:
            folder = Path(name)
            inputs, out = folder / "inputs", folder / "out"
            inputs.mkdir()
            for k, data in enumerate(meshes):
                (inputs / f"{k}.ply").write_bytes(data)
            first = run_batch(inputs, out)
            assert first == dict.fromkeys(first, "done"), first
            damaged = out / ".bezier-filters-batch" if rng.random() < 0.3 else inputs
            if damaged == inputs:
                done = damage_files(inputs, rng, most=1, damages=(flip,))
            else:
                flip(damaged, rng)
                done = ["flip records"]
            results = run_batch(inputs, out)
            fresh = run_batch(inputs, folder / "fresh")
            for path, result in results.items():
                assert (result == "failed") == (fresh[path] == "failed"), f"{done}: {path} {result}, {fresh[path]}"
                if result != "failed":
                    same = [(place / path).read_bytes() for place in (out, folder / "fresh")]
                    assert same[0] == same[1], f"{done}: {path} is of another input"
            return f"batch of which {sorted(results.values()).count('skipped')} were skipped"


def run_batch(inputs: Path, out: Path) -> dict[str, str]:
    """Run a batch in this process: what became of each file."""
    import json
    from unittest.mock import patch

    from command_line import in_this_process, run

    files = sorted(map(str, inputs.iterdir()))
    with (
        patch("bezier_filters.runtime.worker_processes.run_in_processes", in_this_process),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        done = run("batch", "normals", *files, "--out", out, "--options", "--rings 2 --alpha 0.8 --no-color", "--json")
    assert done.returncode in (0, 1, 3), done.stderr
    report = json.loads(done.stdout)
    assert all(file["error"] for file in report["files"] if file["result"] == "failed")
    return {Path(file["output"]).name: file["result"] for file in report["files"]}


def run_one(seed: int, fuzz: Fuzz) -> str:
    kinds = fuzz.damage_cache, fuzz.damage_store, fuzz.damage_batch
    return kinds[seed % len(kinds)](np.random.default_rng(seed))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300, help="number of damages")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seed", type=int, help="repeat one")
    options = parser.parse_args()
    os.environ.setdefault("BEZIER_FILTERS_THREADS", "1")
    seeds = [options.seed] if options.seed is not None else range(options.first, options.first + options.count)
    begin, ends, failures = time.perf_counter(), collections.Counter(), 0
    with TemporaryDirectory() as folder:
        fuzz = Fuzz(Path(folder))
        for number, seed in enumerate(seeds, 1):
            try:
                ends[run_one(seed, fuzz)] += 1
            except Exception as error:
                failures += 1
                print(f"seed {seed}: {type(error).__name__}: {error}", flush=True)
            if number % 30 == 0:
                print(f"{number} damages: {dict(ends)}, {failures} failures", flush=True)
    seconds = time.perf_counter() - begin
    print(f"{len(seeds)} damages in {seconds:.0f} s: {dict(ends)}, {failures} failures")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
