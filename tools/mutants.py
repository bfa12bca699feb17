"""Changes one place of the package at a time and asks whether the tests notice: `make mutants`.

    python tools/mutants.py --first 150

The sample is a fixed order of all mutants of the modules below, by a hash of a seed and of the line that is changed,
folders in turns; so it can be continued, and changes elsewhere do not move it. A run goes on where the table ends
(tools/results/mutants.csv). Mutations are those of cosmic-ray, one or two for each operator. Tests run in a copy
of the tree, with the same examples each time: first those of the module, without the compiler where these are fast so,
then the wider ones of its folder, files first that noticed most mutants of it so far. Caches of compiled code are
shared, except those of the module and of all that it is compiled into. The note says which test noticed.

A mutant that is no change of what the code promises is marked in the table by hand: outcome "equivalent", and why.
`--again` runs those once more that survived, `--only KEY` one of them, `--show KEY` prints it.
"""

import argparse
import ast
import csv
import difflib
import hashlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "tools" / "results" / "mutants.csv"
COLUMNS = ("key", "module", "line", "mutation", "outcome", "seconds", "note")
SEED = 1
PATIENCE = {"own": 45.0, "wide": 300.0}
"""Seconds after which tests count as failed; they take a third of that at most."""
MEMORY = 8 << 30
"""Bytes of addresses for the tests."""

FOLDERS = ("kernels", "patches", "surface_model", "holes", "meshes")
TOPOLOGY = (
    "hole_detection",
    "hole_filling",
    "loops",
    "planar_fill",
    "fill_methods",
    "refinement",
    "influence_region",
)
"""Modules of `holes` that are looked at: where holes are, and how faces are put into them."""

