"""The paper's detector: threshold segmentation, corners from line fits, part-class by invariants and brightness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from recognition.detectors import classify
from recognition.detectors.edges import EdgeField
from recognition.detectors.outward import likely_part, outward_outlines
from recognition.detectors.profiles import EdgeFit, Float32Array, fit_edges, planes_of
from recognition.detectors.regions import find_polygons
from recognition.modelbase import PartClass
from recognition.parts import DetectedPart
from rig.errors import InputError
from rig.hal import Image

FloatArray = npt.NDArray[np.float64]

_QUAD_VERTICAL = np.array([False, True, False, True])


@dataclass(frozen=True, slots=True)
class SegmentationSettings:
    """What the detector takes for a part.

    Attributes:
        least_px: smallest width and height of a part.
        levels: most thresholds of the grey plane.
        upright_deg: how far the vertical sides of a part may lean in the picture.
        least_contrast: smallest median step across any edge, grey levels per pixel.
        least_support: smallest share of samples that must lie on the line of every edge.
        same_px: outlines whose corners all lie within this distance are one.
        refined_px: how far the refined edges may lie from the boundary of the region.
        border_px: parts nearer to the picture's border count as cut off.
        shape_px: corners of a part-class with more than four corners fit its canonical frame within this.
        most: most parts returned.
    """

    least_px: float = 8.0
    levels: int = 8
    upright_deg: float = 4.0
    least_contrast: float = 2.0
    least_support: float = 0.3
    same_px: float = 2.0
    refined_px: float = 3.5
    border_px: float = 1.0
    shape_px: float = 2.0
    most: int = 200


@dataclass(frozen=True, slots=True)
class _Found:
    """Parts of one number of corners: corners ``(K, n, 2)``, class scores, quality 0..1 and corner sd ``(K,)``."""

    corners: FloatArray
    scores: list[dict[str, float]]
    quality: FloatArray
    sigma: FloatArray


class SegmentationDetector:
    """Finds the parts of given part-classes in pictures of an upright camera."""

    def __init__(self, classes: Sequence[PartClass], settings: SegmentationSettings | None = None) -> None:
        """Prepare for part-classes.

        Raises:
            InputError: there is no class, or one with more than four corners lacks its canonical corners.
        """
        if not classes:
            raise InputError("the detector was given no part-class", where="classes", remedy="Give at least one")
        for part_class in classes:
            if part_class.corner_count > 4 and part_class.canonical is None:
                raise InputError(
                    f"part-class '{part_class.name}' has {part_class.corner_count} corners but no canonical ones",
                    where="classes",
                    remedy="Give its corners in the unit square",
                )
        self._settings = settings or SegmentationSettings()
        self._quads = [c for c in classes if c.corner_count == 4]
        self._shapes: dict[int, list[classify.Shape]] = {}
        for part_class in classes:
            if part_class.corner_count > 4:
                self._shapes.setdefault(part_class.corner_count, []).append(classify.Shape.of(part_class))
        self._counts = sorted({c.corner_count for c in classes})

    def detect(self, image: Image) -> Sequence[DetectedPart]:
        """The parts found in an ``(h, w)`` or ``(h, w, 3)`` 8-bit picture, best first."""
        picture = _checked(image)
        if min(picture.shape[:2]) < self._settings.least_px + 2:
            return []
        outlines = find_polygons(picture, self._counts, self._settings.least_px, self._settings.levels)
        planes = planes_of(picture)
        found = [self._find(picture, planes, n, np.array(group)) for n, group in outlines.items() if group]
        parts = [
            DetectedPart(corners, scores, float(sigma), float(quality))
            for group in found
            for corners, scores, quality, sigma in zip(
                group.corners, group.scores, group.quality, group.sigma, strict=True
            )
        ]
        return sorted(parts, key=lambda part: -part.confidence)[: self._settings.most]

    def _find(self, picture: Image, planes: Float32Array, n: int, outlines: FloatArray) -> _Found:
        """Refine, filter and classify outlines ``(K, n, 2)``."""
        if n == 4:
            outlines = classify.order_quadrilaterals(outlines)
            outlines = outlines[classify.upright_sides(outlines, _QUAD_VERTICAL, 2 * self._settings.upright_deg)]
        outlines = _thinned(outlines, 1.5)
        if n > 4:
            outlines = outlines[self._roughly_known(n, outlines)]
        fit = fit_edges(planes, outlines, self._settings.refined_px)
        with np.errstate(invalid="ignore"):
            near = np.abs(fit.corners_px - outlines).max(axis=(1, 2)) <= 2.5 * self._settings.refined_px
        fit = self._best(fit.take(near), planes)
        if n == 4:
            closed = _thinned(np.concatenate([fit.corners_px, outlines]), self._settings.same_px)
            fit = self._best(fit.joined(outward_outlines(EdgeField(picture), closed)), planes)
        return self._quad_classes(planes, fit) if n == 4 else self._shape_classes(n, fit)

    def _roughly_known(self, n: int, outlines: FloatArray) -> npt.NDArray[np.bool_]:
        """``(K,)``: an unrefined outline fits one of the classes to some pixels; most are texture and do not."""
        allowed = np.maximum(2.0 * self._settings.shape_px, 0.05 * np.ptp(outlines, axis=1).max(axis=1))
        lean = 2 * self._settings.upright_deg
        errors = [classify.best_turns(outlines, shape, lean)[1] for shape in self._shapes[n]]
        return np.asarray(np.min(errors, axis=0) <= allowed)

    def _best(self, fit: EdgeFit, planes: Float32Array) -> EdgeFit:
        """The sound outlines, one of each group of near-identical ones, best first."""
        fit = fit.take(self._sound(fit, planes.shape[:2]))
        return fit.take(_distinct(fit.corners_px, _quality(fit), self._settings.same_px))

    def _sound(self, fit: EdgeFit, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
        """``(K,)``: strong straight edges all round, inside the picture, and upright if they are quadrilaterals."""
        wanted, border = self._settings, self._settings.border_px
        size = np.array([shape[1], shape[0]])
        good = (fit.contrast >= wanted.least_contrast).all(axis=1) & (fit.support >= wanted.least_support).all(axis=1)
        with np.errstate(invalid="ignore"):
            good &= ((fit.corners_px >= border) & (fit.corners_px <= size - 1 - border)).all(axis=(1, 2))
            if fit.corners_px.shape[1] == 4:
                good &= classify.upright_sides(fit.corners_px, _QUAD_VERTICAL, wanted.upright_deg)
        return np.asarray(good)

    def _quad_classes(self, planes: Float32Array, fit: EdgeFit) -> _Found:
        inside, wall = classify.inside_and_wall(planes, fit.corners_px)
        by_class = classify.four_corner_scores(self._quads, inside, wall)
        scores = [{name: float(p[i]) for name, p in by_class.items()} for i in range(len(fit.corners_px))]
        likely = likely_part(fit.corners_px)
        return _Found(fit.corners_px, scores, _quality(fit) * likely, _sigma(fit))

    def _shape_classes(self, n: int, fit: EdgeFit) -> _Found:
        """Turn each outline to start at its class's first corner, and score the classes by how well it fits them."""
        turned = [classify.best_turns(fit.corners_px, shape, self._settings.upright_deg) for shape in self._shapes[n]]
        errors = np.array([error for _, error in turned])  # (classes, K)
        fits = np.exp(-0.5 * (errors / (0.5 * self._settings.shape_px)) ** 2)
        best = errors.argmin(axis=0)
        known = np.flatnonzero(errors.min(axis=0) <= self._settings.shape_px)
        total = np.maximum(fits.sum(axis=0), 1e-12)
        share = fits / total
        scores = [{shape.name: float(share[j, k]) for j, shape in enumerate(self._shapes[n])} for k in known]
        placed = np.array([turned[best[k]][0][k] for k in known]).reshape(-1, n, 2)
        return _Found(placed, scores, _quality(fit)[known], _sigma(fit)[known])


