"""The fields that files and filters share, and readers and writers that pymeshlab does not have."""
