"""``python -m engine``: the command line."""

import os
import sys

# Torch's OpenMP threads spin at barriers; beside our own threads on few cores that made a step eight times slower.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from .cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
