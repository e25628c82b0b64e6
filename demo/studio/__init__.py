# SPDX-License-Identifier: GPL-3.0-or-later
"""What the generated scenes share: shapes, materials, the stage, the walk, the phone and the rendering."""