BINARY = (
    "Add_Sub Sub_Add Mul_Div Div_Mul FloorDiv_Mul Mod_Mul Pow_Mul LShift_RShift RShift_LShift BitOr_BitAnd BitAnd_BitOr"
)
COMPARISONS = "Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Eq_NotEq NotEq_Eq Is_IsNot IsNot_Is"
OPERATORS = (
    *(f"ReplaceBinaryOperator_{name}" for name in BINARY.split()),
    *(f"ReplaceComparisonOperator_{name}" for name in COMPARISONS.split()),
    *(f"ReplaceUnaryOperator_Delete_{name}" for name in ("USub", "Not", "Invert")),
    *("AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd"),
    *("ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "NumberReplacer", "ZeroIterationForLoop"),
)
SPEED = re.compile(
    r"^(CAPACITY_RATIO|MIN_KERNEL_CAPACITY|POWER_CHUNK|CHUNK|UNROLL_FACTOR|SAMPLES|PROBE_COUNT|PLACES|FIRST = 8|POINTS"
    r"|MAX_PAIRWISE_POINTS|MAX_EXACT_LOOP|MAX_RANKED_FACES|MAX_DENSE_VERTICES|MAX_PAIRWISE_FACES|MIN_FACE_LIMIT|VERTICES_PER_CELL|MOST_BITS"
    r"|NO_VERTEX)|threads|chunk"
)
"""Lines that say how fast or at what effort something is computed, not what."""

OWN = {
    "kernels": ["tests/fitting/test_vertex_geometry.py", "tests/estimation/test_paper_mode.py"],
    "patches": ["tests/patches"],
    "surface_model": [],
    "holes": ["tests/holes/test_planar_fill.py"],
    "meshes": [],
}
"""Tests of modules that have no file of their own, by folder."""
WIDE = {
    "kernels": "kernels fitting/test_vertex_geometry.py fitting/test_fallbacks.py fitting/test_vertex_patch.py "
    "estimation/test_estimate.py estimation/test_extremality.py "
    "estimation/test_robust.py estimation/test_paper_mode.py estimation/test_convergence.py",
    "patches": "patches estimation/test_paper_mode.py kernels surface_model/test_model_tree.py "
    "fitting/test_adaptive_fit.py surface_model/test_noise_model.py surface_model/test_ring_analysis.py "
    "estimation/test_extremality.py",
    "surface_model": "surface_model fitting/test_adaptive_fit.py smoothing/test_random_noise.py "
    "smoothing/test_denoise.py",
    "holes": "holes",
    "meshes": "meshes feature_lines holes/test_hole_filling.py meshlab/test_topology.py estimation/test_estimate.py "
    "fitting/test_fallbacks.py",
}
"""Tests that must pass, too, before a mutant counts as one that survived."""
PLAIN = ("lane_algebra", "fit_frames", "adjacency", "frames", "half_edges", "neighbourhoods", "self_intersections")
"""Modules whose own tests are fast without the compiler."""


@dataclass(frozen=True)
class Mutant:
    """One change of a module: `mutate_code` with an operator, at the occurrence of what that can change."""

    key: str
    module: str
    line: int
    operator: str
    occurrence: int

    @property
    def code(self) -> str:
        """The changed module."""
        source = (ROOT / self.module).read_text(encoding="utf-8")
        return mutate_code(source, get_operator(f"core/{self.operator}")(), self.occurrence)

    @property
    def text(self) -> str:
        """The changed line, as it is then."""
        old = (ROOT / self.module).read_text(encoding="utf-8").splitlines()
        lines = [line[1:].strip() for line in difflib.ndiff(old, self.code.splitlines()) if line.startswith("+ ")]
        return " ".join(lines)


# --- the sample -----------------------------------------------------------------------------------


def meaningless(tree: ast.Module, lines: list[str]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Spans of annotations, decorators, messages and lines of pure speed, where nothing is changed."""
    nodes: list[ast.AST | None] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.arg | ast.AnnAssign):
            nodes.append(node.annotation)
        if isinstance(node, ast.FunctionDef):
            nodes += [node.returns, *node.decorator_list]
        if isinstance(node, ast.ClassDef):
            nodes += node.decorator_list
        if isinstance(node, ast.Raise | ast.JoinedStr):
            nodes.append(node)
        if (
            isinstance(node, ast.Subscript)
            and isinstance(node.value, ast.Name)
            and node.value.id in ("Callable", "cast")
        ):
            nodes.append(node)
    spans = [((n.lineno, n.col_offset), (n.end_lineno, n.end_col_offset)) for n in nodes if n is not None]
    return spans + [((k, 0), (k, len(line))) for k, line in enumerate(lines, 1) if SPEED.search(line)]


def digest(text: str | bytes) -> bytes:
    """A number at random that belongs to a text."""
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).digest()


def mutants_of(module: Path) -> Iterator[Mutant]:
    """All mutants of a module."""
    source = module.read_text(encoding="utf-8")
    lines, name = source.splitlines(), module.relative_to(ROOT).as_posix()
    spans = meaningless(ast.parse(source), lines)
    seen: Counter[str] = Counter()
    nodes = list(ast_nodes(get_ast(source)))
    for operator in OPERATORS:
        made = get_operator(f"core/{operator}")()
        places = (place for node in nodes for place in made.mutation_positions(node))
        for occurrence, (start, _) in enumerate(places):
            line = lines[start[0] - 1]
            if any(first <= start < last for first, last in spans):
                continue
            if operator == "AddNot" and re.search("[<>=]=|[<>]", line):
                continue  # comparisons are reversed by operators of their own
            parts = f"{SEED}|{name}|{line.strip()}|{operator}|{start[1]}"
            seen[parts] += 1
            if operator == "NumberReplacer" and (seen[parts] + digest(parts)[0]) % 2:
                continue  # of one more and one less, one is enough
            yield Mutant(digest(f"{parts}|{seen[parts]}").hex()[:12], name, start[0], operator, occurrence)


def sample() -> list[Mutant]:
    """All mutants, in the order in which they are tried."""
    groups = []
    for folder in FOLDERS:
        modules = sorted((ROOT / "bezier_filters" / folder).glob("*.py"))
        chosen = [path for path in modules if folder != "holes" or path.stem in TOPOLOGY]
        groups.append(sorted((m for path in chosen for m in mutants_of(path)), key=lambda mutant: mutant.key))
    return [mutant for row in zip_longest(*groups) for mutant in row if mutant is not None]


# --- the copy of the tree -------------------------------------------------------------------------


def compiled_names(tree: ast.Module) -> set[str]:
    """What compiled code of other files may take from a file: all but its functions and dataclasses in plain Python."""
    names = {name.id for node in tree.body for name in ast.walk(node) if isinstance(name, ast.Name)}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            decorators = " ".join(map(ast.unparse, node.decorator_list))
            plain = "jit" not in decorators if isinstance(node, ast.FunctionDef) else "dataclass" in decorators
            names = names - {node.name} if plain else names | {node.name}
    return names


def names_at_import(tree: ast.Module) -> set[str]:
    """Names that statements of a file use when it is imported, so that they may decide constants."""
    statements = [node for node in tree.body if not isinstance(node, ast.FunctionDef | ast.ClassDef)]
    return {name.id for node in statements for name in ast.walk(node) if isinstance(name, ast.Name)}


def importers(tree: Path) -> dict[Path, set[Path]]:
    """Files whose compiled code may depend on a file: they import such a thing of it, and so on; with itself."""
    folders = "bezier_filters", "tests", "benchmarks", "tools"
    files = [path for folder in folders for path in (tree / folder).rglob("*.py")]
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in files}
    offered = {path: compiled_names(parsed) for path, parsed in trees.items()}
    direct = defaultdict(set)
    for path, parsed in trees.items():
        early = names_at_import(parsed)
        for node in ast.walk(parsed):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                parts = node.module.split(".")
                for target in (
                    tree.joinpath(*parts).with_suffix(".py"),
                    *(tree / f / f"{parts[-1]}.py" for f in ("tests/helpers", "benchmarks", "tools")),
                ):
                    taken = {alias.name for alias in node.names}
                    if taken & offered.get(target, set()) or {a.asname or a.name for a in node.names} & early:
                        direct[target].add(path)
    found = {}
    for path in files:
        found[path], waiting = {path}, [path]
        while waiting:
            new = direct[waiting.pop()] - found[path]
            found[path] |= new
            waiting += new
    return found


def synchronise(tree: Path) -> None:
    """Make the copy have the files of this tree; those that are the same keep their times, and their caches."""
    names = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    wanted = {name for name in names.stdout.splitlines() if (ROOT / name).is_file()}
    for name in wanted:
        target = tree / name
        if not target.exists() or target.read_bytes() != (ROOT / name).read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, target)
    for path in [path for path in tree.rglob("*.py") if path.relative_to(tree).as_posix() not in wanted]:
        path.unlink()


def states(tree: Path, tests: Iterable[str]) -> dict[str, str]:
    """Digests of files with tests, each with all code that they may use."""
    paths = sorted(path for folder in ("bezier_filters", "tests") for path in (tree / folder).rglob("*.py"))
    shared = b"".join(path.read_bytes() for path in paths if not path.name.startswith("test_"))
    return {name: digest(digest(shared) + (tree / name).read_bytes()).hex() for name in tests}


def caches_without(files: set[Path], warm: Path, target: Path) -> None:
    """Link the caches of compiled code to another folder, except those of some files."""
    stale = {(path.parent.name, path.stem) for path in files}
    shutil.rmtree(target, ignore_errors=True)
    for path in warm.rglob("*.nb?"):
        if (path.parent.name.rpartition("_")[0], path.name.split(".")[0]) not in stale:
            place = target / path.relative_to(warm)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.link(path, place)


def passes(tree: Path, caches: Path, tests: list[str], patience: float, compiled: bool = True) -> bool | None:
    """Whether tests pass in the copy; None if they take too long."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(caches), "NUMBA_DISABLE_JIT": "0" if compiled else "1"}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    options = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-profile=mutants"]
    command = [sys.executable, "-m", "pytest", *options, *tests]
    with (caches.parent / "log").open("wb") as log:
        process = subprocess.Popen(
            command,
            cwd=tree,
            env=environment,
            stdout=log,
            stderr=log,
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
        )
        try:
            if process.wait(patience) in (4, 5):  # no such tests
                raise RuntimeError((caches.parent / "log").read_text(encoding="utf-8"))
            return process.returncode == 0
        except subprocess.TimeoutExpired:
            return None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def test_files(path: Path) -> list[Path]:
    """The files with tests in a folder, or this one."""
    return [path] if path.is_file() else sorted(path.glob("test_*.py"))


def own_tests(module: str) -> list[str]:
    """The module's own tests: those of its name, or those that say most of its folder, and its examples."""
    folder, stem = Path(module).parent.name, Path(module).stem
    own = f"tests/{folder}/test_{stem}.py"
    return [module, *([own] if (ROOT / own).exists() else OWN[folder])]


def wide_tests(module: str, known: Iterable[dict[str, str]] = ()) -> list[str]:
    """All tests that may notice a change of the module."""
    folder = Path(module).parent.name
    files = [file for part in WIDE[folder].split() for file in test_files(ROOT / "tests" / part)]
    wide = [row for row in known if row["outcome"] == "killed by wide tests" and f"/{folder}/" in row["module"]]
    noticed = Counter(row["note"].partition("::")[0] for row in wide)
    names = dict.fromkeys(file.relative_to(ROOT).as_posix() for file in files)
    return sorted(names, key=lambda name: -noticed[name])


def failed_test(log: Path) -> str:
    """Name of the test that failed, without its parameters."""
    found = re.search(r"^(?:FAILED|ERROR) ([^\s\[]+)", log.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
    return found[1] if found else ""


def outcome(mutant: Mutant, work: Path, dependent: dict[Path, set[Path]], wide: list[str]) -> tuple[str, str]:
    """Try one mutant: what came of it, and the test that noticed."""
    tree, warm, caches = work / "tree", work / "warm", work / "caches"
    path = tree / mutant.module
    source, status = path.read_text(encoding="utf-8"), path.stat()
    caches_without(dependent[path], warm, caches)
    path.write_text(mutant.code, encoding="utf-8")
    try:
        compiled = path.stem not in PLAIN
        for stage, tests in (("own", own_tests(mutant.module)), ("wide", wide)):
            passed = passes(tree, caches, tests, PATIENCE[stage], compiled or stage == "wide")
            if not passed:
                return ("timeout", "") if passed is None else (f"killed by {stage} tests", failed_test(work / "log"))
        return "survived", ""
    finally:
        path.write_text(source, encoding="utf-8")
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def pass_unchanged(work: Path, modules: set[str]) -> None:
    """Run all tests without a mutation, as far as they have not passed yet as they are now; this fills the caches."""
    tree, table = work / "tree", work / "passed.json"
    (work / "warm").mkdir(exist_ok=True)
    passed = json.loads(table.read_text()) if table.exists() else {}
    for compiled in (True, False):
        chosen = [m for m in modules if compiled or Path(m).stem in PLAIN]
        tests = {test for m in chosen for test in own_tests(m) + wide_tests(m) * compiled}
        files = {path.relative_to(tree).as_posix() for test in tests for path in test_files(tree / test)}
        now = {f"{name} {compiled}": state for name, state in states(tree, files).items()}
        new = [key.split()[0] for key, state in now.items() if passed.get(key) != state]
        if new and not passes(tree, work / "warm", sorted(new), 3600.0, compiled):
            sys.exit(f"the tests fail without a mutation: {work / 'log'}")
        passed |= now
        table.write_text(json.dumps(passed, indent=0))


# --- the table ------------------------------------------------------------------------------------


def rows() -> dict[str, dict[str, str]]:
    """What is known, by key."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline="", encoding="utf-8") as file:
        return {row["key"]: row for row in csv.DictReader(file)}


def save(known: dict[str, dict[str, str]]) -> None:
    """Write the table."""
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(known.values())


def report(known: dict[str, dict[str, str]]) -> None:
    """Print counts by folder; a mutant that takes too long is noticed, an equivalent one is none."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for row in known.values():
        for group in (row["module"].split("/")[1], "all"):
            counts[group][row["outcome"].split(" by ")[0]] += 1
    print(f"{'folder':10}{'mutants':>9}{'killed':>9}{'timeout':>9}{'survived':>10}{'equivalent':>12}{'killed, %':>11}")
    for group in (*FOLDERS, "all"):
        found = counts[group]
        noticed, real = found["killed"] + found["timeout"], found.total() - found["equivalent"]
        cells = f"{found['killed']:8} {found['timeout']:8} {found['survived']:9} {found['equivalent']:11}"
        print(f"{group:10} {found.total():8} {cells} {100.0 * noticed / max(real, 1):10.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, help="length of the sample that is tried, as far as unknown")
    parser.add_argument("--again", action="store_true", help="try those again that survived")
    parser.add_argument("--only", nargs="+", default=[], metavar="KEY", help="try these")
    parser.add_argument("--show", metavar="KEY", help="print a mutant")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "mutants", help="folder for the copy and caches")
    options = parser.parse_args()
    order, known = sample(), rows()
    if options.show:
        (mutant,) = (m for m in order if m.key == options.show)
        old = (ROOT / mutant.module).read_text(encoding="utf-8").splitlines()
        print(
            *difflib.unified_diff(old, mutant.code.splitlines(), mutant.module, mutant.operator, lineterm=""), sep="\n"
        )
        return
    todo = [m for m in order[: options.first] if m.key not in known]
    todo += [m for m in order if m.key in options.only]
    todo += [m for m in order if options.again and m.key in known and known[m.key]["outcome"] == "survived"]
    if todo:
        work: Path = options.work.resolve()
        synchronise(work / "tree")
        dependent = importers(work / "tree")
        pass_unchanged(work, {m.module for m in order})
    for number, mutant in enumerate(todo, 1):
        start, text = time.perf_counter(), mutant.text
        found, note = outcome(mutant, work, dependent, wide_tests(mutant.module, rows().values()))
        seconds = f"{time.perf_counter() - start:.0f}"
        known = rows()
        values = (mutant.key, mutant.module, str(mutant.line), text, found, seconds, note)
        known[mutant.key] = dict(zip(COLUMNS, values, strict=True))
        save(known)
        print(
            f"{number}/{len(todo)} {mutant.key} {mutant.module}:{mutant.line} {text}: {found}, {seconds} s", flush=True
        )
    print(f"{len(order)} mutants in all")
    report(known)


if __name__ == "__main__":
    main()
