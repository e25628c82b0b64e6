"""Differences between Windows, macOS and Linux: a module for each, and nothing of it elsewhere.

Standard library only: Blender and the installation import it too. ``tests/contracts/test_systems.py`` checks that no
other module asks which system it runs on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .distributions import python_advice
    from .kinds import SYSTEMS, System, describe_system, missing_runtime, package_system, this_system, unsupported
    from .limits import (
        cpu_seconds_limited,
        exit_cause,
        ignore_signals_of_the_terminal,
        killed_for_memory,
        killed_for_time,
        limit_memory,
        memory_limited,
        no_core_dumps,
        wall_seconds_limited,
    )
    from .locks import try_lock
    from .machine import (
        CORES_VARIABLE,
        Machine,
        PeakMemory,
        card_memory,
        cpu_seconds,
        describe_machine,
        free_memory,
        given_cores,
        has_nvidia_driver,
        peak_memory,
        total_memory,
        usable_cores,
        use_cores,
        use_given_cores,
    )
    from .paths import (
        CODE_ROOT,
        engine_folder,
        library_folder,
        native_path,
        npm_settings_files,
        program_in,
        python_in,
        takes_path,
    )
    from .processes import (
        end_children_with_this_process,
        end_with_parent,
        is_cheap_to_recognise,
        kill_group,
        kill_recognised,
        lower_priority,
        no_window,
        own_group,
        process_runs,
        start_time,
    )
    from .replacing import advice_for, delete_file, delete_tree, replace_file
    from .signals import handlers_kept, signals_held_back
    from .stopping import STOP_VARIABLE, StopOnSignal, request_stop
    from .text import json_printable, printable, run_text, with_utf8
    from .times import change_time_ns, name_in_order
    from .variables import variable_for_libraries

__getattr__ = lazy_exports(__name__, __file__)
