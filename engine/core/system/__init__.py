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

__all__ = [
    "CORES_VARIABLE",
    "CODE_ROOT",
    "STOP_VARIABLE",
    "SYSTEMS",
    "Machine",
    "PeakMemory",
    "StopOnSignal",
    "System",
    "advice_for",
    "card_memory",
    "change_time_ns",
    "cpu_seconds",
    "cpu_seconds_limited",
    "delete_file",
    "delete_tree",
    "describe_machine",
    "describe_system",
    "end_children_with_this_process",
    "end_with_parent",
    "engine_folder",
    "exit_cause",
    "free_memory",
    "handlers_kept",
    "given_cores",
    "has_nvidia_driver",
    "ignore_signals_of_the_terminal",
    "is_cheap_to_recognise",
    "json_printable",
    "kill_group",
    "kill_recognised",
    "killed_for_memory",
    "killed_for_time",
    "library_folder",
    "limit_memory",
    "lower_priority",
    "memory_limited",
    "missing_runtime",
    "name_in_order",
    "native_path",
    "no_core_dumps",
    "no_window",
    "npm_settings_files",
    "own_group",
    "package_system",
    "peak_memory",
    "printable",
    "process_runs",
    "program_in",
    "python_advice",
    "python_in",
    "replace_file",
    "request_stop",
    "run_text",
    "signals_held_back",
    "start_time",
    "takes_path",
    "this_system",
    "total_memory",
    "try_lock",
    "unsupported",
    "usable_cores",
    "use_cores",
    "use_given_cores",
    "variable_for_libraries",
    "wall_seconds_limited",
    "with_utf8",
]

__getattr__ = lazy_exports(__name__, __file__)
