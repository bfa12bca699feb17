"""Runs every mesh file below a folder through everything, each in a process of its own: `make corpus DIR=folder`.

One row for each file and operation is appended to a CSV file as soon as it is known, so that a run that was stopped
goes on; `--report` prints what the table says. An operation is ``done``, ``refused`` (with the reason), ``failed`` (an
exception that is none of ours), ``crashed`` (a signal), or ``stopped`` at the limit of time or memory. What is done
must be plausible, too: see the checks.
"""

import argparse
import csv
import json
import multiprocessing
import os
import resource
import signal
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

SUFFIXES = [".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".dae", ".3mf", ".3ds", ".wrl", ".x3d", ".ctm"]
RESULTS = ["done", "refused", "failed", "crashed", "stopped"]
COLUMNS = ["file", "vertices", "faces", "operation", "result", "seconds", "size", "statuses", "implausible", "message"]
FAR = 3.0
"""Edges of a vertex, the longest, that smoothing may move it."""
NOISES = 5.0
"""Standard deviations of the noise, as reported, that smoothing may move a vertex."""
ROUNDING = 1e-12
"""Part of the largest coordinate by which a vertex may move anyway."""
VOLUME = 0.2
"""Part of the volume that smoothing may change."""
PATIENCE, MEMORY = 180, 4 << 30
"""Seconds for one operation, and bytes of writable memory."""
FEWEST, FEWEST_EDGES, OUTLIER = 500, 30, 20.0
"""Vertices, or edges of filled holes, from which on times are compared, and how many times the median is an outlier."""


def load(path, state):
    from bezier_filters.meshlab.mesh_files import load_mesh

    state["ms"] = load_mesh(path)
    mesh = state["ms"].current_mesh()
    state["v"], state["f"] = np.array(mesh.vertex_matrix()), np.array(mesh.face_matrix())


def new_meshset(state):
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(state["v"], state["f"]) if len(state["f"]) else pymeshlab.Mesh(state["v"]))
    return ms


def info(path, state):
    import bezier_filters as bf
    from bezier_filters.meshlab.topology import topology_of

    mesh = bf.triangle_mesh(state["v"], state["f"])
    bf.diagnose(mesh, bf.inspect_mesh(mesh))
    topology_of(mesh.vertices, mesh.faces)


def estimate(quantity):
    def run(path, state):
        import bezier_filters as bf

        report = getattr(bf, f"compute_{quantity}_by_bezier_patch_per_vertex")(state["ms"])
        state["statuses"] = report["status"]
        mesh = state["ms"].current_mesh()
        for name in report["attributes"]:
            if not np.isfinite(mesh.vertex_custom_scalar_attribute_array(name)).all():
                yield f"{name} is not finite"
        if quantity == "curvature":
            yield from check_curvature(state, mesh)

    return run


def check_curvature(state, mesh):
    """No curvature beyond what the faces at a vertex hold, which turn by pi over the smallest of their heights."""
    faces, vertices = state["f"], state["v"]
    if not len(faces):
        return
    edges = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    twice = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    fair = twice > 1e-6 * longest**2
    heights = np.full(len(vertices), np.inf)
    np.minimum.at(heights, faces[fair].ravel(), np.repeat(twice[fair] / longest[fair], 3))
    heights[~np.isfinite(heights)] = 0.0
    for name in ("bz_k_min", "bz_k_max", "bz_mean_curvature_std"):
        excess = np.abs(mesh.vertex_custom_scalar_attribute_array(name)) * heights > 1.001 * np.pi
        if excess.any():
            yield f"{name} is beyond what faces hold at {excess.sum()} vertices"


def smoothing(method):
    def run(path, state):
        import bezier_filters as bf

        ms, vertices, faces = new_meshset(state), state["v"], state["f"]
        report = bf.apply_coord_bezier_patch_smoothing(ms, method=method)
        smoothed = ms.current_mesh().vertex_matrix()
        moved, rounding = np.linalg.norm(smoothed - vertices, axis=1), ROUNDING * np.abs(vertices).max()
        longest = np.zeros(len(vertices))
        for k in range(3):
            length = np.linalg.norm(vertices[faces[:, k]] - vertices[faces[:, k - 1]], axis=1)
            for end in (faces[:, k], faces[:, k - 1]):
                np.maximum.at(longest, end, length)
        if not np.isfinite(moved).all():
            yield "coordinates are not finite"
            return
        if (moved > FAR * longest + rounding).any():
            yield f"{(moved > FAR * longest + rounding).sum()} vertices moved more than {FAR:g} edges"
        if method != "auto":
            return
        if report["volume_ratio"] and abs(report["volume_ratio"] - 1.0) > VOLUME:
            yield f"volume {report['volume_ratio']:.3g} times as before"
        noise = report["noise_before"] or 0.0
        if (far := moved > NOISES * noise + rounding).any():
            times = moved.max() / noise if noise else np.inf
            yield f"{far.sum()} vertices moved more than {NOISES:g} times the noise, the farthest {times:.3g} times"
        yield from check_cuts(vertices, smoothed, faces)

    return run


