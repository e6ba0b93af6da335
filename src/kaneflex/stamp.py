"""What compiled code is made of, so that a cache of it can't go stale.

numba looks at the caller's file alone: a cached function that calls one of another file would keep the old callee after
that file was edited. A jitted function's default argument is part of the key under which it is cached; with
``made_of=stamp(__file__, ...)`` as its last one, every edit of those files compiles it anew. It is a text, for numba
takes all whole numbers that are left out for the first one that it has met in the process, and then finds no loop.
"""

import zlib
from pathlib import Path


def stamp(*files: str) -> str:
    """Eight hexadecimal digits for the text of some files."""
    return f"{zlib.crc32(b''.join(Path(file).read_bytes() for file in files)):08x}"
