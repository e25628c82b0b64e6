"""The engine's Python and models on this computer, and the preferences that choose them."""
