"""Where a session left a gantry homed: a record that the next session may take up, once (decision 0051)."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from pathlib import Path

from rig.devices import Identity, Triple

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class FileHomingMemory:
    """A `rig.guard.HomingMemory`: one file in a private folder.

    Args:
        path: of the file.
        boot_id: a file whose text changes whenever this computer starts; a record from before that is void.
    """

    def __init__(self, path: Path, boot_id: Path = BOOT_ID) -> None:
        self._path, self._boot_id = path, boot_id

    def recall(self, gantry: Identity) -> Triple | None:
        """The place, mm, if the record is of this gantry and of this start of the computer. The record is gone then."""
        try:
            found = json.loads(self._path.read_text())
            self._path.unlink()
            same = found["gantry"] == _key(gantry) and found["boot"] == self._boot()
            x, y, z = (float(value) for value in found["place_mm"])
        except (OSError, ValueError, KeyError, TypeError):
            # No record, or one that cannot be read or taken away: then it is homed anew.
            return None
        return (x, y, z) if same and all(map(math.isfinite, (x, y, z))) else None

    def remember(self, gantry: Identity, place_mm: Triple) -> None:
        """Write the record. Where that fails there is none, and the next session homes."""
        text = json.dumps({"gantry": _key(gantry), "boot": self._boot(), "place_mm": place_mm})
        with suppress(OSError):
            self._path.write_text(text)

    def _boot(self) -> str:
        try:
            return self._boot_id.read_text().strip()
        except OSError:
            return ""


def _key(gantry: Identity) -> list[str]:
    return [gantry.kind, gantry.version, gantry.where]
