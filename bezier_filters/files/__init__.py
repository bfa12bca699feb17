"""Readers and writers that pymeshlab does not have."""
