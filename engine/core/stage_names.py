"""What the stages do, in the words that users see: in Blender, on the page, and in reports."""

from __future__ import annotations

STAGE_NAMES = {
    "set-up": "Setting up",
    "models": "Fetching models",
    "frames": "Reading the video",
    "photos": "Reading the photos",
    "planning": "Planning the work",
    "cameras": "Finding where the photos were taken",
    "masks": "Finding outlines in the photos",
    "training": "Building the scene",
    "objects": "Isolating objects",
    "report": "Writing the report",
}
