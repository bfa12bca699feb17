"""Samples of neighbourhoods, and the statistics of polynomial fits to them."""
