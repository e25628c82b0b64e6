"""Checks what the tests on Windows' Python rely on, and says what is not so. Runs on Windows' Python.

python computer_check.py USER CODE_PAGE MAX_PATH
"""

import ctypes
import errno
import getpass
import locale
import msvcrt
import os
import subprocess
import sys
import tempfile


def write_long(folder: str, length: int) -> bool:
    """Return whether a file whose path has `length` characters can be written, and looked at."""
    name = os.path.join(folder, "x" * (length - len(folder) - 1))
    try:
        with open(name, "w") as stream:
            stream.write("x")
    except OSError as error:
        if not isinstance(error, FileNotFoundError) or os.path.exists(name):
            raise
        return False
    return os.path.exists(name)


def error_of_a_locked_file(name: str) -> int:
    """Return the number of the error for bytes that another process has locked."""
    program = (
        "import msvcrt, sys, time; f = open(sys.argv[1], 'r+b'); msvcrt.locking(f.fileno(), msvcrt.LK_NBLCK, 1);"
        "print('locked', flush=True); time.sleep(60)"
    )
    with open(name, "wb") as stream:
        stream.write(b"x")
    with subprocess.Popen([sys.executable, "-c", program, name], stdout=subprocess.PIPE) as holder:
        try:
            assert holder.stdout is not None
            holder.stdout.readline()
            with open(name, "r+b") as stream:
                msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError as error:
            return error.errno or 0
        finally:
            holder.kill()
    return 0


def main() -> int:
    """Check all, and say what is not so."""
    user, code_page, max_path = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    with tempfile.TemporaryDirectory() as name:
        folder = os.path.join(name, "y" * 40, "z" * 40)
        os.makedirs(folder)
        if sys.argv[4:] == ["child"]:
            return 0 if write_long(folder, max_path - 1) and not write_long(folder, max_path) else 1
        child = [sys.executable, "-I", __file__, *sys.argv[1:4], "child"]
        facts = {
            f"user {ascii(getpass.getuser())}": getpass.getuser() == user,
            "home": os.path.expanduser("~").endswith(user) and user in tempfile.gettempdir(),
            "system": sys.platform == "win32" and os.sep == "\\",
            "processors": bool(os.cpu_count()),
            "code page": ctypes.windll.kernel32.GetACP() == code_page,  # type: ignore[attr-defined]
            "code page of Python": locale.getpreferredencoding(False) in (f"cp{code_page}", "gbk"),
            "lock of another process": error_of_a_locked_file(os.path.join(name, "locked")) == errno.EACCES,
            "path as long as allowed": write_long(folder, max_path - 1),
            "path that is too long": not write_long(folder, max_path),
            "path that is too long, in a child process": subprocess.run(child, check=False).returncode == 0,
        }
    wrong = [name for name, holds in facts.items() if not holds]
    if wrong:
        print(f"not as expected: {', '.join(wrong)}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
