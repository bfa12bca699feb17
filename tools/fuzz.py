"""Damages meshes at random and runs every function and filter on them: `make fuzz`.

Every batch of mutations runs in a process of its own, so that a crash in compiled code, or in pymeshlab, is seen
and counted; the batch goes on after it. What must hold is in tests/helpers/invariants.py, the damage in
tests/helpers/mesh_mutations.py; one mesh of twenty has rows that no mesh has, which must be refused. Failures are
printed with their seed: `python tools/fuzz.py --seed N` repeats one.
"""

import argparse
import collections
import json
import subprocess
import sys
import time
import traceback
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "helpers"), str(ROOT / "benchmarks")]

BATCH = 500
PATIENCE = 120.0
"""Seconds that one mutation may take."""


def run_one(seed: int) -> None:
    from invariants import CHECKS, check_refusal
    from mesh_mutations import mutated, spoil_rows

    if seed % 20 == 7:
        check_refusal(*spoil_rows(seed))
        return
    names = list(CHECKS)
    CHECKS[names[seed % len(names)]](*mutated(seed))


def run_batch(start: int, stop: int, log: Path) -> None:
    """Run seeds start .. stop-1; the log tells which one is under way, and what failed."""
    warnings.simplefilter("error")
    with log.open("a") as file:
        for seed in range(start, stop):
            file.write(json.dumps({"seed": seed}) + "\n")
            file.flush()
            try:
                run_one(seed)
            except Exception:
                last = traceback.format_exc().strip().splitlines()[-3:]
                file.write(json.dumps({"failed": seed, "trace": " | ".join(map(str.strip, last))}) + "\n")


def supervise(start: int, stop: int, log: Path) -> list[str]:
    """Run a batch in a process, again after each crash; return what happened besides failures."""
    events = []
    while start < stop:
        command = [sys.executable, __file__, "--batch", str(start), str(stop), str(log)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None:
            time.sleep(0.2)
            if log.exists() and time.time() - log.stat().st_mtime > PATIENCE:
                process.kill()
        under_way = [json.loads(line)["seed"] for line in log.read_text().splitlines() if '"seed"' in line]
        if process.returncode == 0:
            return events
        kind = "hung or took too long" if process.returncode == -9 else f"crashed with {process.returncode}"
        events.append(f"seed {under_way[-1]}: {kind}")
        start = under_way[-1] + 1
    return events


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100_000, help="number of mutations")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2, help="processes side by side")
    parser.add_argument("--seed", type=int, help="repeat one mutation")
    parser.add_argument("--batch", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.batch:
        run_batch(int(options.batch[0]), int(options.batch[1]), Path(options.batch[2]))
        return
    if options.seed is not None:
        warnings.simplefilter("error")
        run_one(options.seed)
        return
    begin, failures, events = time.perf_counter(), [], []
    with TemporaryDirectory() as folder, ThreadPoolExecutor(options.workers) as pool:
        logs = {}
        for start in range(options.first, options.first + options.count, BATCH):
            log = Path(folder) / f"{start}.log"
            stop = min(start + BATCH, options.first + options.count)
            logs[pool.submit(supervise, start, stop, log)] = log
        for done, (future, log) in enumerate(logs.items(), 1):
            events += future.result()
            failures += [json.loads(line) for line in log.read_text().splitlines() if '"failed"' in line]
            if done % 10 == 0:
                print(f"{done * BATCH:,} mutations, {len(failures)} failures, {len(events)} crashes", flush=True)
    seconds = time.perf_counter() - begin
    kinds = collections.Counter(failure["trace"] for failure in failures)
    for trace, number in kinds.most_common():
        example = next(failure["failed"] for failure in failures if failure["trace"] == trace)
        print(f"{number} times, for example seed {example}: {trace}")
    print(*events, sep="\n")
    print(f"{options.count:,} mutations in {seconds:.0f} s: {len(failures)} failures, {len(events)} crashes")
    sys.exit(bool(failures or events))


if __name__ == "__main__":
    main()
