"""The photos room: a folder of pictures comes in, a `PhotoSet` (names, sizes, focal lengths, hashes, and what was left out and why) goes out."""

__all__: list[str] = []
