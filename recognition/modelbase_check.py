"""Checks what a model base file means, and builds the model base from it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from recognition import part_rules
from recognition.modelbase import Face, ModelBase, ObjectModel, Part, PartClass
from recognition.modelbase_file import ClassEntry, ModelBaseFile, ObjectEntry, PartEntry
from recognition.part_classes import BUILT_IN_CLASSES
from rig.errors import ModelBaseError
from rig.schema import Document, Problem, did_you_mean, raise_problems

FloatArray = npt.NDArray[np.float64]
Location = tuple[str | int, ...]

SMALLEST_PART_MM = 5.0
"""If even the largest part of an object is smaller, the file is in metres or inches: no such part fills a close-up."""
LARGEST_OBJECT_MM = 1e6
ODD_PART_RATIO = 100.0
"""A part so many times larger or smaller than its object's median part has slipped in another unit."""
OFF_ITS_FACE = 0.02
"""Parts may stand off their face's plane by this share of the face's size."""


class Checker:
    """Gathers the problems of one document, so that all are told at once."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.found: list[tuple[Location, Problem]] = []

    def add(self, location: Location, message: str, remedy: str | None = None) -> None:
        """Note a problem with the value at a location."""
        self.found.append((location, self.document.problem(location, message, remedy)))

    def finish(self) -> None:
        """Raise all problems, in the order of the file."""
        order = sorted(self.found, key=lambda entry: tuple((isinstance(s, str), str(s).zfill(9)) for s in entry[0]))
        raise_problems([problem for _, problem in order], ModelBaseError)

    def unique(self, ids: Iterable[str], location: Location, what: str, key: str = "id") -> None:
        """Note ids that stand twice in the list at a location."""
        first: dict[str, int] = {}
        for index, name in enumerate(ids):
            if name in first:
                place = self.document.where((*location, first[name], key))
                self.add((*location, index, key), f"the {what} '{name}' stands twice", f"It stands at {place} too.")
            first.setdefault(name, index)


def build(file: ModelBaseFile, document: Document, default_name: str) -> ModelBase:
    """Check a file that fits the schema, and build the model base.

    Raises:
        ModelBaseError: listing every broken rule with its line.
    """
    checker = Checker(document)
    checker.unique((entry.name for entry in file.classes), ("classes",), "class", key="name")
    checker.unique((entry.id for entry in file.objects), ("objects",), "object")
    declared = {entry.name: _class(entry, ("classes", i), checker) for i, entry in enumerate(file.classes)}
    used = {part.part_class for entry in file.objects for part in entry.parts}
    known = BUILT_IN_CLASSES | declared
    if "OPEN" in used and "DW4" not in declared:
        known |= {"DW4": replace(known["DW4"], bright=False)}
    objects = tuple(_object(entry, ("objects", i), known, checker) for i, entry in enumerate(file.objects))
    checker.finish()
    classes = tuple(known[name] for name in known if name in used)
    return ModelBase(objects=objects, classes=classes, name=file.name or default_name)


def _class(entry: ClassEntry, location: Location, checker: Checker) -> PartClass:
    base = BUILT_IN_CLASSES.get(entry.name, PartClass(entry.name, 4, None, bright=None))
    bright = entry.bright if "bright" in entry.model_fields_set else base.bright
    if entry.corners is None:
        return replace(base, bright=bright)
    outline = np.array(entry.corners, dtype=np.float64)
    flat = np.concatenate([outline, np.zeros((len(outline), 1))], axis=1)[None]
    where = (*location, "corners")
    for rule in part_rules.POLYGON_RULES:
        if rule.broken(flat)[0]:
            checker.add(where, rule.message, rule.remedy)
            break
    else:
        if part_rules.area_normals(flat)[0, 2] > 0:
            checker.add(where, "the outline runs anticlockwise", "List the corners clockwise (x right, y down).")
    # Any quadrilateral is the image of any other: an outline says something only from five corners on.
    return PartClass(entry.name, len(outline), outline if len(outline) > 4 else None, bright)


def _object(entry: ObjectEntry, location: Location, known: dict[str, PartClass], checker: Checker) -> ObjectModel:
    checker.unique((part.id for part in entry.parts), (*location, "parts"), "part")
    checker.unique((face.id for face in entry.faces), (*location, "faces"), "face")
    corners = [_corners(part, (*location, "parts", i), checker) for i, part in enumerate(entry.parts)]
    faces = tuple(Face(face.id, _frozen(face.corners_mm)) for face in entry.faces)
    if _units_are_plausible(corners, location, checker):
        sound = _check_polygons(entry.parts, corners, (*location, "parts"), known, checker)
        _check_faces(faces, (*location, "faces"), checker)
        _check_sides(entry, corners, sound, faces, location, checker)
    parts = tuple(
        Part(part.id, part.part_class, points, part.face, part.look, part.recess_mm)
        for part, points in zip(entry.parts, corners, strict=True)
    )
    return ObjectModel(entry.id, parts, faces)


def _frozen(points: Sequence[Sequence[float]]) -> FloatArray:
    array = np.array(points, dtype=np.float64)
    array.setflags(write=False)
    return array


def _corners(part: PartEntry, location: Location, checker: Checker) -> FloatArray:
    """``(n, 3)`` corners in the object frame, from either form."""
    if part.corners_mm is not None:
        return _frozen(part.corners_mm)
    assert part.vertices_mm is not None
    assert part.pose is not None
    rotation = np.array(part.pose.rotation)
    wrong = part_rules.broken_rotation(rotation)
    if wrong:
        remedy = "Give the rows of a right-handed rotation with at least 7 digits."
        checker.add((*location, "pose", "rotation"), f"{wrong}, so it is no rotation", remedy)
    moved: FloatArray = np.array(part.vertices_mm) @ rotation.T + np.array(part.pose.translation_mm)
    moved.setflags(write=False)
    return moved


def _units_are_plausible(corners: Sequence[FloatArray], location: Location, checker: Checker) -> bool:
    sizes, _ = part_rules.sizes_and_normals(corners)
    furthest = float(np.abs(np.concatenate(corners)).max())
    if sizes.max() < SMALLEST_PART_MM and sizes.max() > 0:
        message = f"the largest part is {sizes.max():.3g} mm across, which looks like metres"
        checker.add(location, message, "Lengths are millimetres: multiply them by 1000.")
        return False
    if furthest > LARGEST_OBJECT_MM:
        message = f"a corner is {furthest / 1e6:.4g} km from the origin, which looks like another unit or a map's grid"
        checker.add(location, message, "Lengths are millimetres; put the origin near the object.")
        return False
    median = float(np.median(sizes))
    for index in np.flatnonzero((sizes > ODD_PART_RATIO * median) | (sizes * ODD_PART_RATIO < median)):
        message = f"this part is {sizes[index]:.3g} mm across, where the object's parts are {median:.3g} mm"
        if sizes[index] > 0:
            checker.add((*location, "parts", int(index)), message, "Is it in another unit?")
    return True


def _check_polygons(
    parts: Sequence[PartEntry],
    corners: Sequence[FloatArray],
    location: Location,
    known: dict[str, PartClass],
    checker: Checker,
) -> set[int]:
    """Check each part's corners; return the indices of the parts whose corners can be used."""
    alike: dict[tuple[str, int], list[int]] = defaultdict(list)
    for index, part in enumerate(parts):
        alike[part.part_class, len(corners[index])].append(index)
    sound: set[int] = set()
    for (name, count), members in alike.items():
        stack = np.stack([corners[index] for index in members])
        left = _apply(part_rules.POLYGON_RULES, stack, members, parts, location, checker)
        if name not in known:
            for index in members:
                remedy = did_you_mean(name, known) or "Define it under `classes`."
                checker.add((*location, index, "class"), f"there is no class '{name}'", remedy)
        elif count != known[name].corner_count:
            for index in members:
                message = f"{count} corners, but the class '{name}' has {known[name].corner_count}"
                checker.add(_corner_location(location, index, parts), message, "Correct the corners or the class.")
        elif left:
            rows = [row for row, index in enumerate(members) if index in left]
            order = _order_rules(known[name])
            sound |= _apply(order, stack[rows], [members[row] for row in rows], parts, location, checker)
    return sound


