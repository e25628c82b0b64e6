"""Stiff and extreme scenes come in; a table of float32 errors against float64, with bounds and verdicts, goes out."""

__all__: list[str] = []
