"""``batch``: many photo folders, on the workers of this computer or of a Dask cluster."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import Cancelled, EnvironmentProblem, SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...core.files import write_file, write_json
from ...core.words import join_texts, split_list
from ...pipeline.stages import STAGES
from .scene_options import add_device_option, add_no_objects_option, add_preset_option, add_prompts_option, prompts_of

NAME = "batch"
HELP = "Reconstruct many photo folders, on this computer or a Dask cluster; run again, it continues."
EXAMPLE = "python -m engine batch scans/* --out scenes --scheduler tcp://head:8786"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("folders", type=Path, nargs="+", help="folders with the photos of one scene each")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the projects, named as the photo folders, and of the summary"
    )
    add_prompts_option(parser, "objects to isolate in every scene")
    add_preset_option(parser)
    add_device_option(parser)
    add_no_objects_option(parser)
    parser.add_argument(
        "--scheduler", default="", metavar="ADDRESS", help="Dask scheduler, e.g. tcp://head:8786; without: workers here"
    )
    parser.add_argument("--workers", type=int, default=0, help="workers on this computer; 0: by its cores and memory")
    parser.add_argument("--threads", type=int, default=0, help="cores of each worker on this computer; 0: all shared")
    parser.add_argument(
        "--ship", action="store_true", help="send the photos to the workers and get the results back: no shared folders"
    )
    parser.add_argument(
        "--gpu-stages", default="", help='stages that reserve the worker resource GPU, e.g. "training" (default: none)'
    )
    parser.add_argument(
        "--tries", type=int, default=3, help="tries of a stage when workers fail (default: %(default)s)"
    )


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the batch, write the summary, and return 0 if all folders are done."""
    try:
        from ...workers.batch import BatchSettings, run_batch, summary_as_dict, summary_page, summary_text
    except ModuleNotFoundError as error:
        raise EnvironmentProblem(
            f"The package {error.name} is missing, which only `batch` needs. Install requirements/batch.txt with pip."
        ) from error
    gpu_stages = tuple(split_list(options.gpu_stages))
    unknown = [stage for stage in gpu_stages if stage not in STAGES]
    if unknown:
        raise SettingsError(f"--gpu-stages names {unknown[0]!r}. The stages are {', '.join(STAGES)}.")
    prompts = prompts_of(options)
    arguments = [f"--preset={options.preset}"]
    arguments += [f"--device={options.device}"] if options.device != "auto" else []
    arguments += ["--no-objects"] if options.no_objects else []
    arguments += [f"--prompts={join_texts(prompts)}"] if prompts else []
    settings = BatchSettings(
        out=options.out, arguments=tuple(arguments), scheduler=options.scheduler, workers=options.workers,
        threads=options.threads, ship=options.ship, gpu_stages=gpu_stages, tries=options.tries,
    )  # fmt: skip
    result = run_batch(options.folders, settings, emit=emit, should_stop=should_stop)
    summary = summary_as_dict(result.folders, result.notes, result.seconds)
    options.out.mkdir(parents=True, exist_ok=True)
    write_json(options.out / "batch.json", summary)
    write_file(options.out / "batch.html", summary_page(result.folders, result.notes, result.seconds))
    files = {"summary": str(options.out / "batch.json"), "page": str(options.out / "batch.html")}
    emit(Finished(summary_text(result.folders, result.notes), {**files, "states": summary["states"]}))
    if result.succeeded:
        return 0
    return Cancelled.exit_code if summary["states"]["stopped"] else 1
