"""Compiled kernels that fit a patch at every vertex and evaluate its differential geometry."""
