"""Other programs read our files, and we read theirs: the largest differences of what they hold."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from engine.core.errors import EnvironmentProblem
from engine.formats import (
    FileFacts,
    file_from_z_up,
    read_glb,
    read_ksplat,
    read_ply,
    read_ply_file,
    read_sog,
    read_splat,
    read_spz,
    transform_gaussians,
    write_glb,
    write_ply,
    write_sog,
    write_spz,
    write_usd,
)
from engine.pictures import decode_picture, encode_picture
from engine.scene import Gaussians, rotations_from_quats

HERE = Path(__file__).resolve().parent
NODE_MODULES = HERE / "node_modules"
PROGRAM = NODE_MODULES / "@playcanvas" / "splat-transform" / "bin" / "cli.mjs"
Row = tuple[str, str, str]


def require_node_modules() -> None:
    """Install the programs of package-lock.json unless they are there.

    Raises
    ------
    EnvironmentProblem
        When npm is missing or fails.
    """
    wanted = json.loads((HERE / "package.json").read_text(encoding="utf-8"))["dependencies"]
    if all((NODE_MODULES / name / "package.json").is_file() for name in wanted):
        return
    npm = shutil.which("npm")
    if npm is None:
        raise EnvironmentProblem("npm is missing. Install Node.js 20 or newer.")
    done = subprocess.run([npm, "ci", "--ignore-scripts"], cwd=HERE, check=False)
    if done.returncode:
        raise EnvironmentProblem("npm could not install the readers; its message is above.")


def splat_transform(*words: object) -> None:
    """Run splat-transform.

    Raises
    ------
    EnvironmentProblem
        When it fails.
    """
    command = ["node", str(PROGRAM), "-q", "-w", *map(str, words)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise EnvironmentProblem(f"splat-transform failed: {done.stderr.strip()[:300]}")


def reader_rows(gaussians: Gaussians, folder: Path) -> list[Row]:
    """Return what was read, by what program, and the largest difference."""
    import gsply
    from plyfile import PlyData

    seen = np.arange(len(gaussians)) % 50
    ply, glb, spz, usd = (folder / f"a.{suffix}" for suffix in ("ply", "glb", "spz", "usdc"))
    write_ply(ply, gaussians, up="-y", comments=["title Ölkanne"], extra={"photos_seen": seen})
    write_glb(glb, gaussians, FileFacts(extras={"title": "Ölkanne"}, seen=seen))
    write_spz(spz, gaussians)
    write_usd(usd, gaussians, FileFacts(seen=seen))
    stored = read_ply_file(ply).gaussians
    rows = [("PLY", "gsply", _difference(_of_gsply(gsply.plyread(str(ply))), stored))]
    table = PlyData.read(str(ply))["vertex"]
    same = np.array_equal(np.stack([table[axis] for axis in "xyz"], axis=1), stored.means)
    same &= np.array_equal(np.asarray(table["photos_seen"]), seen.astype(np.float32))
    rows.append(("PLY", "plyfile", "none" if same else "other values"))
    splat_transform(ply, folder / "again.ply")
    rows.append(("PLY", "splat-transform, written again", _difference(read_ply(folder / "again.ply"), stored)))
    rows.append(("SPZ 3", "gsply", _difference(_of_gsply(gsply.read_spz(str(spz))), _in_file_of(spz))))
    splat_transform(spz, folder / "from_spz.ply")
    expected = transform_gaussians(read_spz(spz), file_from_z_up("-y"))
    rows.append(("SPZ 3", "splat-transform, written as PLY", _difference(read_ply(folder / "from_spz.ply"), expected)))
    rows.append(("USD", "usd-core", _difference(_of_usd(usd), gaussians)))
    splat_transform(ply, folder / "theirs.compressed.ply")
    splat_transform(folder / "theirs.compressed.ply", folder / "theirs.ply")
    ours, theirs = read_ply(folder / "theirs.compressed.ply"), read_ply(folder / "theirs.ply")
    rows.append(("compressed PLY of splat-transform", "ours, beside its own", _difference(ours, theirs)))
    splat_transform("--spz-version", "3", ply, folder / "theirs.spz")
    splat_transform(folder / "theirs.spz", folder / "of_spz.ply")
    ours = transform_gaussians(read_spz(folder / "theirs.spz"), file_from_z_up("-y"))
    rows.append(
        ("SPZ 3 of splat-transform", "ours, beside its own", _difference(ours, read_ply(folder / "of_spz.ply")))
    )
    splat_transform("--spz-version", "4", ply, folder / "theirs_4.spz")
    four, three = read_spz(folder / "theirs_4.spz"), read_spz(folder / "theirs.spz")
    rows.append(("SPZ 4 of splat-transform", "ours, beside its SPZ 3", _difference(four, three)))
    rows += _web_rows(gaussians, ply, folder)
    splat_transform(ply, folder / "theirs.glb")
    # It turns the scene about the vertical axis by 180 degrees, as SuperSplat shows it.
    expected = transform_gaussians(gaussians, np.diag([-1.0, -1.0, 1.0, 1.0]))
    ours = read_glb(folder / "theirs.glb")
    rows.append(("GLB of splat-transform", "ours, beside the PLY, turned as it does", _difference(ours, expected)))
    return rows


def _web_rows(gaussians: Gaussians, ply: Path, folder: Path) -> list[Row]:
    """Return the rows of the formats of the web, whose numbers are in the axes of a PLY."""
    rows = []
    write_sog(folder / "a.sog", gaussians, encode_picture)
    splat_transform("-g", "cpu", ply, folder / "theirs.sog")
    done = subprocess.run(["node", str(HERE / "others.mjs"), str(ply), str(folder)], check=False, capture_output=True)
    if done.returncode:
        raise EnvironmentProblem(f"others.mjs failed: {done.stderr.decode(errors='replace').strip()[-300:]}")
    sog = partial(read_sog, decode=decode_picture)
    files = [("SOG 2", "a.sog", sog), ("SOG 2 of splat-transform", "theirs.sog", sog)]
    files += [(f"KSPLAT of GaussianSplats3D, level {n}", f"level_{n}.ksplat", read_ksplat) for n in (0, 1, 2)]
    for what, name, read in [*files, ("SPLAT of gsplat.js", "gsplat.splat", read_splat)]:
        splat_transform(folder / name, folder / f"{name}.ply")
        ours = transform_gaussians(read(folder / name), file_from_z_up("-y"))
        rows.append((what, "ours, beside splat-transform", _difference(ours, read_ply(folder / f"{name}.ply"))))
    return rows


def _in_file_of(spz: Path) -> Gaussians:
    return transform_gaussians(read_spz(spz), file_from_z_up("y"))


def _of_gsply(data: Any) -> Gaussians:
    sh = np.concatenate([data.sh0[:, None], data.shN], axis=1)
    return Gaussians(data.means, data.scales, data.quats, data.opacities.ravel(), sh.astype(np.float32))


def _of_usd(file: Path) -> Gaussians:
    from pxr import Usd

    stage = Usd.Stage.Open(str(file))  # kept: its prims end with it
    prim = stage.GetDefaultPrim()

    def get(name: str) -> Any:
        return np.array(prim.GetAttribute(name).Get())

    quats = np.array([(one.real, *one.imaginary) for one in prim.GetAttribute("orientations").Get()], np.float32)
    means = get("positions")
    opacities = get("opacities").astype(np.float64)
    return Gaussians(
        means=means,
        log_scales=np.log(get("scales")),
        quats=quats,
        opacity_logits=np.log(opacities / (1 - opacities)).astype(np.float32),
        sh=get("radiance:sphericalHarmonicsCoefficients").reshape(len(means), -1, 3),
    )


def _difference(one: Gaussians, other: Gaussians) -> str:
    """Return the largest difference of positions, relative sizes, opacities, forms and coefficients."""
    if len(one) != len(other) or one.sh.shape != other.sh.shape:
        return f"{len(one)} of {len(other)} Gaussians of degree {one.sh_degree}"
    parts = {
        "positions": np.abs(one.means - other.means).max(),
        "log-scales": np.abs(one.log_scales - other.log_scales).max(),
        "opacities": np.abs(one.opacities - other.opacities).max(),
        "forms": np.abs(_forms(one) - _forms(other)).max(),
        "harmonics": np.abs(one.sh - other.sh).max(),
    }
    worst = max(parts, key=lambda name: float(parts[name]))
    return "none" if parts[worst] == 0 else f"{parts[worst]:.1e} ({worst})"


def _forms(gaussians: Gaussians) -> Any:
    """Return covariances relative to the largest size: opposite axes are the same form."""
    axes = rotations_from_quats(gaussians.quats) * gaussians.scales[:, None, :]
    return axes @ axes.transpose(0, 2, 1) / (gaussians.scales.max(axis=1) ** 2)[:, None, None]
