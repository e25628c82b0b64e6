"""Build the container image and use it as a museum would: ``make container-test``; writes docs/container.md.

No registry of images is needed: debootstrap makes the base image from the Debian mirror of this computer, buildah
builds on it. Needs root, Debian, debootstrap and buildah, 12 GB of disk and 10 minutes. The settings of pip and npm on
this computer are mounted during the build and are not in the image.

example: python scripts/container_test.py --work /tmp/container --doc docs/container.md
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from places import ROOT

BASE, IMAGE = "localhost/gaussian-heritage-base", "localhost/gaussian-heritage-test"
USER = 10001
PORT = 8765
PHOTOS = sorted((ROOT / "demo" / "museum_room" / "photos").glob("*.jpg"))[::4]
WORD = "vase"
MAX_IMAGE_GB, MAX_START_SECONDS, MAX_STOP_SECONDS = 2.5, 3.0, 45.0
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
REACHED = {"SIGKILL": "0.86", "SIGTERM": "0.4"}
"""Part of the training after which the container is ended: `preview` saves at step 500 of 600 and when stopped."""
MARK = "## Measured\n"


class Failed(Exception):
    """Something that is not as it should be, as a sentence."""


def run(*words: object, **options: Any) -> str:
    """Run a program and return what it prints."""
    command = [str(word) for word in words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    if done.returncode:
        raise Failed(f"{' '.join(command)[:300]}: {done.stdout[-1500:]}{done.stderr[-1500:]}")
    return done.stdout.strip()


def say(line: str) -> None:
    """Print a step at once."""
    print(line, flush=True)


# ---- the image


def make_base(work: Path) -> None:
    """Make an image with Debian and Python 3.11 from the mirror that apt uses."""
    if BASE in run("buildah", "images", "--format", "{{.Name}}").splitlines():
        return
    release = dict(line.partition("=")[::2] for line in Path("/etc/os-release").read_text().splitlines())
    name = release["VERSION_CODENAME"]
    uris = run("apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages", f"Codename: {name}")
    if not uris:
        raise Failed("apt knows no index of this Debian: run `apt-get update` first")
    folder = work / "base"
    shutil.rmtree(folder, ignore_errors=True)
    packages = "python3,python3-venv,ca-certificates"
    run("debootstrap", "--variant=minbase", f"--include={packages}", name, folder, uris.splitlines()[0])
    run("chroot", folder, "apt-get", "clean")
    container = run("buildah", "from", "scratch")
    run("buildah", "add", "--quiet", container, folder, "/")
    run("buildah", "commit", "--quiet", "--rm", container, BASE)
    shutil.rmtree(folder)


def host_settings(work: Path) -> list[str]:
    """Return options that show the build how this computer reaches packages: settings of pip and npm, certificates."""
    settings = [line.partition("=") for line in run(sys.executable, "-m", "pip", "config", "list").splitlines()]
    lines: dict[str, str] = {}
    for name, _, value in settings:
        lines[name.rpartition(".")[2]] = " ".join(value.strip("'").split("\\n"))
    pip = work / "pip.conf"
    pip.write_text("[global]\n" + "".join(f"{name} = {value.strip()}\n" for name, value in lines.items()))
    mounts = {Path("/etc/pip.conf"): pip}
    npm = work / "npmrc"
    files = [file for file in (Path("/etc/npmrc"), Path.home() / ".npmrc") if file.is_file()]
    npm.write_text("\n".join(file.read_text() for file in files) + "\n")
    mounts[Path("/root", ".npmrc")] = npm
    if CERTIFICATES.is_file():
        mounts[CERTIFICATES] = CERTIFICATES
    # Files, and folders with packages, which the settings may name. An index of links leads to files beside it.
    for word in " ".join(lines.values()).split():
        path = Path(word.removeprefix("file://"))
        path = path.parent if path.name == "simple" else path
        if path.is_absolute() and path.exists():
            mounts[path] = path
    return [f"--volume={source}:{target}:ro" for target, source in mounts.items()]


def build(work: Path) -> float:
    """Build the image and return the seconds."""
    begin = time.monotonic()
    command = ["buildah", "bud", "--isolation", "chroot", "--format", "docker", "--build-arg", f"BASE={BASE}"]
    command += ["--ignorefile", str(ROOT / ".containerignore"), "--tag", IMAGE, *host_settings(work), str(ROOT)]
    with (work / "build.log").open("w") as log:
        if subprocess.run(command, stdout=log, stderr=log, check=False).returncode:
            raise Failed(f"the build failed: see {log.name}")
    return time.monotonic() - begin


def image_config() -> dict[str, Any]:
    """Return the settings of the image."""
    config: dict[str, Any] = json.loads(run("buildah", "inspect", "--type", "image", IMAGE))["Docker"]["config"]
    return config


def check_image(root: Path, config: dict[str, Any]) -> dict[str, Any]:
    """Look at the image without running it, and return its figures."""
    if config["User"] != f"{USER}:{USER}" or list(config["Volumes"]) != ["/data"]:
        raise Failed("the image has another user or other volumes")
    if "serve" not in config["Healthcheck"]["Test"] or config["StopSignal"] != "SIGTERM":
        raise Failed("the image has no health check or another signal to stop")
    stays = [name for name in ("etc/pip.conf", "root/.npmrc", "etc/xdg/pip", "build") if (root / name).exists()]
    tools = [name for name in ("node", "npm", "gcc", "pip") if (root / "opt/heritage/engine/env/bin" / name).exists()]
    if stays or tools:
        raise Failed(f"the image contains what only the build needs: {stays + tools}")
    names = {line.partition("=")[0] for line in config["Env"]}
    if names & {"PIP_INDEX_URL", "PIP_CERT", "HTTPS_PROXY", "https_proxy", "NODE_EXTRA_CA_CERTS"}:
        raise Failed("settings of this computer are in the image")
    writable = [
        path for path in (root / "opt").rglob("*") if not path.is_symlink() and path.lstat().st_uid != 0
    ]  # fmt: skip
    if writable:
        raise Failed(f"the user of the image owns {writable[0]}")
    sbom = json.loads((root / "opt/heritage/sbom.cdx.json").read_text())
    kinds = Counter((one.get("purl") or one["type"]).partition("/")[0] for one in sbom["components"])
    size = sum(path.lstat().st_size for path in root.rglob("*") if not path.is_dir() or path.is_symlink())
    parts = {"packages of Python and torch": "opt/heritage/engine", "model files": "opt/heritage/cache"}
    return {
        "bytes": size, "kinds": kinds, "licences": (root / "opt/heritage/licences.txt").stat().st_size,
        "parts": {name: folder_bytes(root / part) for name, part in parts.items()},
    }  # fmt: skip


def folder_bytes(folder: Path) -> int:
    """Return the size of all files below a folder."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


