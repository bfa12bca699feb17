"""Draws the figures of docs/how_it_works.md: python docs/images/how_it_works.py."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.patches import Rectangle

import bezier_filters as bf
from bezier_filters.surfaces import bumpy_star

matplotlib.use("agg")
from matplotlib import pyplot

FOLDER = Path(__file__).parent
RING_COLORS = ("#d62728", "#ff9f40", "#ffe08a", "#eeeeee")
"""Of the vertex, its first and its second ring, and what is beyond."""


def draw_patch(vertex: int = 400, alpha: float = 0.8) -> None:
    """One patch, from the rings of a vertex to the control net."""
    shape = bumpy_star(resolution=12, jitter=0.3)
    patch = bf.vertex_patch(shape.vertices, shape.faces, vertex, rings=2, alpha=alpha)
    rows = bf.vertex_adjacency(bf.triangle_mesh(shape.vertices, shape.faces))
    ring = np.full(len(shape.vertices), 3)
    for distance in (2, 1, 0):
        ring[bf.k_rings(rows, distance).row(vertex)] = distance
    members = np.flatnonzero(ring <= 2)
    figure = pyplot.figure(figsize=(12, 4.4))
    figure.subplots_adjust(left=0.06, right=0.91, bottom=0.17, top=0.9, wspace=0.2)

    local = patch.to_local(shape.vertices)
    axes = figure.add_subplot(1, 3, 1)
    near = (ring[shape.faces].min(axis=1) <= 2) & (local[shape.faces, 2].min(axis=1) > -0.5)
    for face, outermost in zip(shape.faces[near], ring[shape.faces].max(axis=1)[near], strict=True):
        axes.fill(*local[face, :2].T, facecolor=RING_COLORS[outermost], edgecolor="0.5", linewidth=0.6)
    _mark(axes, local[:, :2], ring, members)
    box = patch.rectangle
    axes.add_patch(Rectangle((box.x, box.y), box.width, box.height, fill=False, linestyle="--", edgecolor="#1f77b4"))
    axes.set(title="two rings in the tangent plane", xlabel="x [length]", ylabel="y [length]", aspect="equal")

    axes = figure.add_subplot(1, 3, 2)
    greville = np.arange(4) / 3
    grid = np.stack(np.meshgrid(greville, greville), axis=-1).reshape(-1, 2)
    for value in greville:
        axes.plot([value, value], [0, 1], "--", [0, 1], [value, value], "--", color="#1f77b4", linewidth=0.8)
    axes.plot(*grid.T, "s", markersize=6, color="#1f77b4", label="control points")
    _mark(axes, np.column_stack(patch.parameters(shape.vertices)), ring, members)
    axes.set(title="parameter square", xlabel="u", ylabel="v", aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), frameon=False)

    axes = figure.add_subplot(1, 3, 3, projection="3d", computed_zorder=False)
    u, v = (values.ravel() for values in np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 25), indexing="ij"))
    surface = patch.to_local(patch.evaluate(u, v)).reshape(25, 25, 3)
    net = patch.to_local(patch.control_net)
    axes.plot_surface(*np.moveaxis(surface, -1, 0), color="#9ecae1", alpha=0.7, linewidth=0)
    axes.plot_wireframe(*np.moveaxis(net, -1, 0), color="#1f77b4", linewidth=0.9)
    axes.scatter(
        *local[members].T, c=[RING_COLORS[k] for k in ring[members]], edgecolors="black", s=22, depthshade=False
    )
    axes.set_box_aspect((1, 1, 0.6), zoom=1.15)
    axes.set(title="points, patch and control net", xlabel="x [length]", ylabel="y [length]", zlabel="z [length]")
    axes.view_init(elev=18, azim=-55)
    axes.tick_params(labelsize=7)
    figure.savefig(FOLDER / "patch.png", dpi=100)
    pyplot.close(figure)


def _mark(axes: Any, points: np.ndarray, ring: np.ndarray, members: np.ndarray) -> None:
    colors = [RING_COLORS[k] for k in ring[members]]
    axes.scatter(*points[members].T, c=colors, edgecolors="black", s=28, zorder=3)


def draw_choice() -> None:
    """Error of the mean curvature over ring and weight, on a clean mesh and on a noisy one."""
    shape = bumpy_star(resolution=25, jitter=0.3)
    edges = shape.vertices[shape.faces[:, 0]] - shape.vertices[shape.faces[:, 1]]
    edge = np.linalg.norm(edges, axis=1).mean()
    alphas = np.array([0.5, 0.8, 0.9, 0.97, 0.99, 0.997, 0.999])
    figure, both = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True)
    for axes, noise in zip(both, (0.0, 0.05), strict=True):
        height = noise * edge * np.random.default_rng(0).standard_normal(len(shape.vertices))
        vertices = shape.vertices + height[:, None] * shape.normals

        def error(vertices: np.ndarray = vertices, **options: Any) -> float:
            found = bf.estimate_vertex_geometry(vertices, shape.faces, **options).mean_curvature
            truth = shape.mean_curvature
            return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))

        for rings, color in zip((1, 2, 3, 5, 7), pyplot.get_cmap("viridis")(np.linspace(0, 0.9, 5)), strict=True):
            curve = [error(rings=rings, alpha=alpha) for alpha in alphas]
            axes.loglog(
                (1 - alphas) / alphas, curve, "o-", color=color, label=f"{rings} rings" if rings > 1 else "1 ring"
            )
        paper = error(rings=2, alpha=0.8, smoothness="paper")
        axes.plot(0.25, paper, "*", markersize=13, color="#d62728", label="the paper: 2 rings, alpha 0.8")
        axes.axhline(error(), linestyle="--", color="black", label="chosen from the data")
        axes.set_title(f"noise of {100 * noise:g} % of the mean edge" if noise else "clean mesh")
        axes.set_xlabel("weight of smoothness against points, (1 - alpha) / alpha")
        axes.grid(which="both", alpha=0.25)
    both[0].set_ylabel("relative RMS error of the mean curvature")
    both[1].legend(fontsize=8, loc="lower left")
    figure.savefig(FOLDER / "ring_and_weight.png", dpi=100)
    pyplot.close(figure)


if __name__ == "__main__":
    draw_patch()
    draw_choice()
