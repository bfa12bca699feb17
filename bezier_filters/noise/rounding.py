"""How coordinates are rounded: to multiples of steps, to the voxels of a mask, or to a number of digits.

What is rounded to a step s has errors of standard deviation s / sqrt(12) (Widrow, Kollar, "Quantization Noise", 2008).
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray

# Longest over shortest side of voxels that count as cubes. With 1 twelve masks of cubes have faces a tenth less exact,
# and turned boxes keep 1.7 times as much of their errors; with 3 masks with slices 2 or 3 voxels apart 1.2 times.
MAX_CUBIC_RATIO = 1.5
MAX_SAMPLE = 1_000  # numbers that are looked at first
MAX_DIGITS = {2: 20, 10: 6}  # by base: numbers of more digits are those of single precision, whose errors do not matter


@dataclass(frozen=True)
class Rounding:
    """How the coordinates of a mesh are rounded."""

    steps: FloatArray  # (3,): of which coordinates are multiples, or the voxels of a mask; 0 for exact coordinates
    is_mask: bool = False  # whether the mesh is the boundary of a voxel mask: one coordinate is half-way between voxels
    center: FloatArray | None = None  # (3,): coordinates of the center of a voxel of a mask
    axes: FloatArray | None = None  # (3, 3): rows are the axes of the coordinates; None for x, y, z
    # base and number of significant digits, if the steps are relative to the size of every number
    digits: tuple[int, int] | None = None

    @property
    def has_terraces(self) -> bool:
        """Whether errors are alike over terraces, which a range of the correlation does not describe.

        Those of masks of cubic voxels are as wide as an edge of the mesh.
        """
        return not self.is_mask or bool(self.steps.max() > MAX_CUBIC_RATIO * self.steps.min())

    def variances(self, vertices: FloatArray, normals: FloatArray) -> FloatArray:
        """Variances of the errors of vertices along their normals, (n,), length^2."""
        return np.asarray(np.square(self.coordinates(normals) * self.steps_of(vertices)).sum(axis=1) / 12.0)

    def coordinates(self, vectors: FloatArray) -> FloatArray:
        """Components of vectors (n, 3) along the axes, (n, 3)."""
        return vectors if self.axes is None else np.asarray(vectors @ self.axes.T)

    def steps_of(self, vertices: FloatArray) -> FloatArray:
        """The step of every coordinate of the vertices, (n, 3), along the axes; 0 where it is exact.

        >>> Rounding(np.zeros(3), digits=(10, 3)).steps_of(np.array([[0.0123, 1.5, -120.0]]))
        array([[1.e-04, 1.e-02, 1.e+00]])
        """
        places = self.coordinates(vertices)
        if not self.is_mask or self.center is None:
            relative = 0.0 if self.digits is None else _steps_of_digits(places, *self.digits)
            return np.maximum(self.steps, relative) * np.ones_like(places)
        places = (places - self.center) / self.steps
        half_way = np.abs(places - np.round(places)).argmax(axis=1)
        return np.asarray(np.eye(3)[half_way] * self.steps)


def significant_digits(vertices: FloatArray) -> tuple[int, int] | None:
    """Base and number of the digits of all coordinates (n, 3): half precision, or few decimals; None if they have many.

    >>> points = np.random.default_rng(0).normal(size=(100, 3))
    >>> significant_digits(points.astype(np.float16).astype(float)), significant_digits(points)
    ((2, 11), None)
    >>> significant_digits(np.array([float(f"{x:.2e}") for x in points.ravel()]).reshape(-1, 3))
    (10, 3)
    """
    values = vertices[vertices != 0.0]
    if not len(values):
        return None
    few = values[:: max(len(values) // MAX_SAMPLE, 1)]
    found = [
        (base, next(count for count in range(1, most + 1) if _have_digits(values, base, count)))
        for base, most in MAX_DIGITS.items()
        if _have_digits(few, base, most) and _have_digits(values, base, most)
    ]
    # of two descriptions the one with larger steps says more
    return max(found, key=lambda one: float(np.log(_steps_of_digits(values, *one)).mean()), default=None)


def _have_digits(values: FloatArray, base: int, count: int) -> bool:
    """Whether numbers have at most so many significant digits."""
    places = values / _steps_of_digits(values, base, count)
    # decimals are not exact as binary numbers, perhaps of single precision
    tolerance = np.abs(places) * (0.0 if base == 2 else np.finfo(np.float32).eps)
    return bool((np.abs(places - np.round(places)) <= tolerance).all())


def _steps_of_digits(values: FloatArray, base: int, digits: int) -> FloatArray:
    """Value of the last of so many significant digits of numbers, in the same shape; that of the smallest one for 0."""
    sizes = np.abs(values)
    least = sizes[sizes > 0.0].min(initial=1.0)
    # a power of ten may be a little below one in binary
    exponents = np.floor(np.log(np.maximum(sizes, least)) / np.log(base) + 1e-9)
    return np.asarray(float(base) ** (exponents + 1.0 - digits))
