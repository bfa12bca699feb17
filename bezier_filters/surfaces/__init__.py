"""Sample meshes of analytic surfaces with exact normals, curvatures and principal directions."""

from bezier_filters.surfaces.closed import block_with_sharp_edges, bumpy_star, ellipsoid, sphere, torus
from bezier_filters.surfaces.open import HeightFunction, cylinder, height_field, monkey_saddle, punched_patch, waves
from bezier_filters.surfaces.sampling import SampledSurface

__all__ = [
    "HeightFunction",
    "SampledSurface",
    "block_with_sharp_edges",
    "bumpy_star",
    "cylinder",
    "ellipsoid",
    "height_field",
    "monkey_saddle",
    "punched_patch",
    "sphere",
    "torus",
    "waves",
]
