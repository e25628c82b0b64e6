"""Engine jobs that Blender starts and follows, and what it does with their results."""
