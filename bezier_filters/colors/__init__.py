"""Ranges and palettes of colours, and tables for notebooks."""
