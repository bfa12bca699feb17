"""Where smoothing does worse than the best of other filters' settings, on surfaces that nothing else here uses.

    python benchmarks/unseen_smoothing.py --sample 40

A cell is a surface, a triangulation and a kind of data, as in unseen.py. Scores: root mean square distance of the
vertices from the surface, in mean edges, and mean angle between the faces and the surface at their centers, degrees.
For both the peer is the filter, with the setting, whose score in that cell is best: it is chosen by the truth, ours is
the default. Vertices and faces less than three edges from a border are left out. `/ input` are the scores over those of
the data, `noise` is the learned one and `moved` the largest distance that a vertex moves, both in mean edges.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from pathlib import Path
from zlib import crc32

import numpy as np
import pymeshlab

import bezier_filters as bf
from smoothing import face_normals
from smoothing_peers import Smoother, settings
from strongest_peer import mean_edge
from unseen import KINDS, VOXELS, all_cells, all_directions, child, mesh_of, print_table, rms, text, write_table
from unseen_meshes import quiet
from unseen_surfaces import SURFACES, Sample

RESULTS = Path(__file__).parent / "results"
SCORES = ("distance", "angle")
NEGLIGIBLE = (1e-3, 0.05)
"""Scores that count as this much in ratios."""
PLACES = 400
"""Vertices, and faces, whose distances and angles are measured."""
MAX_HARM = 1.02
"""Ratio to the score of the data up to which a result is no worse."""
SMOOTHING_KINDS = {**KINDS, "all .6": all_directions(0.6)}


@lru_cache
def peers() -> dict[str, Smoother]:
    return settings()


def smooth_by(name: str, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """By one of the peers; None where a filter refuses the mesh."""
    try:
        with quiet():
            return peers()[name](vertices, faces)
    except (pymeshlab.PyMeshLabException, RuntimeError):
        return None


def results(vertices: np.ndarray, faces: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Names and results of the peers, from another process: some of them end it on bad triangles."""
    for name in peers():
        try:
            found = child().submit(smooth_by, name, vertices, faces).result()
        except BrokenProcessPool:
            child.cache_clear()
            print(f"{name}: the process ended")
            continue
        if found is not None and np.isfinite(found).all():
            yield name, found


class Judge:
    """Scores of smoothed meshes of a cell."""

    def __init__(self, surface: str, mesh: Sample, inner: np.ndarray) -> None:
        self.shape, self.faces, self.edge = SURFACES[surface], mesh.faces, mean_edge(mesh.vertices, mesh.faces)
        random = np.random.default_rng(0)
        self.places, self.face_places = (
            random.permutation(np.flatnonzero(chosen))[:PLACES] for chosen in (inner, inner[mesh.faces].all(axis=1))
        )

    def nearest(self, points: np.ndarray) -> Sample:
        """The nearest points of the surface, with its normals."""
        return self.shape.sample(self.shape.nearest(points), np.zeros((0, 3), np.int32))

    def scores(self, vertices: np.ndarray) -> list[float]:
        """Distance and angle."""
        places, faces = vertices[self.places], self.faces[self.face_places]
        distance = rms(np.linalg.norm(places - self.nearest(places).vertices, axis=1)) / self.edge
        truth = self.nearest(vertices[faces].mean(axis=1)).normals
        cosines = np.einsum("ij,ij->i", face_normals(vertices, faces), truth)
        cosines *= np.sign(np.median(cosines)) or 1.0
        return [distance, float(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).mean())]


