"""Quality of training on many photo sets: ``python -m benchmarks.training``, with one part of the method exchanged."""
