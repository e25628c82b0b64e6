"""A contract type of our own for import-linter: packages are imported through their public face.

Read by ``lint-imports``, which `check_contracts` starts with this folder on its path.
"""

from __future__ import annotations

from typing import cast

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output

__all__ = ["PublicFacesContract"]

_DEPTH = 3
"""Parts of the name of a package of the engine: ``gaussian_heritage.engine.cameras``."""


class PublicFacesContract(Contract):
    """No module imports past the ``__init__.py`` of another package of the engine.

    Options
    -------
    public_modules : names of modules that may be imported directly, ``settings`` say
    """

    type_name = "public_faces"

    public_modules = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Find every import of a module inside of another package."""
        public = set(cast("list[str]", self.public_modules))
        past_the_face = [
            (importer, imported)
            for imported in sorted(graph.modules)
            if _is_inside_a_package(imported) and imported.rpartition(".")[2] not in public
            for importer in sorted(graph.find_modules_that_directly_import(imported))
            if _package_of(importer) != _package_of(imported)
        ]
        return ContractCheck(kept=not past_the_face, metadata={"imports": past_the_face})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print what imports what, and what to import instead."""
        for importer, imported in check.metadata["imports"]:
            output.print_error(f"{importer} -> {imported}: import the name from {_package_of(imported)} instead.")


def _package_of(module: str) -> str:
    return ".".join(module.split(".")[:_DEPTH])


def _is_inside_a_package(module: str) -> bool:
    return module.startswith("gaussian_heritage.engine.") and module.count(".") >= _DEPTH
