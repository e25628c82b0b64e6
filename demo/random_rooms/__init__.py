# SPDX-License-Identifier: GPL-3.0-or-later
"""Random museum rooms from a seed: a catalogue of exhibits, the plan of a room without Blender, and its photos."""
