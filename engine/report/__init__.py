"""A finished project folder comes in; a report that a curator can read goes out."""

__all__: list[str] = []
