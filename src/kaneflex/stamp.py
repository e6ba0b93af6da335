"""What compiled code is made of, so that a cache of it can't go stale.

numba looks at the caller's file alone: a cached function that calls one of another file would keep the old callee after
that file was edited. A jitted function's default argument is part of the key under which it is cached; with
``made_of=stamp(__file__, ...)`` as its last one, every edit of those files compiles it anew.
"""

import zlib
from pathlib import Path


def stamp(*files: str) -> int:
    """A number for the text of some files."""
    return zlib.crc32(b"".join(Path(file).read_bytes() for file in files))
