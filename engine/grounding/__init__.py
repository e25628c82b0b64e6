"""Grounding: a photo and words come in, boxes with scores go out, or the news that the words are not known."""

__all__: list[str] = []
