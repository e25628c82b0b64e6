"""Photo folders, cameras and prompts mixed at random, with a known truth: ``python -m benchmarks.mixtures``."""