# ---- containers


class Container:
    """The image, running with a data folder. Subclasses say how it is started."""

    how = ""

    def __init__(self, work: Path, root: Path, name: str, config: dict[str, Any]) -> None:
        self.work, self.root, self.name, self.config = work, root, name, config
        self.data = work / f"data of {type(self).__name__}"
        self.log = work / f"{type(self).__name__}.log"
        self.token = ""
        self.port = PORT
        self._process: subprocess.Popen[bytes] | None = None
        shutil.rmtree(self.data, ignore_errors=True)
        self.log.unlink(missing_ok=True)
        self.data.mkdir()
        os.chown(self.data, USER, USER)

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command line that runs `words` in the container."""
        raise NotImplementedError

    def start(self) -> float:
        """Start the server and return the seconds until it answers."""
        words = [*self.config["Entrypoint"], *self.config["Cmd"], "--port", str(self.port)]
        begin = time.monotonic()
        # unshare: its end ends every process in the container, as the end of a real one does.
        command = ["unshare", *self.namespaces, "--pid", "--fork", "--kill-child", *self.command(words)]
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        self.client("wait-for-server")
        seconds = time.monotonic() - begin
        if found := re.search(r"shown only now: (\S+)", self.log.read_text(errors="replace")):
            self.token = found[1]
        return seconds

    namespaces: Sequence[str] = ()

    @property
    def first(self) -> int:
        """The first process of the container."""
        assert self._process is not None
        deadline = time.monotonic() + 10
        while time.monotonic() < deadline:
            if found := children(self._process.pid):
                return found[0]
            time.sleep(0.005)
        raise Failed(f"the container did not start: see {self.log}")

    def kill(self) -> None:
        """Kill all processes of the container at once."""
        if self._process is not None and self._process.poll() is None:
            os.kill(self.first, signal.SIGKILL)
            self._process.wait(30)

    def stop(self) -> float:
        """Stop the server by SIGTERM, as podman and Docker do, and return the seconds until its end."""
        assert self._process is not None
        begin = time.monotonic()
        os.kill(self.server(), signal.SIGTERM)
        self._process.wait(MAX_STOP_SECONDS + 30)
        return time.monotonic() - begin

    def server(self) -> int:
        """Return the process of the server."""
        waiting = [self.first]
        while waiting:
            number = waiting.pop()
            words = Path(f"/proc/{number}/cmdline").read_bytes().split(b"\0")
            if words[1:4] == [b"-m", b"engine", b"serve"]:
                return number
            waiting += children(number)
        raise Failed("the server does not run")

    def client(self, *words: object) -> Any:
        """Run a command of the client, in the network of the container."""
        command = [sys.executable, ROOT / "scripts/container/client.py", "--data", self.data, "--port", self.port]
        return json.loads(run(*self.entering(), *command, "--token", self.token, *words))

    def entering(self) -> list[object]:
        """Return the program that runs a command in the network of the container."""
        return []

    def events(self, project: str) -> list[list[dict[str, Any]]]:
        """Return the events of each job of a project, the oldest first."""
        folder = self.data / "users/curator/projects" / project / "jobs"
        return [
            [json.loads(line) for line in file.read_text().splitlines() if line.endswith("}")]
            for file in sorted(folder.glob("*/events.jsonl"))
        ]


def children(number: int) -> list[int]:
    """Return the processes that a process has started."""
    found = []
    # Of each thread: programs in Go start others from any of theirs.
    for file in Path("/proc").glob(f"{number}/task/*/children"):
        with contextlib.suppress(OSError):
            found += [int(word) for word in file.read_text().split()]
    return found


class ByBuildah(Container):
    """``buildah run``: the container's files and user, but the network of this computer and a writable root."""

    how = "`buildah run --isolation chroot`"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command line that runs `words` in the container."""
        options = ["--isolation", "chroot", f"--volume={self.data}:/data"]
        return ["buildah", "run", *options, self.name, "--", *words]


class InNamespaces(Container):
    """Namespaces of our own: no network, a read-only root, no capabilities, and the server as process 1."""

    how = "`unshare` and `chroot`"
    namespaces = ("--mount", "--net")

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command line that runs `words` in the container."""
        script = """set -e
root=$1; data=$2; shift 2
mount --make-rprivate /
mount --bind "$root" "$root"
mount -o remount,bind,ro "$root"
mount -t tmpfs -o noexec,nosuid,nodev,size=1g tmpfs "$root/tmp"
mount --bind "$data" "$root/data"
mount --rbind /dev "$root/dev"
mount -t proc proc "$root/proc"
ip link set lo up
exec setpriv --no-new-privs chroot --userspec="$1:$1" --groups= "$root" /usr/bin/env -i -C /data "${@:2}"
"""
        arguments = [str(self.root), str(self.data), str(USER), *self.config["Env"], *words]
        return ["bash", "-c", script, "container", *arguments]

    def entering(self) -> list[object]:
        """Return the program that runs a command in the network of the container."""
        # While it starts, the process is still in the network of this computer.
        outside = os.readlink("/proc/self/ns/net")
        while os.readlink(f"/proc/{self.first}/ns/net") == outside:
            time.sleep(0.005)
        return ["nsenter", f"--net=/proc/{self.first}/ns/net"]

    def check_isolation(self) -> list[str]:
        """Check what the server may do, and return it as sentences."""
        server = self.server()
        status = dict(re.findall(r"^(\w+):\t(.*)$", Path(f"/proc/{server}/status").read_text(), re.MULTILINE))
        if status["NSpid"].split()[-1] != "1":
            raise Failed("the server is not process 1")
        if set(status["Uid"].split()) != {str(USER)} or int(status["CapEff"], 16) or status["NoNewPrivs"] != "1":
            raise Failed(f"the server may do too much: {status}")
        enter = ["nsenter", "-t", server, "--mount", "--net", "--pid", f"--root=/proc/{server}/root"]
        probe = (
            "import socket, sys\n"
            "for path in ('/opt/heritage/x', '/etc/x', '/x', '/usr/x'):\n"
            "    try: open(path, 'w'); sys.exit(path + ' is writable')\n"
            "    except OSError as error: assert error.errno == 30, error\n"
            "open('/data/x', 'w').close(); open('/tmp/x', 'w').close()\n"
            "try: socket.create_connection(('192.0.2.1', 443), 3); sys.exit('there is a network')\n"
            "except OSError as error: print(error.strerror)\n"
        )
        answer = run(*enter, "/usr/bin/python3", "-c", probe)
        (self.data / "x").unlink()
        return [
            "the server is process 1, runs as user 10001, without capabilities and with `no_new_privs`",
            "`/`, `/etc`, `/usr` and `/opt/heritage` are read-only, even for root; `/data` and `/tmp` (no programs) "
            "are writable",
            f'the network has only its loopback: a connection elsewhere fails ("{answer}")',
        ]


