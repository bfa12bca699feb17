"""Crease lines: sharp edges, ridges and ravines."""
