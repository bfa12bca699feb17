"""Polynomials and Bezier patches: bases, smoothness rows, least-squares fits, derivatives."""
