"""What the default fill does at open ends: lids, missing faces, caps and bolt holes.

The table has the fills of each mesh, and the root mean square distance of the new vertices from the surface that should
close it, in edges.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

import bezier_filters as bf
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.half_edges import boundary_loops
from bezier_filters.surfaces.sampling import rectangle

Distance = Callable[[FloatArray], FloatArray]
BOLTS = ((6.0, 6.0, 2.0), (24.0, 6.0, 2.0), (24.0, 14.0, 2.0), (6.0, 14.0, 2.0), (15.0, 10.0, 3.0))


@dataclass(frozen=True)
class OpenMesh:
    """A mesh with openings, and the surface that should close them."""

    name: str
    vertices: FloatArray
    faces: IntArray
    distance: Distance  # of points from the missing surface
    expected: str  # what the default should do


def sheet_with_holes(bolts: Sequence[tuple[float, float, float]] = BOLTS) -> tuple[FloatArray, IntArray]:
    """A flat sheet, 30 by 20 edges, with round holes."""
    points, faces = rectangle((30, 20), holes=bolts)
    return np.column_stack([points, np.zeros(len(points))]), faces


def walls(
    vertices: FloatArray, loops: Sequence[IntArray], shift: FloatArray, layers: int
) -> tuple[FloatArray, IntArray]:
    """Walls below border loops of faces above, in layers."""
    points, faces, first = [], [], 0
    for loop in loops:
        n = len(loop)
        points += [vertices[loop] + shift * k / layers for k in range(layers + 1)]
        i = np.arange(layers * n)
        after = i - i % n + (i + 1) % n
        faces.append(
            first + np.vstack([np.column_stack([after, i, i + n]), np.column_stack([after, i + n, after + n])])
        )
        first += (layers + 1) * n
    return np.vstack(points), np.vstack(faces)


def weld(*parts: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
    """One mesh of parts with common vertices."""
    points = np.vstack([points for points, _ in parts])
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    faces = np.vstack([faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)])
    _, first, place = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    return points[first], place.ravel()[faces].astype(np.int32)


def plate(*, bottom: bool, bolt_walls: bool) -> tuple[FloatArray, IntArray]:
    """A plate of three edges thickness with five bolt holes."""
    top, faces = sheet_with_holes()
    loops = sorted(boundary_loops(top, faces), key=len, reverse=True)
    down = np.array([0.0, 0.0, -3.0])
    parts = [(top, faces), walls(top, loops if bolt_walls else loops[:1], down, 3)]
    return weld(*parts, *([(top + down, faces[:, ::-1])] if bottom else []))


def revolved(radii: FloatArray, heights: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Surface of revolution, open where its first and last radius are not 0."""
    angles = 2.0 * np.pi * np.arange(count) / count
    rings = [
        np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(count, z)])
        for r, z in zip(radii, heights, strict=True)
    ]
    i = np.arange((len(radii) - 1) * count)
    after = i - i % count + (i + 1) % count
    faces = np.vstack([np.column_stack([i, after, i + count]), np.column_stack([after, after + count, i + count])])
    points, faces = weld((np.vstack(rings), faces))
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return points, faces[distinct]


def bent_tube(turn: float = 2.0) -> tuple[FloatArray, IntArray]:
    """A bent tube of growing radius, open at both ends: a vessel."""
    along, around = np.linspace(0.0, turn, 41), 2.0 * np.pi * np.arange(24) / 24
    radius = 1.0 + 0.3 * along[:, np.newaxis] / turn
    reach = 5.0 + radius * np.cos(around)
    points = np.stack(
        [reach * np.cos(along)[:, np.newaxis], reach * np.sin(along)[:, np.newaxis], radius * np.sin(around)], axis=2
    ).reshape(-1, 3)
    i = np.arange(40 * 24)
    after = i - i % 24 + (i + 1) % 24
    return points, np.vstack([np.column_stack([i, i + 24, after]), np.column_stack([after, i + 24, after + 24])])


