"""Benchmarks of what docs/security.md promises: ``python -m benchmarks.security.NAME``."""
