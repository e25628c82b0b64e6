"""The health check of the cameras on sound photo sets, which give no alarm, and on spoilt ones, which are named.

    python -m benchmarks.camera_health --doc docs/photos.md

The generated rooms are those of ``demo``; the real sets are read from ``GAUSSIAN_HERITAGE_DATA``. Photos have at most
800 pixels, and most sets 16 photos, so that all of it takes about 15 minutes on two idle cores.
"""
