"""Random rooms: drawn, rendered, reconstructed, measured and put into tables: ``python -m benchmarks.rooms COMMAND``.

The eight choosing rooms have fixed seeds, and settings may be chosen on them. A commit freezes a method; the seeds of
its five test rooms follow from the hash of that commit, so that nothing can have been chosen on them.
"""
