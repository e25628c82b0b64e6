# SPDX-License-Identifier: GPL-3.0-or-later
"""Code that the generated scenes share: shapes, materials, the scene, camera paths, the phone and rendering."""