def _order_rules(part_class: PartClass) -> tuple[part_rules.Rule, ...]:
    outline = part_rules.UNIT_SQUARE if part_class.canonical is None else part_class.canonical
    remedy = "List them clockwise as seen from outside, starting top-left, as the class does."
    wrong_start = part_rules.Rule(
        lambda corners: part_rules.starts_at_the_wrong_corner(corners, outline),
        "the corners do not start at the top-left, or run anticlockwise",
        remedy,
    )
    if part_class.canonical is None:
        return (wrong_start,)
    message = f"the corners do not have the outline of the class '{part_class.name}', in its order"
    return part_rules.Rule(lambda c: part_rules.misses_its_outline(c, outline), message, remedy), wrong_start


def _apply(
    rules: Sequence[part_rules.Rule],
    stack: FloatArray,
    members: Sequence[int],
    parts: Sequence[PartEntry],
    location: Location,
    checker: Checker,
) -> set[int]:
    """Try rules in turn on parts with ``(n, k, 3)`` corners, telling each part's first broken one; return the sound."""
    left = np.arange(len(members))
    for rule in rules:
        broken = rule.broken(stack[left]) if len(left) else np.zeros(0, dtype=np.bool_)
        for row in left[broken]:
            index = members[int(row)]
            checker.add(_corner_location(location, index, parts), f"{rule.message} ('{parts[index].id}')", rule.remedy)
        left = left[~broken]
    return {members[int(row)] for row in left}