def check_cuts(before, after, faces):
    """No face cuts another that did not before."""
    from bezier_filters.meshes.self_intersections import cut_faces

    cut, cuts = (cut_faces(np.ascontiguousarray(points), faces, len(faces)) for points in (before, after))
    if (new := cuts & ~cut).any():
        yield f"{new.sum()} faces cut others that did not ({cut.sum()} before, {cuts.sum()} after)"


def creases(path, state):
    import bezier_filters as bf

    report = bf.compute_selection_by_bezier_crease_per_edge(new_meshset(state))
    if not all(np.isfinite(line["strength"]) for line in report["lines"]):
        yield "a strength is not finite"


def filling(method, repair):
    def run(path, state):
        import bezier_filters as bf

        ms, vertices, faces = new_meshset(state), state["v"], state["f"]
        report = bf.meshing_close_holes_by_bezier_patch(ms, method=method, repair=repair)
        holes = report["holes"]
        state["size"] = sum(hole["edge_count"] for hole in holes if hole["filled"])
        state["statuses"] = Counter(
            hole["method"] or " ".join(hole["reason"].split(":")[0].split()[-3:]) for hole in holes
        )
        mesh = ms.current_mesh()
        if not repair and not (
            np.array_equal(mesh.vertex_matrix()[: len(vertices)], vertices)
            and np.array_equal(mesh.face_matrix()[: len(faces)], faces)
        ):
            yield "old vertices or faces changed"
        if method == "auto" and (cuts := sum(hole["filled"] * hole["self_intersections"] for hole in holes)):
            yield f"{cuts} new faces cut others"
        if method == "auto" and report["new_faces"] and (cuts := cutting_faces(ms)[-report["new_faces"] :].sum()):
            yield f"{cuts} of {report['new_faces']} new faces intersect others, says pymeshlab"
        many = [hole for hole in holes if hole["new_vertices"] > 10 * hole["edge_count"] ** 2]
        if many:
            yield f"{many[0]['new_vertices']} new vertices in a hole of {many[0]['edge_count']} edges"
        closed = report["topology_before"]["boundary_edges"] - report["topology_after"]["boundary_edges"]
        if closed != sum(hole["edge_count"] for hole in holes if hole["filled"]):
            yield f"{closed} border edges closed, but rims have others"

    return run


def cutting_faces(ms):
    """Which faces pymeshlab selects as intersecting others, which is not how fills are looked at."""
    ms.compute_selection_by_self_intersections_per_face()
    return ms.current_mesh().face_selection_array()


def render(path, state):
    from bezier_filters import Panel, render_panels

    target = state["folder"] / "picture.png"
    values = np.array(state["ms"].current_mesh().vertex_custom_scalar_attribute_array("bz_mean_curvature"))
    render_panels(target, [Panel(state["v"], state["f"], values)], size=(200, 200))
    if target.stat().st_size < 500:
        yield "the picture is empty"


def round_trip(path, state):
    """Save with all columns, read back, estimate again: the same statuses."""
    import bezier_filters as bf
    from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh

    before = state["ms"].current_mesh()
    written = np.array(before.vertex_custom_scalar_attribute_array("bz_fit_grade"))
    target = state["folder"] / "saved.ply"
    save_mesh(state["ms"], target)
    if not np.array_equal(bf.read_fields(target)["bz_fit_grade"], written):
        yield "statuses changed in the file"
    ms = load_mesh(target)
    if not np.array_equal(ms.current_mesh().vertex_matrix(), before.vertex_matrix()):
        yield "coordinates changed in the file"
    report = bf.compute_torsion_by_bezier_patch_per_vertex(ms)
    again = ms.current_mesh().vertex_custom_scalar_attribute_array("bz_fit_grade")
    if len(state["f"]) and not np.array_equal(again, written):
        yield f"statuses are others after reading: {report['status']}"


