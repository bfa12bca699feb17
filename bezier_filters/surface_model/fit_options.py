"""The options of a fit: which parameters are fixed, and which ones are chosen by the data."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.meshes.mesh import MAX_COORDINATE
from bezier_filters.meshes.neighbourhoods import MAX_NEIGHBOURHOOD_RINGS
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.patches.smoothness import Smoothness

Automatic = Literal["auto"]
Fallbacks = Literal["sound", "paper"]
FoldTest = Literal["angle", "crossings"]
MAX_NEIGHBOURS = 1000  # points that users may ask for; lists of the nearest points grow with them
CANDIDATE_DEGREES = (2, 3, 4, 5, 6)
NEEDS_ALPHA = "fallbacks, fold_test and x_axis are for fits with a number for alpha; give alpha, or none of them"


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit: those of `estimate_vertex_geometry`, where each is described.

    Meshes in tiles have no balls: there, `radius` is refused. Only point clouds have `neighbours`.
    """

    rings: int | Automatic = "auto"
    alpha: float | Automatic = "auto"
    degree: int | Automatic = "auto"
    smoothness: Smoothness = "third_order"
    robust: bool | None = None
    noise: float | None = None
    detail: float | None = None
    radius: float | None = None
    fallbacks: Fallbacks = "sound"
    fold_test: FoldTest = "angle"
    neighbours: int | None = None

    def __post_init__(self) -> None:
        """Convert numbers of NumPy, which have no JSON."""
        for name, value in vars(self).items():
            if isinstance(value, np.generic):
                object.__setattr__(self, name, value.item())

    def check(self) -> None:
        """Refuse options that are out of range, or exclude each other.

        Raises
        ------
        InvalidParameterError
            It names the parameter.
        """
        if not (self.rings == "auto" or (is_integer(self.rings) and 1 <= self.rings <= MAX_NEIGHBOURHOOD_RINGS)):
            raise InvalidParameterError(
                f"rings: got {self.rings!r}, expected an integer from 1 to {MAX_NEIGHBOURHOOD_RINGS}, or 'auto'"
            )
        if self.radius is not None:
            if not (is_real(self.radius) and 0.0 < self.radius < np.inf):
                raise InvalidParameterError(f"radius: got {self.radius!r}, expected a positive length, or None")
            if self.rings != "auto":
                raise InvalidParameterError(
                    f"radius: got {self.radius!r} and rings={self.rings!r}; give one of them, not both"
                )
        self._check_neighbours()
        is_degree = is_integer(self.degree) and self.degree in CANDIDATE_DEGREES
        if not self.is_fixed and self.degree != "auto" and not is_degree:
            raise InvalidParameterError(f"degree: got {self.degree!r}, expected one of {CANDIDATE_DEGREES}, or 'auto'")
        if not self.is_fixed and self.smoothness != "third_order":
            raise InvalidParameterError(
                f"smoothness: got {self.smoothness!r}, expected 'third_order' or 'paper', or a number for alpha"
            )
        if not (self.robust is None or isinstance(self.robust, bool)):
            raise InvalidParameterError(f"robust: got {self.robust!r}, expected True, False or None")
        fixed = self.patch  # PatchFit checks its own parameters
        size = "radius" if self.radius is not None else "neighbours" if self.neighbours is not None else "rings"
        has_size = self.ring_count is not None or not self.has_rings
        check_noise(self.noise)
        if self.noise is not None and fixed is not None and has_size:
            given = f"{size} and alpha are given"
            if self.alpha == "auto" and not self.has_rings:
                given = f'{size} is given and smoothness="paper" determines alpha'
            elif "auto" in (self.alpha, self.rings) and self.has_rings:
                given = 'smoothness="paper" determines rings and alpha'
            raise InvalidParameterError(f"noise: {given}, so the noise has no effect; omit it")
        check_detail(self.detail)
        by = 'smoothness="paper"' if size == "rings" and self.rings == "auto" else size
        if self.detail is not None and has_size:
            raise InvalidParameterError(f"detail: {by} determines the size of neighbourhoods already; omit one of them")
        if self.fallbacks not in get_args(Fallbacks):
            raise InvalidParameterError(f"fallbacks: got {self.fallbacks!r}, expected one of {get_args(Fallbacks)}")
        if self.fold_test not in get_args(FoldTest):
            raise InvalidParameterError(f"fold_test: got {self.fold_test!r}, expected one of {get_args(FoldTest)}")
        if fixed is None and (self.fallbacks != "sound" or self.fold_test != "angle"):
            raise InvalidParameterError(NEEDS_ALPHA)
        if self.fold_test != "angle" and not self.has_rings:
            raise InvalidParameterError(f"fold_test: got {self.fold_test!r}; that is for rings of meshes with faces")
        if self.fallbacks != "sound" and not self.has_rings:
            given = "a radius" if self.radius is not None else "neighbours"
            raise InvalidParameterError(
                f"fallbacks: got {self.fallbacks!r} and {given}; the paper's fallbacks need rings"
            )

    def _check_neighbours(self) -> None:
        """Refuse a number of points that is not one, or is given with another size."""
        if self.neighbours is None:
            return
        if not (is_integer(self.neighbours) and 1 <= self.neighbours <= MAX_NEIGHBOURS):
            raise InvalidParameterError(
                f"neighbours: got {self.neighbours!r}, expected an integer up to {MAX_NEIGHBOURS}, or None"
            )
        for name, value in (("rings", None if self.rings == "auto" else self.rings), ("radius", self.radius)):
            if value is not None:
                raise InvalidParameterError(
                    f"neighbours: got {self.neighbours!r} and {name}={value!r}; give one of them, not both"
                )
        least = (self.patch or PatchFit(degree=2)).free_coefficients
        if self.neighbours < least:
            raise InvalidParameterError(
                f"neighbours: got {self.neighbours!r}, where the fit needs {least} points, one of them its own"
            )

    @property
    def has_rings(self) -> bool:
        """Whether neighbourhoods are rings, given or not: neither balls of a radius nor a number of nearest points."""
        return self.radius is None and self.neighbours is None

    @property
    def is_fixed(self) -> bool:
        """Whether the patch is given; otherwise the data choose its weights."""
        return self.alpha != "auto" or self.smoothness == "paper"

    @property
    def is_learned(self) -> bool:
        """Whether the data choose the patch, or its neighbourhood."""
        return not self.is_fixed or (self.ring_count is None and self.has_rings)

    @property
    def patch(self) -> PatchFit | None:
        """The given patch, of degree 3 unless another one is given; None if the data choose it."""
        if not self.is_fixed:
            return None
        return PatchFit(
            3 if self.degree == "auto" else self.degree, 0.8 if self.alpha == "auto" else self.alpha, self.smoothness
        )

    @property
    def ring_count(self) -> int | None:
        """The given number of rings; None if the data, a radius or a number of points determine it."""
        if self.rings != "auto":
            return int(self.rings)
        return 2 if self.smoothness == "paper" and self.has_rings else None

    @property
    def degrees(self) -> tuple[int, ...]:
        """Degrees to choose from."""
        return CANDIDATE_DEGREES if self.degree == "auto" else (int(self.degree),)

    @property
    def highest_total_degree(self) -> int:
        """Highest total degree of the polynomials that may be fitted; a patch of degree d, 4 at most, has 2 d."""
        return max(CANDIDATE_DEGREES[-1], 6 if self.degree == "auto" else 2 * min(self.degree, 4))

    @property
    def max_radius(self) -> float:
        """Largest radius of a neighbourhood that keeps the smallest detail, a length; infinite without `detail`."""
        return np.inf if self.detail is None else 0.5 * self.detail


def check_noise(noise: object) -> None:
    """Refuse a standard deviation of the noise that is not a length."""
    if noise is not None and not (is_real(noise) and 0.0 <= noise < np.inf):
        raise InvalidParameterError(f"noise: got {noise!r}, expected a length of 0 or more, or None to learn it")
    if noise is not None and noise > MAX_COORDINATE:
        raise InvalidParameterError(
            f"noise: got {noise!r}, expected no more than coordinates may be, {MAX_COORDINATE:g}"
        )


def check_detail(detail: object) -> None:
    """Refuse a size of detail that is not a length."""
    if detail is not None and not (is_real(detail) and 0.0 < detail < np.inf):
        raise InvalidParameterError(f"detail: got {detail!r}, expected a positive length, or None")
