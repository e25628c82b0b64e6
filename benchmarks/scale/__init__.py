"""Cameras of 25 to 1,000 photos of a generated building: seconds, memory, and the error against the exact truth."""
