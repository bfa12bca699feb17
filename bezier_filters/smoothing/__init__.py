"""Removes the noise of a mesh and preserves its edges."""
