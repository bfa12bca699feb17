"""Normals and curvatures of every vertex: the fit, and what is tried where it fails."""
