"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

There are several estimates of the surface, from smooth to sharp (`surface_estimates`). Stein's estimate of the
risk tells what is best around each vertex, and which of them are worth their while at all.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.smoothing.extent import Extent
from bezier_filters.smoothing.laplacian import Borders
from bezier_filters.smoothing.low_pass import Choice, LowPass, choose_low_pass, fit_low_pass
from bezier_filters.smoothing.noise_levels import noise_levels
from bezier_filters.smoothing.pieces import Arrays, Domain, Handle, Outcome, Piece
from bezier_filters.smoothing.risk_stages import WIDTH, Terms, local_risks, local_shares
from bezier_filters.smoothing.stein import noise_factor
from bezier_filters.smoothing.surface_estimates import GENTLE, KINDS, Estimate, surface_estimates
from bezier_filters.smoothing.whole_mesh import WholeMesh

DETAIL = 0.01
"""Times the mean edge: fine relief of clean scans, in which neighbours differ, too, and which is left alone."""
SMALLEST_NOISE = 1e-4
"""Times the mean edge: below that there is nothing to take off."""
GAIN = 1e-3
"""Times sigma^2: mean decrease of the risk around a vertex below which a further estimate is left out."""
SHARPNESS = (0.0, 0.0, 0.33, 0.67, 1.0)
"""Of the kinds of estimates, as reported."""
STEPS = 6
"""Of the progress."""


def denoise(
    domain: Domain,
    sigma: float,
    extent: Extent,
    borders: Borders,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> Handle:
    """Take the noise off.

    Parameters
    ----------
    domain : Domain
        The mesh.
    sigma : float
        Standard deviation of the noise along the normal, a length.
    extent : Extent
        Of the mesh.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay.
    threads : int
        Number of threads for what is learned from parts.
    progress : callable, optional
        Called after each of a few steps.

    Returns
    -------
    Handle
        "points" (n, 3), coordinates, and "sharpness" (n,): 0 where the surface was taken for smooth, 1 where edges were
        kept as sharp as can be.
    """
    unit = extent.mean_edge
    least = (DETAIL + SMALLEST_NOISE) * unit
    if not (sigma > least and unit > 0.0):
        return domain.run(Denoised((), 1.0)).vertices
    measured = domain
    scale = float(2.0 ** -np.round(np.log2(unit)))  # single precision has few exponents
    sigma, unit, least = sigma * scale, unit * scale, least * scale
    domain = measured.normalised(extent.far_center, scale).clustered()
    levels = noise_levels(domain, sigma, unit, least, DETAIL * unit)
    report(progress, 0, STEPS)
    parts = domain.sampled_parts()
    choice = choose_low_pass(parts, domain.at(parts.vertices, "levels", levels), borders, unit, threads=threads)
    report(progress, 1, STEPS)
    low_pass = fit_low_pass(domain, levels, choice)
    report(progress, 2, STEPS)
    kinds = frozenset(KINDS)
    if parts.mesh.vertex_count < domain.vertex_count:
        # Which estimates are worthwhile is found out on parts, among them the roughest.
        kinds = _kinds_on_parts(domain, levels, choice, _roughest(domain, low_pass), threads)
    del parts  # for large meshes, memory counts
    estimates = surface_estimates(domain, low_pass, levels, kinds)
    del low_pass
    found, shares = _worthwhile(domain, estimates, progress)
    stage = Denoised(tuple(SHARPNESS[estimate.kind] for estimate in found), scale)
    inputs = {f"estimate{k}": estimate.values for k, estimate in enumerate(found)}
    inputs |= {} if shares is None else {"shares": shares}
    result = measured.run(stage, **inputs)
    domain.free(levels, *inputs.values())
    report(progress, STEPS, STEPS)
    return result.vertices


@dataclass(frozen=True)
class Denoised:
    """The mixture of some estimates; the mesh itself if there is none.

    Attributes
    ----------
    sharpness : tuple of float
        Of the estimates.
    scale : float
        Unit of their moves per length.
    """

    sharpness: tuple[float, ...]
    scale: float
    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Coordinates (n, 3) and sharpness (n,)."""
        points = piece.mesh.vertices.copy()
        if not self.sharpness:
            return Outcome(vertices={"points": points, "sharpness": np.zeros(len(points))})
        shares = inputs["shares"]["shares"] if "shares" in inputs else np.ones((len(points), 1), np.float32)
        scale = np.float64(self.scale)  # which may be beyond the single precision of the moves
        for k in range(len(self.sharpness)):
            points += shares[:, [k]] * (inputs[f"estimate{k}"]["moves"] / scale)
        return Outcome(vertices={"points": points, "sharpness": np.einsum("ns,s->n", shares, np.array(self.sharpness))})


def _roughest(domain: Domain, low_pass: LowPass) -> int:
    """The vertex around which the low-pass filter does worst, as at edges."""
    terms = domain.run(Terms(1.0), mixture=low_pass.mixture).clusters
    risks = domain.diffused(terms, WIDTH)
    result = domain.center_of_largest(risks)
    domain.free(terms, risks)
    return result


def _kinds_on_parts(domain: Domain, levels: Handle, choice: Choice, roughest: int, threads: int) -> frozenset[int]:
    """Kinds of estimates that are worthwhile on parts of a mesh, one of them around a given vertex."""
    parts = domain.sampled_parts((roughest,))
    of_parts = {"levels": domain.at(parts.vertices, "levels", levels)}
    on_parts = WholeMesh(parts.mesh, parts.adjacency, threads).clustered()
    low_pass = fit_low_pass(on_parts, of_parts, choice)
    found, _ = _worthwhile(on_parts, surface_estimates(on_parts, low_pass, of_parts, frozenset(KINDS)), None)
    return frozenset(estimate.kind for estimate in found)


def _worthwhile(
    domain: Domain, estimates: Iterator[Estimate], progress: Progress | None
) -> tuple[list[Estimate], Handle | None]:
    """The first estimate and those that lower the risk somewhere, and their "shares" at every vertex, if several."""
    found, chosen = [next(estimates)], None
    means = [_means(domain, found[0])]
    for estimate in estimates:
        report(progress, min(2 + estimate.kind, STEPS - 1), STEPS)
        these, those = [*found, estimate], [*means, _means(domain, estimate)]
        factor = noise_factor(*np.array(those).T)
        risks, gain = local_risks(domain, {f"estimate{k}": e.values for k, e in enumerate(these)}, factor)
        if gain > GAIN:
            domain.free(*([] if chosen is None else [chosen]))
            found, means, chosen = these, those, risks
            continue
        domain.free(risks, estimate.values)
        if estimate.kind > GENTLE:
            break
    estimates.close()  # type: ignore[attr-defined]
    if chosen is None:
        return found, None
    shares = local_shares(domain, chosen).vertices
    domain.free(chosen)
    return found, shares


@dataclass(frozen=True)
class Means:
    """What holds for an estimate as a whole."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Sums of squared residuals and of leverages."""
        estimate = inputs["estimate"]
        return Outcome(squares={"residuals": estimate["residuals"]}, sums={"leverages": estimate["leverages"]})


def _means(domain: Domain, estimate: Estimate) -> FloatArray:
    """Mean squared residual and mean leverage."""
    sums = domain.run(Means(), estimate=estimate.values).sums
    return np.array([sums["residuals"][0], sums["leverages"][0]]) / domain.vertex_count