# ---- the steps


def check_glb(file: Path) -> str:
    """Check the header and the Gaussians of a GLB file, and return its description."""
    content = file.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    n_json, kind = struct.unpack_from("<I4s", content, 12)
    if (magic, version, length, kind) != (b"glTF", 2, len(content), b"JSON"):
        raise Failed(f"{file} is no GLB")
    document = json.loads(content[20 : 20 + n_json])
    if "KHR_gaussian_splatting" not in document.get("extensionsUsed", ()):
        raise Failed(f"{file} contains no Gaussians")
    primitive = document["meshes"][0]["primitives"][0]
    n_gaussians = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
    return f"GLB of {len(content) / 1e6:.2f} MB with {n_gaussians:,} Gaussians"


def whole_way(container: Container, end: str) -> dict[str, Any]:
    """Upload, reconstruct, end the container in the middle, start it again, isolate and download."""
    figures: dict[str, Any] = {"start": container.start()}
    say(f"  health after {figures['start']:.1f} s")
    if isinstance(container, InNamespaces):
        figures["isolation"] = container.check_isolation()
    check_health(container)
    project = container.client("upload", *PHOTOS)
    say(f"  {len(PHOTOS)} photos uploaded")
    begin = time.monotonic()
    container.client("start", project, json.dumps({"kind": "reconstruct", "preset": "preview"}))
    reached = container.client("wait-for-job", project, "--stage", "training", "--fraction", REACHED[end])
    if reached["job"]["state"] == "finished":
        raise Failed("the job ended before it could be interrupted")
    figures["before"] = time.monotonic() - begin
    if end == "SIGKILL":
        container.kill()
        figures["stop"] = 0.0
    else:
        figures["stop"] = container.stop()
        told = [event["error"] for event in container.events(project)[0] if event["kind"] == "error"]
        if told != ["Cancelled"] or figures["stop"] > MAX_STOP_SECONDS:
            raise Failed(f"the job did not end tidily: {told}, after {figures['stop']:.0f} s")
    say(f"  ended by {end} in training, after {figures['before']:.0f} s")
    figures["again"] = container.start()
    begin = time.monotonic()
    container.client("wait-for-job", project)
    figures["after"] = time.monotonic() - begin
    first, second = container.events(project)
    reused = {event["stage"] for event in second if event["kind"] == "stage_finished" and event.get("reused")}
    checkpoint = any("continued from a checkpoint" in event.get("message", "") for event in second)
    if not {"photos", "cameras"} <= reused or not checkpoint:
        raise Failed(f"the job began anew: reused {reused}, checkpoint {checkpoint}")
    figures["continued"] = f"reused {', '.join(sorted(reused))}; training from its checkpoint"
    say(f"  continued by itself and finished after {figures['after']:.0f} s more: {figures['continued']}")
    begin = time.monotonic()
    container.client("start", project, json.dumps({"kind": "segment", "prompt": WORD}))
    objects = container.client("wait-for-job", project)["objects"]
    figures["word"] = time.monotonic() - begin
    if [one["name"] for one in objects] != [WORD]:
        raise Failed(f"{WORD} was not isolated: {objects}")
    out = container.work / f"{type(container).__name__}.glb"
    container.client("download", project, objects[0]["id"], out)
    figures["glb"] = check_glb(out)
    say(f"  {WORD}: {figures['glb']} after {figures['word']:.0f} s")
    figures["end"] = container.stop()
    return figures