def make_detector(classes: Sequence[PartClass]) -> SegmentationDetector:
    """The detector for these part-classes (entry point ``segmentation`` of ``rig.detectors``)."""
    return SegmentationDetector(classes)


def _checked(image: Image) -> Image:
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3)):
        raise InputError(
            f"a picture of shape {image.shape} and type {image.dtype} cannot be searched",
            where="image",
            remedy="Give (h, w) grey or (h, w, 3) BGR, 8 bits",
        )
    return image


def _quality(fit: EdgeFit) -> FloatArray:
    """``(K,)``, 0..1: how straight and how strong the weakest edge is."""
    weakest = fit.contrast.min(axis=1)
    return np.asarray(fit.support.min(axis=1) * weakest / (weakest + 6.0))


def _sigma(fit: EdgeFit) -> FloatArray:
    """``(K,)`` standard deviation of a corner coordinate, pixels: worse for weak edges with few samples on the line."""
    return np.asarray(0.15 + 0.6 / np.maximum(fit.contrast.min(axis=1), 1.0) + 0.5 * (1 - fit.support.min(axis=1)))


def _thinned(outlines: FloatArray, cell_px: float) -> FloatArray:
    """One of each group of outlines ``(K, n, 2)`` whose corners fall into the same cells."""
    if len(outlines) == 0:
        return outlines
    cells = np.round(outlines / cell_px).astype(np.int32).reshape(len(outlines), 2 * outlines.shape[1])
    return outlines[np.sort(np.unique(cells, axis=0, return_index=True)[1])]


def _distinct(corners: FloatArray, quality: FloatArray, same_px: float) -> npt.NDArray[np.int64]:
    """Indices of the best outline of each group of near-identical ones ``(K, n, 2)``, best first."""
    order = np.argsort(-quality, kind="stable")
    sorted_corners = corners[order].reshape(len(order), 2 * corners.shape[1])
    alive = np.ones(len(order), dtype=bool)
    kept = []
    for i in range(len(order)):
        if not alive[i]:
            continue
        kept.append(order[i])
        rest = slice(i + 1, None)
        alive[rest] &= np.abs(sorted_corners[rest] - sorted_corners[i]).max(axis=1) > same_px
    return np.array(kept, dtype=np.int64)
