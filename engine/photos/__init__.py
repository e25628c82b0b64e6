"""The photos room: a folder of pictures comes in, a `PhotoSet` (usable photos, the rejected with reasons) goes out."""

__all__: list[str] = []
