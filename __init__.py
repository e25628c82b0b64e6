"""Gaussian Heritage: photos of a museum scene in, separate 3D objects out. The extension's entry: nothing else."""


def register() -> None:
    """Add operators, panels and preferences to Blender."""
    from . import gaussian_heritage_addon, operators

    gaussian_heritage_addon.register()
    operators.register()


def unregister() -> None:
    """Take them away again."""
    from . import gaussian_heritage_addon, operators

    operators.unregister()
    gaussian_heritage_addon.unregister()
