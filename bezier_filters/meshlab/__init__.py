"""Filters on a `pymeshlab.MeshSet`: all that reads and writes one."""
