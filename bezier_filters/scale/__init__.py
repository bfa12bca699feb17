"""Meshes that do not fit into memory: in tiles, on Dask (``pip install "bezier-filters[scale]"``).

`estimate_file` gives the values of `bezier_filters.estimate_vertex_geometry` for files of any size, and
`smooth_file` those of `bezier_filters.smooth`; `surface_at_file` those of `bezier_filters.surface_at`.
"""

from bezier_filters.scale.estimate import estimate_file
from bezier_filters.scale.smooth import smooth_file
from bezier_filters.scale.surface import surface_at_file
from bezier_filters.surface_model.fit_options import FitOptions

__all__ = ["FitOptions", "estimate_file", "smooth_file", "surface_at_file"]
