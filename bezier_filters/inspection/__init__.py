"""Inspection: a mesh against the surface of another, and measures of surfaces, with standard errors."""
