"""The cameras room: a `PhotoSet` comes in, a `CameraSet` (lens and pose per photo, points, upright world) goes out."""

__all__: list[str] = []
