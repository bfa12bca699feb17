"""The filters in other programs: what a program has goes in as arrays, and comes back as it wants it."""
