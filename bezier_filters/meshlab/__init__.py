"""Filters on a `pymeshlab.MeshSet`."""
