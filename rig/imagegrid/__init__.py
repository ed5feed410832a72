"""Image grids: folders of pictures and the rig poses that they were taken from (format: docs/formats.md)."""

from rig.imagegrid.entry import GridFrame, GridInfo
from rig.imagegrid.images import decode_image, load_image, read_image_bytes
from rig.imagegrid.reader import ImageGrid, read_grid
from rig.imagegrid.writer import GridWriter, hold_folder

__all__ = [
    "GridFrame",
    "GridInfo",
    "GridWriter",
    "ImageGrid",
    "decode_image",
    "hold_folder",
    "load_image",
    "read_grid",
    "read_image_bytes",
]