def measure(kind: str, surface: str, triangulation: str, seed: int, with_peers: bool) -> dict[str, object]:
    """A row of the table."""
    mesh, inner = mesh_of(surface, triangulation, seed)
    random = np.random.default_rng(crc32(f"{kind} {surface} {triangulation} {seed}".encode()))
    edge = mean_edge(mesh.vertices, mesh.faces)
    vertices = mesh.vertices if kind in VOXELS else SMOOTHING_KINDS[kind](mesh, edge, random)
    judge = Judge(surface, mesh, inner)
    found = bf.smooth(vertices, mesh.faces)
    before, own = judge.scores(vertices), judge.scores(found.vertices)
    row = {"kind": kind, "surface": surface, "mesh": triangulation, "seed": seed, "vertices": len(vertices)}
    row |= dict(zip(SCORES, own, strict=True))
    floor = np.array(NEGLIGIBLE)
    row |= {
        f"{score} / input": float(ratio)
        for score, ratio in zip(SCORES, np.maximum(own, floor) / np.maximum(before, floor), strict=True)
    }
    if with_peers:
        others = {name: judge.scores(other) for name, other in results(vertices, mesh.faces)} | {"input": before}
        for place, score in enumerate(SCORES):
            best = min(others, key=lambda name: others[name][place])
            ratio = np.divide(*np.maximum([own[place], others[best][place]], NEGLIGIBLE[place])).item()
            row |= {f"{score} / peer": ratio, f"{score} peer": best}
    noise = np.nan if found.noise_before is None else found.noise_before / edge
    return row | {"noise": noise, "moved": found.max_displacement / edge}


def print_summary(rows: list[dict[str, object]], by: str, with_peers: bool) -> None:
    """Geometric means of the ratios, and numbers of cells above bounds."""
    heads = [f"{s}{part}" for s in SCORES for part in (" / peer", " > 1", " > 1.5")] if with_peers else []
    heads = [by, "cells", *heads, *(f"{s} / input" for s in SCORES), "worse than input"]
    print(f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name in [*dict.fromkeys(row[by] for row in rows), "all"]:
        chosen = [row for row in rows if name in (row[by], "all")]
        cells = [name, str(len(chosen))]
        for score in SCORES if with_peers else ():
            ratios = np.array([row[f"{score} / peer"] for row in chosen])
            cells += [text(geometric_mean(ratios)), text(int((ratios > 1).sum())), text(int((ratios > 1.5).sum()))]
        inputs = np.array([[row[f"{score} / input"] for score in SCORES] for row in chosen])
        cells += [text(geometric_mean(one)) for one in inputs.T]
        print(f"| {' | '.join([*cells, text(int((inputs > MAX_HARM).any(axis=1).sum()))])} |")


def geometric_mean(values: np.ndarray) -> float:
    return float(np.exp(np.log(values).mean()))


def print_worst(rows: list[dict[str, object]], count: int = 15) -> None:
    """The cells farthest behind the best peer, and those worse than their input."""
    worst = sorted(((row[f"{s} / peer"], s, row) for row in rows for s in SCORES), key=lambda found: -found[0])
    heads = ("ratio", "of", "peer", "kind", "surface", "mesh", "seed")
    print(f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for ratio, score, row in worst[:count]:
        print(f"| {ratio:.3g} | {score} | {row[f'{score} peer']} | {' | '.join(str(row[n]) for n in heads[3:])} |")


def main() -> None:
    kinds = [*SMOOTHING_KINDS, "turned voxels"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds)
    parser.add_argument("--surfaces", nargs="+", choices=SURFACES, default=list(SURFACES))
    parser.add_argument("--seeds", type=int, default=1, help="how many")
    parser.add_argument("--sample", type=int, help="measure so many of the cells; all by default")
    parser.add_argument("--peers", action=argparse.BooleanOptionalAction, default=True, help="compare with others")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/unseen_smoothing.csv")
    arguments = parser.parse_args()
    cells = all_cells(arguments.kinds, arguments.surfaces, arguments.seeds, arguments.sample)
    if arguments.peers:
        print(len(peers()), "settings of other filters")
    rows = print_table(measure(*cell, arguments.peers) for cell in cells)
    for by in ("kind", "mesh", "surface"):
        print_summary(rows, by, arguments.peers)
    if arguments.peers:
        print_worst(rows)
    if arguments.save:
        write_table(rows, RESULTS / "unseen_smoothing.csv")


if __name__ == "__main__":
    main()