def check_health(container: Container) -> None:
    """Run the health check of the image in the container."""
    check = [*container.config["Healthcheck"]["Test"][1:], "--port", str(container.port)]
    if isinstance(container, ByBuildah):
        run(*container.command(check))
    else:
        server = container.server()
        words = ["chroot", f"--userspec={USER}:{USER}", f"/proc/{server}/root", "/usr/bin/env", "-i"]
        run("nsenter", "-t", server, "--net", "--pid", *words, *container.config["Env"], *check)
    say("  the health check of the image succeeds")


def report(seconds: float, image: dict[str, Any], passes: list[tuple[Container, str, dict[str, Any]]]) -> str:
    """Return what was measured, as a section of docs/container.md."""
    kinds = image["kinds"]
    lines = [
        "```\nmake container-test\n```", "",
        f"On a machine with {os.cpu_count()} shared cores, with {run('buildah', '--version').partition(' (')[0]}. "
        "Base: Debian 12 by debootstrap, with Python 3.11.", "",
        "| image | measured | wanted |", "| --- | ---: | ---: |",
        f"| size unpacked | {image['bytes'] / 1e9:.2f} GB | {MAX_IMAGE_GB} GB at most |",
        *(f"| of which {name} | {size / 1e9:.2f} GB | |" for name, size in image["parts"].items()),
        f"| time to build | {seconds:.0f} s | |",
        f"| SBOM: packages of Debian, of Python, of npm; model files | {kinds['pkg:deb']}, {kinds['pkg:pypi']}, "
        f"{kinds['pkg:npm']}; {kinds['machine-learning-model']} | |",
        f"| texts of licences | {image['licences'] / 1e6:.1f} MB | |", "",
        "| | " + " | ".join(container.how for container, _, _ in passes) + " |",
        "| --- |" + " ---: |" * len(passes),
    ]  # fmt: skip
    columns = [figures for _, _, figures in passes]

    def row(name: str, values: Sequence[str]) -> None:
        lines.append(f"| {name} | " + " | ".join(values) + " |")

    row("cold start to health (3 s at most)", [f"{one['start']:.1f} s" for one in columns])
    row(
        f"{len(PHOTOS)} photos uploaded; `preview` until it is ended in training",
        [f"{one['before']:.0f} s" for one in columns],
    )
    row("then ended by", [end for _, end, _ in passes])
    row("until the end", [f"{one['stop']:.1f} s" if one["stop"] else "at once" for one in columns])
    row("start again to health", [f"{one['again']:.1f} s" for one in columns])
    row("the job continued by itself and finished after", [f"{one['after']:.0f} s" for one in columns])
    row("of the first run", [one["continued"] for one in columns])
    row(f'the word "{WORD}" isolated', [f"{one['word']:.0f} s" for one in columns])
    row("downloaded", [one["glb"] for one in columns])
    row("stopped by SIGTERM without a job", [f"{one['end']:.1f} s" for one in columns])
    lines += ["", "In namespaces of its own, asserted:", ""]
    lines += [f"- {sentence};" for one in columns for sentence in one.get("isolation", ())]
    lines[-1] = lines[-1].removesuffix(";") + "."
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run all steps and return 0, or print what failed and return 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("/tmp/gaussian_heritage_container"), help="(%(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="file for what was measured")
    parser.add_argument("--keep", action="store_true", help="use the image of the last run, and keep it")
    options = parser.parse_args()
    missing = [name for name in ("buildah", "debootstrap", "unshare", "setpriv") if shutil.which(name) is None]
    if os.geteuid() != 0 or missing:
        print(f"The container test needs root and {', '.join(missing)} (see docs/container.md).", file=sys.stderr)
        return 1
    work = options.work.absolute()
    work.mkdir(parents=True, exist_ok=True)
    try:
        say("base image")
        make_base(work)
        seconds_file = work / "build_seconds.txt"
        if not options.keep or not seconds_file.exists():
            say("build")
            seconds_file.write_text(str(build(work)))
        name = run("buildah", "from", "--pull-never", IMAGE)
        root = Path(run("buildah", "mount", name))
        passes: list[tuple[Container, str, dict[str, Any]]] = []
        try:
            config = image_config()
            # buildah would put a new volume over the folder that is mounted there.
            run("buildah", "config", "--volume", "/data-", name)
            image = check_image(root, config)
            say(f"  {image['bytes'] / 1e9:.2f} GB unpacked")
            for kind, end in ((ByBuildah, "SIGKILL"), (InNamespaces, "SIGTERM")):
                say(f"{kind.how}, ended by {end}")
                container = kind(work, root, name, config)
                try:
                    passes.append((container, end, whole_way(container, end)))
                finally:
                    container.kill()
        finally:
            run("buildah", "rm", name)
        text = report(float(seconds_file.read_text()), image, passes)
        print(text)
        if options.doc:
            head = options.doc.read_text(encoding="utf-8").partition(MARK)[0]
            options.doc.write_text(f"{head}{MARK}\n{text}", encoding="utf-8")
        if image["bytes"] > MAX_IMAGE_GB * 1e9 or any(one["start"] > MAX_START_SECONDS for _, _, one in passes):
            raise Failed("the image is larger, or starts more slowly, than wanted")
    except Failed as failure:
        print(f"Failed: {failure}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
