"""How well selections are replaced and gaps bridged: distances from surfaces of known shape, with and without noise.

The first table has bumps on surfaces, which are selected and replaced: the error of the volume that is reported as
removed, and of the height, and the distance of the new vertices from the surface. The second has gaps, which are
bridged. Distances are root mean squares in edges.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import bezier_filters as bf
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.removed_material import cone_volume
from bezier_filters.surfaces import block_with_sharp_edges, cylinder, sphere, torus
from open_ends import BOLTS, bent_tube, edge_length, plate

Distance = Callable[[FloatArray], FloatArray]
RADIUS, HEIGHT = 0.35, 0.15  # of the bumps


@dataclass(frozen=True)
class Bump:
    """A surface and the displacements of its vertices."""

    vertices: FloatArray
    faces: IntArray
    moves: FloatArray
    distance: Distance  # of points from the surface

    @property
    def selected(self) -> BoolArray:
        """Faces with a vertex that moves, (m,)."""
        return np.asarray((self.moves != 0.0).any(axis=1)[self.faces].any(axis=1))

    @property
    def volume(self) -> float:
        """Volume of the bump."""
        origin = np.zeros(3)
        return cone_volume(self.vertices + self.moves, self.faces, origin) - cone_volume(
            self.vertices, self.faces, origin
        )


@dataclass(frozen=True)
class Gap:
    """A mesh with holes, and the pairs to join."""

    vertices: FloatArray
    faces: IntArray
    distance: Distance  # of points from the surface that should close it
    pairs: tuple[tuple[int, int], ...]


def bump(vertices: FloatArray, directions: FloatArray, center: FloatArray, height: float = HEIGHT) -> FloatArray:
    """Height (1 - d^2 / r^2)^2 along the directions, at the distance d < r from a point."""
    squares = np.square(vertices - center).sum(axis=1) / RADIUS**2
    return directions * (height * np.square(1.0 - np.minimum(squares, 1.0)))[:, np.newaxis]


def off_the_sphere(points: FloatArray) -> FloatArray:
    """Distance from the unit sphere."""
    return np.asarray(np.linalg.norm(points, axis=1) - 1.0)


def off_the_torus(points: FloatArray) -> FloatArray:
    """Distance from the torus of radii 1 and 0.4."""
    return np.asarray(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.4)


def off_the_tube(points: FloatArray) -> FloatArray:
    """Distance from the cylinder of radius 1."""
    return np.asarray(np.hypot(points[:, 0], points[:, 1]) - 1.0)


def off_the_cube(points: FloatArray) -> FloatArray:
    """Distance from the surface of the cube with sides of 1, of points near it."""
    return np.asarray(np.abs(points).max(axis=1) - 0.5)


def off_the_vessel(points: FloatArray) -> FloatArray:
    """Distance from the bent tube of growing radius."""
    radius = 1.0 + 0.15 * np.arctan2(points[:, 1], points[:, 0])
    return np.asarray(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 5.0, points[:, 2]) - radius)


def off_the_bolts(points: FloatArray) -> FloatArray:
    """Distance from the walls of the bolt holes."""
    return np.min([np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - r) for x, y, r in BOLTS], axis=0)


def bumps() -> dict[str, Bump]:
    """Bumps on smooth surfaces and across an edge."""
    found = {}
    for name, surface, distance in (
        ("sphere", sphere(resolution=32, jitter=0.2), off_the_sphere),
        ("torus", torus(resolution=64, jitter=0.2), off_the_torus),
        ("cylinder", cylinder(resolution=96, jitter=0.2), off_the_tube),
    ):
        middle = np.abs(surface.vertices[:, 2] - surface.vertices[:, 2].mean()) + 0.1 * np.abs(surface.vertices[:, 1])
        moves = bump(surface.vertices, surface.normals, surface.vertices[middle.argmin()])
        found[name] = Bump(surface.vertices, surface.faces, moves, distance)
    vertices, faces = block_with_sharp_edges(resolution=24)
    across = np.broadcast_to([0.7, -0.7, 0.0], vertices.shape)
    moves = bump(vertices, across, np.array([0.5, -0.5, 0.0]), 0.1)
    return found | {"edge of a block": Bump(vertices, faces, moves, off_the_cube)}


def gaps() -> dict[str, Gap]:
    """Gaps all around, and bolt holes without walls."""

    def without(faces: IntArray, values: FloatArray, width: float) -> IntArray:
        return faces[~(np.abs(values) < width)[faces].any(axis=1)]

    ball, ring = sphere(resolution=32, jitter=0.2), torus(resolution=64, jitter=0.2)
    tube, (vessel, vessel_faces) = cylinder(resolution=64, jitter=0.2), bent_tube()
    halves = without(ball.faces, ball.vertices[:, 2], 0.3)
    turn = np.arctan2(ring.vertices[:, 1], ring.vertices[:, 0])
    middle = tube.vertices[:, 2] - tube.vertices[:, 2].mean()
    bend = np.arctan2(vessel[:, 1], vessel[:, 0]) - 1.0
    five = tuple((2 * k, 2 * k + 1) for k in range(5))
    return {
        "sphere": Gap(ball.vertices, halves, off_the_sphere, ((0, 1),)),
        "torus": Gap(ring.vertices, without(ring.faces, turn, 0.5), off_the_torus, ((0, 1),)),
        "tube": Gap(tube.vertices, without(tube.faces, middle, 0.4), off_the_tube, ((1, 2),)),
        "vessel": Gap(vessel, without(vessel_faces, bend, 0.12), off_the_vessel, ((1, 2),)),
        "bolt holes": Gap(*plate(bottom=True, bolt_walls=False), off_the_bolts, five),
    }


def add_noise(vertices: FloatArray, faces: IntArray, noise: float) -> FloatArray:
    """Vertices with noise in all directions, in edges."""
    scale = noise * edge_length(vertices, faces)
    return np.asarray(vertices + scale * np.random.default_rng(0).standard_normal(vertices.shape))


def mean_distance(distance: Distance, points: FloatArray, edge: float) -> float:
    """Root mean square distance of points, in edges."""
    return float(np.sqrt(np.square(distance(points)).mean()) / edge) if len(points) else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    print("| bump on | noise [edges] | fill | error of volume | error of height | distance [edges] |")
    print("|---|---|---|---|---|---|")
    for name, case in bumps().items():
        height = float(np.linalg.norm(case.moves, axis=1).max())
        for noise in (0.0, 0.1):
            vertices = add_noise(case.vertices + case.moves, case.faces, noise)
            result = bf.replace_selection(vertices, case.faces, case.selected)
            (patch,) = result.patches
            ratios = patch.removed_volume / case.volume, patch.removed_height / height
            of_volume, of_height = (f"{round(100.0 * (ratio - 1.0), 1) + 0.0:.1f} %" for ratio in ratios)
            new = result.vertices[len(result.old_vertices) :]
            off = mean_distance(case.distance, new, edge_length(case.vertices, case.faces))
            print(f"| {name} | {noise:g} | {patch.hole.method} | {of_volume} | {of_height} | {off:.4f} |")
    print("\n| gap in | noise [edges] | bands | new faces | distance [edges] |\n|---|---|---|---|---|")
    for name, gap in gaps().items():
        for noise in (0.0, 0.1):
            vertices = add_noise(gap.vertices, gap.faces, noise)
            result = bf.bridge_holes(vertices, gap.faces, gap.pairs)
            kinds = ", ".join(sorted({hole.method or "open" for hole in result.holes}))
            off = mean_distance(gap.distance, result.vertices[len(vertices) :], edge_length(gap.vertices, gap.faces))
            count = sum(len(hole.new_faces) for hole in result.holes)
            print(f"| {name} | {noise:g} | {len(result.holes)} {kinds} | {count} | {off:.4f} |")


if __name__ == "__main__":
    main()
