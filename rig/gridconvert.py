"""Turns other people's captures into image grids."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path

from rig.errors import ImageGridError, InputError
from rig.hal import RigPose
from rig.imagegrid import GridInfo, GridWriter, ImageGrid, decode_image, read_grid, read_image_bytes

_NAME = re.compile(r"r(?P<row>\d{1,4})_c(?P<column>\d{1,4})\.(?:jpe?g|png)", re.IGNORECASE)
_NAMED_LIKE = "Name a folder with pictures called like r00_c16.jpg"


def import_lightfield(src: Path, dst: Path, step_mm: float = 1.0) -> ImageGrid:
    """Make an image grid of a planar light field: pictures ``rRR_cCC.jpg``, row and column of the camera.

    A camera that goes from column to column moves to the right (+X), from row to row downwards (+Y); it does not turn.
    Pictures are copied byte for byte. In such archives the views are re-registered to a focal plane, so the principal
    point shifts from view to view, and the grid says that internals change with every view.

    Args:
        src: folder with the pictures; other files in it are passed over.
        dst: folder of the grid, made if need be; must not hold a grid yet.
        step_mm: distance between neighbouring row numbers and column numbers, mm. Where it is not known, 1 gives a
            grid that is right up to scale.

    Returns:
        The grid, as read back.

    Raises:
        InputError: no such pictures, a step that is not positive, or a grid in ``dst`` already.
        ImageGridError: two pictures of one place, or a place of the lattice without a picture.
        ImageError: a picture cannot be used.
    """
    if not 0.0 < step_mm < 1e6:
        raise InputError(f"{step_mm} is no distance in millimetres", where="step_mm", remedy="Give one above 0")
    places = _places(src)
    if {row for row, _ in places} and len(places) < len({r for r, _ in places}) * len({c for _, c in places}):
        raise ImageGridError(_first_gap(places), where=str(src), remedy="Copy the light field again from its source")
    told = "step as told" if step_mm != 1.0 else "step unknown, 1 mm assumed"
    info = GridInfo(
        provenance=f"light field {src.name}, pictures rRR_cCC; {told} ({step_mm:g} mm between neighbouring numbers)",
        layout="lattice",
        internals="change_every_view",
    )
    with GridWriter(dst, info) as writer:
        for (row, column), file in sorted(places.items()):
            data = read_image_bytes(file)
            decode_image(data, str(file))  # A damaged picture is refused now, not in the middle of a run.
            pose = RigPose(column * step_mm, row * step_mm, 0.0, 0.0, 0.0)
            writer.add_bytes(data, {"file": f"images/{file.name}", **asdict(pose)})
    return read_grid(dst)


def _places(src: Path) -> dict[tuple[int, int], Path]:
    """The pictures by row and column."""
    places: dict[tuple[int, int], Path] = {}
    for file in sorted(src.iterdir()) if src.is_dir() else ():
        named = _NAME.fullmatch(file.name)
        if named is None:
            continue
        place = int(named["row"]), int(named["column"])
        if place in places:
            raise ImageGridError(
                f"is of the same row and column as {places[place].name}", where=str(file), remedy="Delete one of them"
            )
        places[place] = file
    if not places:
        raise InputError("no pictures of a light field here", where=str(src), remedy=_NAMED_LIKE)
    return places


def _first_gap(places: dict[tuple[int, int], Path]) -> str:
    rows, columns = ({place[k] for place in places} for k in (0, 1))
    gap = next((r, c) for r in sorted(rows) for c in sorted(columns) if (r, c) not in places)
    return f"the picture of row {gap[0]}, column {gap[1]} is missing"
