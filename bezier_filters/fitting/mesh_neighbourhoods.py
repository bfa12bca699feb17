"""The neighbourhoods of a mesh in memory."""

from dataclasses import dataclass

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.fitting.outlier_removal import move_outliers
from bezier_filters.kernels.kernel_input import KernelMesh, use_smoothed_normals
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.sampling.neighbourhood_samples import (
    NeighbourhoodSample,
    SampleMode,
    draw_from_mesh,
    sample_by_mode,
)


@dataclass(frozen=True)
class MeshNeighbourhoods:
    """The `Neighbourhoods` of a mesh in memory."""

    mesh: KernelMesh
    edges: BoolArray | None = None  # (n,): sharp edges under the noise, at which the search for outliers ends, too
    noise_floor: float = 0.0  # least variance of the noise, that of rounded coordinates, length^2

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return len(self.mesh.vertices)

    @cached_property
    def clean(self) -> "MeshNeighbourhoods":
        """The same with the outliers moved onto the surface around them."""
        return MeshNeighbourhoods(move_outliers(self.mesh, self.edges), noise_floor=self.noise_floor)

    @cached_property
    def smooth_mesh(self) -> KernelMesh:
        """The mesh with smoothed normals."""
        return use_smoothed_normals(self.mesh)

    def draw(self, count: int) -> IntArray:
        """Draw up to `count` vertices that have a normal, in random order."""
        return draw_from_mesh(self.mesh, count)

    def sample(self, vertices: IntArray, rings: int, mode: SampleMode) -> NeighbourhoodSample:
        """Sample the neighbourhoods of some vertices, out to a widest ring."""
        return sample_by_mode(self.smooth_mesh if mode == "smoothed" else self.mesh, vertices, rings, mode)
