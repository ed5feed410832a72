"""The private folder where processes of one user that use a bench meet."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from rig.errors import InputError


def runtime_folder() -> Path:
    """``$XDG_RUNTIME_DIR/rig``, or a folder of this user in the system's temporary one; made if need be.

    Nobody else may write there: what it holds stops the bench, and says whether it is homed.

    Raises:
        InputError: it belongs to somebody else, or others may use it.
    """
    base = os.environ.get("XDG_RUNTIME_DIR", "")
    folder = Path(base) / "rig" if base and Path(base).is_dir() else Path(tempfile.gettempdir()) / f"rig-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as failure:
        reason = f"the runtime folder cannot be used ({failure.strerror or failure})"
        raise InputError(reason, where=str(folder), remedy="Set XDG_RUNTIME_DIR to a folder of your own") from failure
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise InputError(
            "the runtime folder is not private", where=str(folder), remedy="Remove it, or set XDG_RUNTIME_DIR"
        )
    return folder
