"""The noise of a mesh: strength, correlation and outliers, from sampled neighbourhoods."""
