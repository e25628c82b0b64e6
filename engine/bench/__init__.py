"""A scene comes in; a table of the presets goes out: error against run time, side by side on the same cameras."""

__all__: list[str] = []
