"""Drop files on a window as a file manager does, by the XDND protocol: ``python3 drop.py X Y FILE...``.

Runs beside the window, see window.sh; needs python-xlib.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from Xlib import X, display
from Xlib.protocol import event

_VERSION = 5
_PATIENCE = 60.0
"""Seconds to wait for an answer."""


def main() -> int:
    """Drop the files; return 1 when the window does not take them."""
    x, y, files = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    screen = display.Display()
    root = screen.screen().root
    target = _aware_window(screen, root, x, y)
    if target is None:
        print("no window there takes files", file=sys.stderr)
        return 1
    source = root.create_window(0, 0, 1, 1, 0, X.CopyFromParent)
    source.set_selection_owner(screen.intern_atom("XdndSelection"), X.CurrentTime)
    uri_list, copy = screen.intern_atom("text/uri-list"), screen.intern_atom("XdndActionCopy")

    def send(kind: str, *data: int) -> None:
        words = [source.id, *data, 0, 0, 0, 0][:5]
        message = event.ClientMessage(window=target, client_type=screen.intern_atom(kind), data=(32, words))
        target.send_event(message)
        screen.flush()

    send("XdndEnter", _VERSION << 24, uri_list)
    send("XdndPosition", 0, x << 16 | y, X.CurrentTime, copy)
    text = "".join(f"{Path(file).as_uri()}\r\n" for file in files).encode()
    dropped, end = False, time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        if not screen.pending_events():
            time.sleep(0.05)
            continue
        found = screen.next_event()
        if found.type == X.SelectionRequest:
            found.requestor.change_property(found.property, found.target, 8, text)
            found.requestor.send_event(
                event.SelectionNotify(
                    time=found.time, requestor=found.requestor, selection=found.selection, target=found.target,
                    property=found.property,
                )
            )  # fmt: skip
            screen.flush()
        elif found.type == X.ClientMessage and found.client_type == screen.intern_atom("XdndStatus") and not dropped:
            dropped = True
            send("XdndDrop", 0, X.CurrentTime)
        elif found.type == X.ClientMessage and found.client_type == screen.intern_atom("XdndFinished"):
            return 0
    print("the window did not take the files", file=sys.stderr)
    return 1


def _aware_window(screen: display.Display, window: Any, x: int, y: int) -> Any:
    """Return the innermost window at a position of the screen that takes dropped files; None for none."""
    aware, kind, root = None, screen.intern_atom("XdndAware"), screen.screen().root
    while window:
        if window.get_full_property(kind, X.AnyPropertyType):
            aware = window
        window = window.translate_coords(root, x, y).child
    return aware


if __name__ == "__main__":
    sys.exit(main())
