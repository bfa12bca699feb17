"""Third-order Bezier patch filters for MeshLab and PyMeshLab.

Array functions such as `estimate_vertex_geometry` take and give NumPy arrays; the filters
(`compute_curvature_by_bezier_patch_per_vertex` and its siblings) work on a `pymeshlab.MeshSet`.
Names are loaded on first use, so that importing the package is cheap and does not import
pymeshlab.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
