"""Normals and curvatures of every vertex: the choice of the fit, its fallbacks and its result."""
