"""Masks: photos come in, one int32 label map a photo goes out; clicks and boxes become masks too."""

__all__: list[str] = []
