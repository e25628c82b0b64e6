"""Files: the only code of the engine that turns stored names into paths, and reads, writes and deletes files.

Standard library and NumPy only, because Blender reads project folders too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .arrays import ArraySpec, read_array, read_arrays
    from .deleting import delete_derived
    from .kept_arrays import keep_arrays, read_kept_arrays
    from .paths import (
        derived_name,
        is_inner_name,
        object_file,
        path_within,
        problem_of_inner_name,
        require_no_links_out,
    )
    from .reading import mapped, opened, parse_json, read_bytes, read_json, read_text
    from .recorded import FILE_RECORD, FileRecord, is_as_recorded, record_of
    from .remembered import read_after_change, stamp_of
    from .replacing import finish_replacements, replace_together
    from .schema import Schema, check, optional
    from .scratch import ScratchFile
    from .sizes import bytes_of
    from .stored_package import StoredPackage, opened_package, write_zip
    from .versions import read_versioned
    from .writing import (
        TEMPORARY_PREFIX,
        atomic_write,
        file_sha256,
        finite_or_null,
        write_file,
        write_json,
        write_problem,
    )

__getattr__ = lazy_exports(__name__, __file__)
