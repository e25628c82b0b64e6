"""Installation on a user's computer: the engine's Python environment and the model files."""
