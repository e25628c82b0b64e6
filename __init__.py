"""Gaussian Heritage: photos of a museum scene in, separate 3D objects out. Entry point of the Blender extension."""


def register() -> None:
    """Add operators, panels and preferences to Blender."""
    from . import gaussian_heritage_addon, operators

    gaussian_heritage_addon.register()
    operators.register()


def unregister() -> None:
    """Remove them from Blender."""
    from . import gaussian_heritage_addon

    gaussian_heritage_addon.unregister()
