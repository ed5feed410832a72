"""The private folder where processes of one user that use a bench meet."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from rig.errors import InputError

SHARED = Path("/tmp")
"""The same for a login, cron and a service, at any time, as nothing is that an environment tells."""
APART = "RIG_RUNTIME_DIR"
"""The variable of the environment that names another folder: for tests and containers, which meet nobody else."""


def runtime_folder() -> Path:
    """``/tmp/rig-UID``, whatever the environment, or ``$RIG_RUNTIME_DIR`` where that is set; made if need be.

    Nobody else may write there: what it holds stops the bench, and says whether it is homed.

    Raises:
        InputError: it belongs to somebody else, others may use it, or what was set is no full path.
    """
    apart = os.environ.get(APART, "")
    folder = Path(apart) if apart else SHARED / f"rig-{os.getuid()}"
    if not folder.is_absolute():
        raise InputError(
            "the runtime folder must be the same from everywhere", where=apart, remedy=f"Set {APART} to a full path"
        )
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as failure:
        reason = f"the runtime folder cannot be used ({failure.strerror or failure})"
        raise InputError(reason, where=str(folder), remedy=f"Set {APART} to a folder of your own") from failure
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise InputError("the runtime folder is not private", where=str(folder), remedy=f"Remove it, or set {APART}")
    return folder
