"""Grounding: a photo and a prompt in words come in, boxes with scores go out, or the news that the prompt is not known."""

__all__: list[str] = []
