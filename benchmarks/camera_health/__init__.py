"""The health check of the cameras on sound photo sets, which must give no alarm, and on spoilt ones, which must be named.

    python -m benchmarks.camera_health --doc docs/photos.md

The generated rooms are those of ``demo``; the real sets are read from ``GAUSSIAN_HERITAGE_DATA``. Photos have at most 640
pixels, and a set at most 16 photos, so that all of it takes about 20 minutes on two cores.
"""
