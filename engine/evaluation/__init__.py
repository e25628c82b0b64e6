"""What is measured: pictures against photos, masks against masks, features against segments. Arrays in, numbers out."""

__all__: list[str] = []
