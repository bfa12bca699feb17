"""Smoothing of clouds next to moving least squares of other programs, each at its best radius in hindsight.

Scores are root mean square distances to the true surface, in spacings (see `cloud_surfaces`). Noise is normal, along
the normals or, with --isotropic, in all directions.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

import bezier_filters as bf
from cloud_peers import PEERS
from cloud_surfaces import SURFACES, with_noise

RESULTS = Path(__file__).parent / "results" / "cloud_smoothing.csv"
LEVELS = (0.05, 0.1, 0.3, 0.5)


def scores(name: str, noise: float, count: int, *, along: bool) -> dict[str, float]:
    """Errors before, after smoothing, and of each peer at its best radius."""
    case = SURFACES[name](count, np.random.default_rng(1))
    noisy = with_noise(case, noise, np.random.default_rng(2), along=along)

    def error(points: np.ndarray) -> float:
        return float(np.sqrt(np.square(case.distance(points)).mean()) / case.spacing)

    found = {"before": error(noisy), "smooth": error(bf.smooth(noisy).vertices)}
    for peer, (project, radii) in PEERS.items():
        found[peer] = float(np.nanmin([error(project(noisy, case.spacing, radius)) for radius in radii]))
    found["ratio"] = found["smooth"] / min(found[peer] for peer in PEERS)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=5000, help="number of points")
    parser.add_argument("--isotropic", action="store_true", help="noise in all directions")
    options = parser.parse_args()
    rows = []
    for name in SURFACES:
        for noise in LEVELS:
            found = scores(name, noise, options.count, along=not options.isotropic)
            rows.append({"surface": name, "noise": noise, **{key: round(value, 4) for key, value in found.items()}})
            print(" | ".join(map(str, rows[-1].values())), flush=True)
    ratios = np.array([row["ratio"] for row in rows])
    print(f"geometric mean of the ratios {np.exp(np.log(ratios).mean()):.2f}, {(ratios <= 0.6).sum()} of {len(rows)}")
    if not options.isotropic:
        with RESULTS.open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