OPERATIONS = {
    "load": load,
    "info": info,
    "normals": estimate("normal"),
    "curvature": estimate("curvature"),
    "torsion": estimate("torsion"),
    "save and read": round_trip,
    "smooth": smoothing("auto"),
    "smooth, paper": smoothing("paper"),
    "creases": creases,
    "fill": filling("auto", False),
    "fill, paper": filling("paper", False),
    "fill, repair": filling("auto", True),
    "render": render,
}
OF_FACES = {"smooth", "smooth, paper", "creases", "fill", "fill, paper", "fill, repair"}


def run_child(path, names, report, folder):
    """In a process of its own: run operations on a file, and write a line before and after each."""
    from bezier_filters.errors import InvalidMeshError, InvalidParameterError
    from bezier_filters.meshlab.meshset import BezierFilterError

    used = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (used + MEMORY, used + MEMORY))
    state = {"folder": folder}
    for name in names:
        if name in OF_FACES and not len(state.get("f", ())):
            continue
        state["statuses"], state["size"] = {}, None
        report.write(json.dumps({"operation": name}) + "\n")
        row = {"operation": name, "result": "done", "message": "", "implausible": ""}
        start = time.perf_counter()
        try:
            row["implausible"] = "; ".join(OPERATIONS[name](path, state) or ())
        except (BezierFilterError, InvalidMeshError, InvalidParameterError) as error:
            row |= {"result": "refused", "message": str(error)}
        except MemoryError as error:
            row |= {"result": "stopped", "message": f"memory: {error}"}
        except Exception as error:
            row |= {"result": "failed", "message": f"{type(error).__name__}: {error}"}
        row["seconds"] = round(time.perf_counter() - start, 4)
        row["statuses"] = json.dumps(state["statuses"])
        row["size"] = len(state.get("v", ())) if state["size"] is None else state["size"]
        row["vertices"], row["faces"] = len(state.get("v", ())), len(state.get("f", ()))
        report.write(json.dumps(row) + "\n")
        if name == "load" and row["result"] != "done":
            return


def rows_of(path):
    """Run all operations on a file; go on after the one that ended its process."""
    names, rows, size = list(OPERATIONS), [], (0, 0)
    with TemporaryDirectory() as folder:
        while names:
            lines = Path(folder) / "lines"
            lines.write_text("", encoding="utf-8")  # not what the process before said, nor its time
            child = os.fork()
            if child == 0:
                try:
                    null = os.open(os.devnull, os.O_WRONLY)
                    os.dup2(null, 1)
                    os.dup2(null, 2)
                    with lines.open("w", buffering=1) as report:
                        run_child(path, names, report, Path(folder))
                finally:
                    os._exit(0)
            status = wait(child, lines)
            said = [json.loads(line) for line in lines.read_text().splitlines() if line.endswith("}")]
            rows += [row for row in said if "result" in row and not (row["operation"] == "load" and rows)]
            size = next(((row["vertices"], row["faces"]) for row in said if row.get("vertices")), size)
            if not said or "result" in said[-1]:
                break
            name = said[-1]["operation"]
            how = {"result": "stopped", "message": f"{PATIENCE} s"} if status is None else {"result": "crashed"}
            if status:
                how["message"] = signal.Signals(status).name if status in set(signal.Signals) else f"signal {status}"
            rows.append({"operation": name, "vertices": size[0], "faces": size[1], **how})
            if name == "load":
                break
            names = ["load", *names[names.index(name) + 1 :]]
            if name in ("normals", "curvature", "torsion"):
                names.remove("save and read")
    return path, rows


def wait(child, lines):
    """The signal that ended a process, 0, or None if it was ended because it took too long over one operation."""
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) * -1
        if lines.exists() and time.time() - lines.stat().st_mtime > PATIENCE:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(0.02)