def open_meshes() -> list[OpenMesh]:
    """The cases of the table."""
    half = np.linspace(0.0, np.pi, 31)
    ball = np.sin(half), -np.cos(half)
    profile = np.linspace(0.0, 1.0, 31)
    figure = 0.5 + 0.25 * np.cos(5.0 * profile), 2.0 * profile
    figure[0][-1] = 0.0

    def of_sphere(points: FloatArray) -> FloatArray:
        return np.asarray(np.abs(np.linalg.norm(points, axis=1) - 1.0))

    def of_plane(height: float) -> Distance:
        return lambda points: np.abs(points[:, 2] - height)

    def of_ends(points: FloatArray) -> FloatArray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        return np.hypot(points[:, 0], points[:, 1]) * np.minimum(np.abs(np.sin(angle)), np.abs(np.sin(angle - 2.0)))

    side, faces = rectangle((10, 10))
    side = np.column_stack([side - 5.0, np.full(len(side), 5.0)])
    turns = np.array(
        [[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], [[1, 0, 0], [0, 0, -1], [0, 1, 0]]]
    )
    more = np.array(
        [[[0, 0, -1], [0, 1, 0], [1, 0, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [[1, 0, 0], [0, -1, 0], [0, 0, -1]]]
    )
    box = weld(*((side @ turn.astype(float), faces) for turn in [*turns[1:], *more]))
    rings = np.arange(13.0)
    tube = revolved(np.full(13, 3.0), rings, 24)
    cup = revolved(np.r_[np.full(9, 3.0), [2.25, 1.5, 0.75, 0.0]], np.r_[np.arange(8.0, -1.0, -1.0), np.zeros(4)], 24)
    inside = revolved(np.r_[np.full(8, 2.0), [1.0, 0.0]], np.r_[np.arange(8.0, 0.0, -1.0), [1.0, 1.0]], 16)
    hills, hill_faces = (
        bf.surfaces.punched_patch(holes=[(0.1, 0.2, 0.3)]).vertices,
        bf.surfaces.punched_patch(holes=[(0.1, 0.2, 0.3)]).faces,
    )

    def of_hills(points: FloatArray) -> FloatArray:
        heights = 0.1 * np.sin(2.0 * np.pi * points[:, 0]) * np.cos(2.0 * np.pi * points[:, 1])
        return np.asarray(np.abs(points[:, 2] - heights))

    def of_bolts(points: FloatArray) -> FloatArray:
        return np.min([np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - r) for x, y, r in BOLTS], axis=0)

    def outwards(mesh: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
        return mesh[0], mesh[1][:, ::-1]

    cases = [
        ("sphere, cap of 30 degrees", revolved(ball[0][:-5], ball[1][:-5], 48), of_sphere, "surface"),
        ("sphere, half", revolved(ball[0][:16], ball[1][:16], 48), of_plane(0.0), "flat"),
        ("tube", tube, lambda points: np.minimum(np.abs(points[:, 2]), np.abs(points[:, 2] - 12.0)), "flat"),
        ("box without its lid", box, of_plane(5.0), "flat"),
        ("figurine without its base", revolved(*figure, 36), of_plane(0.0), "flat"),
        ("vessel", bent_tube(), of_ends, "flat"),
        ("terrain", (hills, hill_faces), of_hills, "surface"),
        ("cup without its rim", weld(outwards(cup), inside), of_plane(8.0), "flat"),
        ("plate without its bottom", plate(bottom=False, bolt_walls=True), of_plane(-3.0), "flat"),
        ("sheet with bolt holes", sheet_with_holes(), of_plane(0.0), "open"),
        ("plate without bolt-hole walls", plate(bottom=True, bolt_walls=False), of_bolts, "surface"),
    ]
    return [OpenMesh(name, *mesh, distance, expected) for name, mesh, distance, expected in cases]


def edge_length(vertices: FloatArray, faces: IntArray) -> float:
    """Mean length of the edges."""
    return float(np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation in all directions, in edges")
    options = parser.parse_args()
    print("| mesh | expected | fills | distance [edges] |\n|---|---|---|---|")
    for case in open_meshes():
        edge = edge_length(case.vertices, case.faces)
        rng = np.random.default_rng(0)
        vertices = case.vertices + options.noise * edge * rng.standard_normal(case.vertices.shape)
        result = bf.fill_holes(vertices, case.faces)
        kinds = Counter(
            (hole.method or "open") + (f" between {hole.islands + 1} rims" if hole.islands else "")
            for hole in result.holes
        )
        fills = [f"{count} {kind}" for kind, count in kinds.items()]
        new = result.vertices[len(vertices) :]
        off = float(np.sqrt(np.square(case.distance(new)).mean())) / edge if len(new) else 0.0
        print(f"| {case.name} | {case.expected} | {', '.join(fills)} | {off:.3f} |")


if __name__ == "__main__":
    main()
