"""Where the neighbourhoods of a surface come from, and the noise of its coordinates: a mesh in memory, or a store."""

from typing import Protocol

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.sampling.neighbourhood_samples import NeighbourhoodSample, SampleMode


class Neighbourhoods(Protocol):
    """The neighbourhoods of a surface, whose vertices lie in memory or in a store."""

    @property
    def vertex_count(self) -> int:
        """Number of vertices of the surface."""

    @property
    def rounding(self) -> NoiseModel:
        """Noise of rounded coordinates, of variance 0 without any: see `rounding_noise`."""

    def locate(self, vertices: IntArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates and unit normals of some vertices, (k, 3) each."""

    @property
    def clean(self) -> "Neighbourhoods":
        """The same with the outliers moved onto the surface around them."""

    def draw(self, count: int) -> IntArray:
        """Draw up to `count` vertices that have a normal, in random order: see `draw_vertices`."""

    def sample(self, vertices: IntArray, rings: int, mode: SampleMode) -> NeighbourhoodSample:
        """Sample the neighbourhoods of some vertices, out to a widest ring."""