def run(folder, table, workers, largest):
    """Run all files below a folder that are not in the table yet."""
    known = set()
    if table.exists():
        with table.open(newline="", encoding="utf-8") as file:
            known = {row["file"] for row in csv.DictReader(file)}
    else:
        table.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    paths = [path for path in paths if f"{folder.name}/{path.relative_to(folder)}" not in known]
    warm_up()
    paths = [path for path in paths if path.stat().st_size <= largest]
    context = multiprocessing.get_context("fork")
    with context.Pool(workers) as pool, table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        for number, (path, rows) in enumerate(pool.imap_unordered(rows_of, paths)):
            for row in rows:
                row["message"] = " ".join(str(row.get("message", "")).replace(f"{path.parent}/", "").split())[:300]
                writer.writerow({"file": f"{folder.name}/{path.relative_to(folder)}", **row})
            file.flush()
            words = Counter(row["result"] for row in rows)
            print(f"{number + 1}/{len(paths)} {path.name}: {dict(words)}", flush=True)


def warm_up():
    """Load and compile in this process, whose copies the others are."""
    import bezier_filters.meshlab.mesh_files
    import bezier_filters.pictures.render  # noqa: F401
    from bezier_filters.surfaces import torus

    ring = torus(resolution=12, jitter=0.2)
    faces = ring.faces[ring.vertices[ring.faces].mean(axis=1)[:, 0] < 1.2]
    noise = np.random.default_rng(0).normal(scale=0.01, size=ring.vertices.shape)
    state = {"v": ring.vertices + noise, "f": faces}
    state["ms"] = new_meshset(state)
    for name in OPERATIONS:
        if name not in ("load", "save and read", "render"):  # pictures leave threads behind
            list(OPERATIONS[name](None, state) or ())


def report(table):
    """Print what a table says, in Markdown."""
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    by_operation = defaultdict(list)
    for row in rows:
        by_operation[row["operation"]].append(row)
    print(f"{len({row['file'] for row in rows})} files\n")
    columns = "operation", "files", *RESULTS, "implausible", "median us", "worst"
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    slow = []
    for name in OPERATIONS:
        of_name = by_operation[name]
        if not of_name:
            continue
        count = Counter(row["result"] for row in of_name)
        fewest = FEWEST_EDGES if name.startswith("fill") else FEWEST
        timed = [row for row in of_name if row["result"] == "done" and int(row["size"]) >= fewest]
        each = np.array([float(row["seconds"]) / int(row["size"]) for row in timed])
        median = np.median(each) if len(each) else np.nan
        worst = each.max(initial=0.0) / median
        times = zip(timed, each / median, strict=True)
        slow += [(name, row["file"], ratio) for row, ratio in times if ratio > OUTLIER]
        bad = sum(bool(row["implausible"]) for row in of_name)
        numbers = [
            len(of_name),
            *(count[result] for result in RESULTS),
            bad,
            f"{1e6 * median:.1f}",
            f"{worst:.0f} times",
        ]
        print(f"| {name} | {' | '.join(map(str, numbers))} |")
    for row in rows:
        if row["result"] != "done" or row["implausible"]:
            print("-", row["file"], row["operation"], row["result"], row["implausible"] or row["message"][:160])
    for name, file, ratio in slow:
        print(f"- {file} {name}: {ratio:.0f} times the median")


def summarise(table, target):
    """One row for each file: its size, the seconds of all operations, and what was not as it should be."""
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    by_file = defaultdict(list)
    for row in rows:
        by_file[row["file"].partition("/")[2]].append(row)
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["file", "vertices", "faces", "seconds", "findings"])
        for name, of_file in sorted(by_file.items()):
            words = [
                f"{row['operation']} {row['result']}: {row['implausible'] or row['message'][:160]}"
                for row in of_file
                if row["result"] != "done" or row["implausible"]
            ]
            seconds = sum(float(row["seconds"] or 0.0) for row in of_file)
            writer.writerow([name, of_file[0]["vertices"], of_file[0]["faces"], f"{seconds:.2f}", "; ".join(words)])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--table", type=Path, default=Path("out/corpus.csv"))
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--largest", type=int, default=50_000_000, help="bytes of a file; larger ones are left out")
    parser.add_argument("--report", action="store_true", help="only print what the table says")
    parser.add_argument("--summary", type=Path, help="write one row for each file to this CSV file, too")
    arguments = parser.parse_args()
    if not arguments.report:
        if arguments.folder is None or not arguments.folder.is_dir():
            parser.error("give the folder with mesh files")
        arguments.table.parent.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("BEZIER_FILTERS_THREADS", "1")
        run(arguments.folder.resolve(), arguments.table, arguments.workers, arguments.largest)
    report(arguments.table)
    if arguments.summary:
        summarise(arguments.table, arguments.summary)


if __name__ == "__main__":
    sys.exit(main())
