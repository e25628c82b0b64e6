"""Stiff and extreme scenes come in; tables of float32's errors and of how training ends, with verdicts, go out."""

__all__: list[str] = []
