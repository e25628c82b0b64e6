"""Text from file names, prompts and files as it may be shown: without characters that act on the terminal or the page.

Standard library only.
"""

from __future__ import annotations

import re

_HIDDEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def visible(text: str, *, keep: str = "") -> str:
    """Return `text` with hidden characters, except those in `keep`, as escape sequences, like ``\\x1b``.

    Hidden characters can move the cursor, change colours, begin a line or reverse the direction of reading. Bytes of a
    file name that is not UTF-8 are escaped too, because they can neither be printed nor written.
    """
    return _HIDDEN.sub(lambda found: found[0] if found[0] in keep else found[0].encode("unicode_escape").decode(), text)
