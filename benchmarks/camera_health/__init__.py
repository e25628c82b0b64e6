"""The health check of the cameras on sound photo sets, which give no alarm, and on spoilt ones, which are named.

    python -m benchmarks.camera_health --doc docs/camera_health.md

The generated rooms are those of ``demo`` and boxes that are drawn here; the real sets are read from
``GAUSSIAN_HERITAGE_DATA``. Most sets have 16 photos of at most 800 pixels. What was found is stored, and a stopped run
continues. All of it takes about half an hour of CPU.
"""
