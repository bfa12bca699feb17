"""Polynomials and Bezier patches: fitting one to points, and its derivatives."""
