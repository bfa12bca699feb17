"""The neighbourhoods of a mesh in memory."""

from dataclasses import dataclass

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.fitting.outlier_removal import move_outliers
from bezier_filters.kernels.kernel_input import KernelMesh, prepare_kernel_mesh, use_smoothed_normals
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.spatial_order import SpatialOrder
from bezier_filters.noise.noise_model import NO_NOISE, NoiseModel
from bezier_filters.noise.rounded_coordinates import rounding_noise
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.sampling.mesh_parts import sample_parts
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
    # (n,): vertices on sharp edges that the noise hides, at which neighbourhoods in the search for outliers end, too
    hidden_barriers: BoolArray | None = None
    rounding: NoiseModel = NO_NOISE  # noise of rounded coordinates, see `rounding_noise`

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return len(self.mesh.vertices)

    @cached_property
    def clean(self) -> "MeshNeighbourhoods":
        """The same with the outliers moved onto the surface around them."""
        return MeshNeighbourhoods(move_outliers(self.mesh, self.hidden_barriers), rounding=self.rounding)

    @cached_property
    def smooth_mesh(self) -> KernelMesh:
        """The mesh with smoothed normals."""
        return use_smoothed_normals(self.mesh)

    def locate(self, vertices: IntArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates and unit normals of some vertices, (k, 3) each."""
        return self.mesh.vertices[vertices], self.mesh.normals[vertices]

    def draw(self, count: int) -> IntArray:
        """Draw up to `count` vertices that have a normal, in random order."""
        return draw_from_mesh(self.mesh, count)

    def sample(self, vertices: IntArray, rings: int, mode: SampleMode) -> NeighbourhoodSample:
        """Sample the neighbourhoods of some vertices, out to a widest ring."""
        mesh = self.smooth_mesh if mode == "smoothed" else self.mesh
        return sample_by_mode(mesh, vertices, rings, mode, keep_barriers=self.rounding.variance > 0.0)


def mesh_neighbourhoods(mesh: PreparedMesh, ordered: SpatialOrder | None = None) -> MeshNeighbourhoods:
    """Neighbourhoods of a mesh, which end at its sharp edges, unless these are stairs of rounded coordinates."""
    rounding = rounding_noise(sample_parts(mesh).mesh)
    arrays = prepare_kernel_mesh(mesh, ordered, with_barriers=rounding.variance == 0.0)
    return MeshNeighbourhoods(arrays, rounding=rounding)
