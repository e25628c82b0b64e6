"""A trained scene and a prompt (text, click, box or mask) come in; objects with a membership per Gaussian go out."""

__all__: list[str] = []
