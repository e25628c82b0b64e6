"""What a batch costs and survives: ``python -m benchmarks.batch``; writes the tables of docs/batch.md."""
