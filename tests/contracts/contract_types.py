"""A contract type of our own for import-linter: packages are imported through their public face.

Read by ``lint-imports``, which `check_contracts` starts with this folder on its path.
"""

from __future__ import annotations

from typing import cast

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output

_DEPTH = 3
"""Parts of the name of a package of the engine: ``gaussian_heritage.engine.cameras``."""


class PublicFacesContract(Contract):
    """No module imports past the ``__init__.py`` of another package of the engine.

    Options
    -------
    groups : names of packages that only group others; each package or module in them has a face of its own
    public_modules : names of modules that may be imported directly, ``settings`` say
    """

    type_name = "public_faces"

    groups = fields.ListField(subfield=fields.StringField())
    public_modules = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Find every import of a module inside of another package."""
        public, groups = set(cast("list[str]", self.public_modules)), set(cast("list[str]", self.groups))
        past_the_face = [
            (importer, imported)
            for imported in sorted(graph.modules)
            if _is_inside_a_package(imported, groups) and imported.rpartition(".")[2] not in public
            for importer in sorted(graph.find_modules_that_directly_import(imported))
            if _package_of(importer, groups) != _package_of(imported, groups)
        ]
        return ContractCheck(kept=not past_the_face, metadata={"imports": past_the_face})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print what imports what, and what to import instead."""
        for importer, imported in check.metadata["imports"]:
            face = _package_of(imported, set(cast("list[str]", self.groups)))
            output.print_error(f"{importer} -> {imported}: import the name from {face} instead.")


def _package_of(module: str, groups: set[str]) -> str:
    """Return the package of the engine that `module` is in: below a group, the one in the group."""
    parts = module.split(".")
    return ".".join(parts[: _DEPTH + (len(parts) >= _DEPTH and parts[_DEPTH - 1] in groups)])


def _is_inside_a_package(module: str, groups: set[str]) -> bool:
    return module.startswith("gaussian_heritage.engine.") and module != _package_of(module, groups)
