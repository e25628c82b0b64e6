"""Weight files: a catalogue name comes in, the path of a checked file or an open ONNX session goes out."""

__all__: list[str] = []