def _corner_location(location: Location, index: int, parts: Sequence[PartEntry]) -> Location:
    return (*location, index, "corners_mm" if parts[index].corners_mm is not None else "vertices_mm")


def _check_faces(faces: Sequence[Face], location: Location, checker: Checker) -> None:
    for index, face in enumerate(faces):
        stack = face.corners_mm[None]
        for rule in (*part_rules.POLYGON_RULES, *_order_rules(PartClass(face.id, 4))):
            if rule.broken(stack)[0]:
                checker.add((*location, index, "corners_mm"), f"{rule.message} (face '{face.id}')", rule.remedy)
                break


def _check_sides(
    entry: ObjectEntry,
    corners: Sequence[FloatArray],
    sound: set[int],
    faces: Sequence[Face],
    location: Location,
    checker: Checker,
) -> None:
    """Parts face the same way as their face, or, where faces are names only, as most parts of their face."""
    by_id = {face.id: face for face in faces}
    on_face: dict[str, list[int]] = defaultdict(list)
    for index, part in enumerate(entry.parts):
        where = (*location, "parts", index, "face")
        if faces and part.face is not None and part.face not in by_id:
            checker.add(where, f"the object has no face '{part.face}'", did_you_mean(part.face, by_id))
        elif part.face is not None and index in sound:
            on_face[part.face].append(index)
    _, all_normals = part_rules.sizes_and_normals(corners)
    for name, members in on_face.items():
        normals = all_normals[members]
        face = by_id.get(name)
        outside = (
            normals.sum(axis=0) + normals[0] / 2 if face is None else part_rules.area_normals(face.corners_mm[None])[0]
        )
        for index in np.array(members)[normals @ outside < 0]:
            message = f"as seen from outside the face '{name}' the corners run anticlockwise"
            remedy = "List them clockwise from the top-left, as the rest of the face does."
            checker.add(_corner_location((*location, "parts"), int(index), entry.parts), message, remedy)
        if face is not None:
            limit = OFF_ITS_FACE * float(part_rules.size(face.corners_mm[None])[0])
            for index in members:
                off = float(np.abs((corners[index] - face.corners_mm[0]) @ outside).max())
                if off > limit:
                    message = f"the part stands {off:.3g} mm off its face '{name}'"
                    where = _corner_location((*location, "parts"), index, entry.parts)
                    checker.add(where, message, "Correct the corners or the face.")
