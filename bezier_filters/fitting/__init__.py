"""Fits at vertices: the choice of the fit, its fallbacks, the outliers and the results."""
