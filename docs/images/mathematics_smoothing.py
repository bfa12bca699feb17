"""Figures of docs/mathematics/smoothing.md."""

import numpy as np
from mathematics_common import BLUE, GREEN, GREY, ORANGE, prepare, save, white_noise
from matplotlib import pyplot
from scipy.spatial import Delaunay
from scipy.special import j0

import bezier_filters as bf
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.chebyshev import low_pass
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.denoise import ESTIMATE_KINDS, candidates
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import FILTER_STRENGTHS, learn_low_pass
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.random_noise import WHITE, Correlation
from bezier_filters.surfaces import bumpy_star


def draw_transfer_functions() -> None:
    """Filters over the eigenvalue, for three orders, and over the wavelength, for some strengths."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 3.9), layout="constrained", sharey=True)
    x = np.linspace(0.0, 1.5, 600)
    for order, color in ((2, GREEN), (4, BLUE), (6, ORANGE)):
        left.plot(x, 1.0 / (1.0 + (1e2 * x**4) ** (order / 4)), color=color, label=f"order {order}")
    left.axvline(1e2**-0.25, color=GREY, linewidth=0.8, linestyle="--")
    left.set(xlabel="eigenvalue L", ylabel="f", title="one strength, s = 100")
    left.legend()
    left.grid(alpha=0.25)
    lengths = np.geomspace(2.5, 200.0, 600)
    values = 1.0 - j0(2.0 * np.pi / lengths)
    colors = pyplot.get_cmap("viridis")(np.linspace(0, 0.9, 8))
    for power, color in zip(range(8), colors, strict=True):
        right.semilogx(lengths, 1.0 / (1.0 + 10.0**power * values**4), color=color, label=f"$10^{power}$")
    right.set(xlabel="wavelength [edges]", title="order 4, strength")
    right.set_xticks([3, 5, 10, 20, 50, 100, 200], ["3", "5", "10", "20", "50", "100", "200"])
    right.legend(fontsize=8)
    right.grid(alpha=0.25)
    save(figure, "transfer_functions")


def draw_risk() -> None:
    """Stein's risk of the low-pass filters, next to their true error, under white and correlated noise."""
    shape = bumpy_star(resolution=40, jitter=0.2)
    mesh = prepare(shape.vertices, shape.faces)
    edge = mesh.mean_edge
    count, sigma = len(shape.vertices), 0.2 * edge
    part = whole_mesh(prepare_mesh(mesh))
    laplacian, clusters = umbrella_laplacian(part, "free"), clusters_of(part)
    figure, both = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    blurred = Correlation.calibrate(NoiseModel(0.1, (0.9,), (1.2 * edge,)), edge, part.ids, laplacian, part.core)
    for axes, truth, title in zip(both, (WHITE, blurred), ("white noise", "correlated noise"), strict=True):
        noise = truth.apply(lambda k: white_noise(count, k).astype(np.float32)[:, None], laplacian)[:, 0]
        vertices = shape.vertices + (sigma * noise)[:, None] * shape.normals
        for recipe, style, label in ((truth, "-", "Stein's risk"), (WHITE, ":", "noise taken for white")):
            if style == ":" and recipe == truth:
                continue
            noisy = NoisyMesh(part, clusters, np.full(count, sigma), recipe, laplacian)
            probes, risks, errors = noisy.probes(4), [], []
            for strength in FILTER_STRENGTHS[:-4]:
                smooth, probed = (low_pass(laplacian, one, np.array([strength])) for one in (vertices, probes))
                residuals = np.einsum("ij,ij->i", vertices - smooth, shape.normals) / sigma
                leverage = float((probes * probed).sum() / np.square(probes).sum())
                risks.append(np.square(residuals).mean() + 2.0 * leverage - 1.0)
                errors.append(np.square(np.einsum("ij,ij->i", smooth - shape.vertices, shape.normals) / sigma).mean())
            places = np.log10(np.maximum(FILTER_STRENGTHS[:-4], 10.0**-1.5))
            axes.plot(places, np.sqrt(np.maximum(risks, 0.0)), style, color=BLUE, label=label)
            if style == "-":
                axes.plot(places, np.sqrt(errors), "o", color=ORANGE, label="true error")
        axes.set(title=title, xlabel="$\\log_{10}$ of the strength s")
        axes.grid(alpha=0.25)
        axes.set_ylim(0.0, 1.05)
    both[0].set_ylabel("RMS error / standard deviation of the noise")
    both[1].legend()
    save(figure, "risk")


def draw_estimates() -> None:
    """Section of a noisy lens on a plate: estimates, and where the sharp ones are used."""
    rings, crease = 40, 22
    polar = [(k, 2.0 * np.pi * i / (6 * k)) for k in range(1, rings + 1) for i in range(6 * k)]
    radius, angle = np.array([(0, 0.0), *polar]).T
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    ball = crease * np.sqrt(2.0)  # its cap meets the plate at 45 degrees
    z = np.sqrt(np.maximum(ball**2 - radius**2, crease**2)) - crease
    clean = prepare(np.column_stack([x, y, z]), Delaunay(np.column_stack([x, y])).simplices)
    edge = clean.mean_edge
    faces = clean.faces
    corners = clean.vertices[faces]
    if np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])[2] < 0.0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    normals = bf.estimate_vertex_geometry(clean.vertices, faces).normals
    vertices = clean.vertices + (0.2 * edge * white_noise(len(x)))[:, None] * normals
    mesh = TriangleMesh(vertices, faces)
    part = whole_mesh(prepare_mesh(mesh))
    laplacian = umbrella_laplacian(part, "free")
    noisy = NoisyMesh(part, clusters_of(part), np.full(len(x), 0.2 * edge), WHITE, laplacian)
    _, filters = learn_low_pass(noisy, "curve", edge)
    found = {one.kind: vertices + one.moves for one in candidates(noisy, filters, ESTIMATE_KINDS)}
    result = bf.smooth(vertices, faces)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
    line = np.flatnonzero(angle == 0.0)
    line = line[np.abs(radius[line] - crease) <= 8]
    for points, style, color, label in (
        (vertices, "x", "0.3", "noisy"),
        (found[0], "-", GREEN, "low-pass filter"),
        (found[4], "-", BLUE, "16 rounds of the normal filter"),
        (result.vertices, "--", ORANGE, "mixture"),
    ):
        left.plot(points[line, 0], points[line, 2], style, color=color, label=label)
    left.set(xlabel="x [edges]", ylabel="z [edges]", title="section")
    left.legend(fontsize=8)
    for points, style, color in ((found[0], "-", GREEN), (found[4], "-", BLUE), (result.vertices, "--", ORANGE)):
        squares = np.square(np.einsum("ij,ij->i", points - clean.vertices, normals) / (0.2 * edge))
        means = np.bincount(radius.astype(int), squares) / np.bincount(radius.astype(int))
        right.plot(np.arange(rings) - crease, np.sqrt(means[:-1]), style, color=color)
    right.axvline(0.0, color=GREY, linewidth=0.8)
    right.set(
        xlabel="distance from the crease [edges]", ylabel="RMS error / noise", title="error by distance from the crease"
    )
    right.grid(alpha=0.25)
    save(figure, "estimates")
