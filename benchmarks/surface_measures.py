"""Whether the standard errors of integrals over a surface are the spread of repeated measurements.

    python benchmarks/surface_measures.py

A surface with new noise each time is measured several times. Of each integral the table has the standard deviation of
these values over the root mean square of the stated standard errors, 1 if they hold, known to a quarter from ten
measurements, with root mean square errors in place of deviations for the total Gaussian curvature, whose standard error
includes the error of shape; and of Willmore's energy the mean, and the mean less the stated bias, over the value
without noise.
"""

import numpy as np

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.surfaces import SampledSurface
from strongest_peer import mean_edge

MEASUREMENTS, REPEATS = 10, 6
"""Meshes with new noise, and fits for the standard errors of each."""
LEVELS = (0.05, 0.1, 0.2)
BODIES = {
    "torus": surfaces.torus(resolution=24, jitter=0.2),
    "ellipsoid": surfaces.ellipsoid(resolution=12, jitter=0.2),
    "bumpy star": surfaces.bumpy_star(resolution=20, jitter=0.2),
}
NAMES = ["area", "volume", "total_mean_curvature", "total_gaussian_curvature", "willmore_energy", "bending_energy"]


def ratios(body: SampledSurface, level: float) -> tuple[np.ndarray, float, float]:
    """Spread over stated errors of all integrals, and Willmore's energy, plain and corrected, over that without."""
    exact = bf.measure(body.vertices, body.faces, repeats=0).whole.values
    values, errors, biases = [], [], []
    for seed in range(MEASUREMENTS):
        heights = np.random.default_rng(seed).standard_normal((len(body.vertices), 1))
        vertices = body.vertices + level * mean_edge(body.vertices, body.faces) * heights * body.normals
        found = bf.measure(vertices, body.faces, repeats=REPEATS, seed=seed).whole
        values.append([getattr(found.values, name) for name in NAMES])
        errors.append([getattr(found.std, name) for name in NAMES])
        biases.append(found.bias.willmore_energy)
    spread, total = np.std(values, axis=0, ddof=1), NAMES.index("total_gaussian_curvature")
    spread[total] = np.sqrt(np.square(np.array(values)[:, total] - exact.total_gaussian_curvature).mean())
    ratio = spread / np.sqrt(np.square(errors).mean(axis=0))
    plain = float(np.mean(values, axis=0)[NAMES.index("willmore_energy")])
    energy = exact.willmore_energy
    return ratio, plain / energy, (plain - float(np.mean(biases))) / energy


def main() -> None:
    """Print the table."""
    print(f"| surface | noise, edges | {' | '.join(NAMES).replace('_', ' ')} | energy | less bias |")
    print("|---" * (len(NAMES) + 4) + "|")
    for name, body in BODIES.items():
        for level in LEVELS:
            spread, plain, corrected = ratios(body, level)
            cells = " | ".join(f"{value:.2f}" for value in (*spread, plain, corrected))
            print(f"| {name} | {level:g} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
