"""Expected parts take detections, each at most one, and all of a view's parts may be shifted alike."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from calibration_free_tests.recognition.synthetic import (
    SIZE,
    Faults,
    base_of,
    before_front,
    building,
    detections,
    regular,
    visible,
    world_of,
)
from recognition.association import NO_VOTES, Matching, OpenScale, compatible, match, vote_shift
from recognition.geometry import CameraPose
from recognition.modelbase import ModelBase, ObjectModel
from recognition.parts import DetectedPart
from recognition.seen import Seen, see
from recognition.tracking import World
from recognition.visibility import Pairs

FloatArray = npt.NDArray[np.float64]
CAMERA = before_front(400.0, turn_deg=15.0)


def expecting(world: World, thing: ObjectModel, hypotheses: int = 1, camera: CameraPose = CAMERA) -> Pairs:
    """The parts in the picture, expected where they are, by each of some equal hypotheses."""
    shown = visible(thing, camera)
    ids = [world.layout.part_ids.index(part.id) for part, _ in shown]
    n = len(shown)
    return Pairs(
        np.repeat(np.arange(hypotheses), n),
        np.tile(ids, hypotheses),
        np.tile([px for _, px in shown], (hypotheses, 1, 1)),
        np.ones(n * hypotheses),
    )


def view(base: ModelBase, parts: list[DetectedPart]) -> Seen:
    return see(parts, CAMERA, SIZE, 0, 0.0, [c.name for c in base.classes], 4)


def matched(base: ModelBase, pairs: Pairs, parts: list[DetectedPart], gate_px: float) -> Matching:
    return match(world_of(base).layout, pairs, view(base, parts), np.full(len(pairs.part), gate_px))


@pytest.fixture(name="tower")
def _tower() -> ObjectModel:
    return building("tower", 0)


def test_each_part_takes_its_own_detection_whatever_the_order(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower)
    rng = np.random.default_rng(0)
    parts = detections(visible(tower, CAMERA), Faults(noise_px=0.4, false=3), rng)
    order = rng.permutation(len(parts))
    found = matched(base, pairs, [parts[i] for i in order], 5.0)
    assert order[found.detection].tolist() == list(range(len(pairs.part)))
    assert found.distance_px.max() < 1.5


def test_a_part_without_a_detection_in_its_gate_is_missed(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower)
    parts = detections(visible(tower, CAMERA), Faults(), np.random.default_rng(0))
    found = matched(base, pairs, parts[1:], 5.0)
    assert found.detection[0] == -1
    assert np.isinf(found.distance_px[0])
    assert found.detection[1:].tolist() == list(range(len(parts) - 1))


def test_a_detection_serves_one_part_of_a_hypothesis_the_nearer(tower: ObjectModel) -> None:
    base = base_of(tower)
    one = expecting(world_of(base), tower).take(np.array([0]))
    nearer, farther = one.corners_px + 2.0, one.corners_px + 4.0
    rivals = Pairs(np.array([0, 0]), np.repeat(one.part, 2), np.concatenate([farther, nearer]), np.ones(2))
    parts = detections(visible(tower, CAMERA)[:1], Faults(), np.random.default_rng(0))
    assert matched(base, rivals, parts, 20.0).detection.tolist() == [-1, 0]


def test_hypotheses_share_detections(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower, hypotheses=3)
    parts = detections(visible(tower, CAMERA), Faults(), np.random.default_rng(0))
    assert matched(base, pairs, parts, 5.0).detection.tolist() == 3 * list(range(len(parts)))


def test_a_class_that_the_detector_excludes_is_not_matched(tower: ObjectModel) -> None:
    base = base_of(tower)
    world = world_of(base)
    shown = visible(tower, CAMERA)
    parts = [DetectedPart(px, {"OPEN" if p.part_class == "DW4" else "DW4": 1.0}, 0.3) for p, px in shown]
    assert (matched(base, expecting(world, tower), parts, 50.0).detection == -1).all()
    fits = compatible(world.layout, view(base, parts))
    assert fits.sum(axis=1).tolist() == [1] * len(parts)


def test_empty_views_and_no_expectations_are_no_special_case(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower)
    assert (matched(base, pairs, [], 5.0).detection == -1).all()
    parts = detections(visible(tower, CAMERA), Faults(), np.random.default_rng(0))
    assert len(matched(base, pairs.take(np.empty(0, dtype=np.int64)), parts, 5.0).detection) == 0


@pytest.mark.parametrize("shift", [(0.0, 0.0), (70.0, -35.0), (-130.0, 20.0)])
def test_a_common_shift_is_found_among_misses_and_false_detections(
    tower: ObjectModel, shift: tuple[float, float]
) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower)
    rng = np.random.default_rng(4)
    moved = [(part, px + shift) for part, px in visible(tower, CAMERA)]
    parts = detections(moved, Faults(noise_px=0.5, missed=0.15, false=4), rng)
    found = vote_shift(pairs, view(base, parts), 1, np.array([200.0]))
    shifts, votes = found.shift_px, found.votes
    assert np.abs(shifts[0, 0] - shift).max() <= 12.0
    assert votes[0, 0] > 0.6 * len(pairs.part)


def test_a_shift_beyond_reach_is_not_found(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower)
    far = detections(
        [(part, px + np.array([300.0, 0.0])) for part, px in visible(tower, CAMERA)], Faults(), np.random.default_rng(0)
    )
    found = vote_shift(pairs, view(base, far), 1, np.array([60.0]))
    shifts, votes = found.shift_px, found.votes
    assert np.abs(shifts).max() <= 72.0
    assert votes[0, 0] < 0.7 * len(pairs.part)


def test_of_equal_shifts_the_smallest_comes_first_and_the_lattice_next() -> None:
    """On a regular wall a shift by a whole bay fits nearly as well; both are returned when two are asked for."""
    block = regular("block")
    base = base_of(block)
    camera = before_front(480.0)
    pairs = expecting(world_of(base), block, camera=camera)
    bay = float(np.diff(sorted({round(float(px[0, 0]), 3) for _, px in visible(block, camera)}))[0])
    parts = detections(visible(block, camera), Faults(), np.random.default_rng(0))
    found = vote_shift(pairs, view(base, parts), 1, np.array([1.2 * bay]), modes=2)
    shifts, votes = found.shift_px, found.votes
    assert np.abs(shifts[0, 0]).max() < 12.0
    assert votes[0, 0] > votes[0, 1] > 0.5 * votes[0, 0]
    assert np.abs(shifts[0, 1]).max() > 0.7 * bay


def test_each_hypothesis_has_its_own_shift(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower, hypotheses=3)
    wanted = np.array([[0.0, 0.0], [48.0, 24.0], [-84.0, 0.0]])
    displaced = Pairs(pairs.hypothesis, pairs.part, pairs.corners_px - wanted[pairs.hypothesis][:, None], pairs.cosine)
    parts = detections(visible(tower, CAMERA), Faults(), np.random.default_rng(0))
    shifts = vote_shift(displaced, view(base, parts), 3, np.array([150.0, 150.0, 150.0])).shift_px
    assert np.abs(shifts[:, 0] - wanted).max() <= 12.0


def outline(px: FloatArray, confidence: float, score: dict[str, float] | None = None) -> DetectedPart:
    return DetectedPart(px, score or {"DW4": 1.0}, 0.3, confidence)


WINDOW = np.array([[100.0, 100.0], [160.0, 100.0], [160.0, 190.0], [100.0, 190.0]])


def shrunk(px: FloatArray, by: float) -> FloatArray:
    return np.asarray(px.mean(axis=0) + by * (px - px.mean(axis=0)))


def one_expected(world: World, px: FloatArray, times: int = 1) -> Pairs:
    part = int(np.flatnonzero(world.layout.part_class == world.layout.class_names.index("DW4"))[0])
    return Pairs(np.zeros(times, dtype=np.int64), np.full(times, part), np.tile(px, (times, 1, 1)), np.ones(times))


def test_of_outlines_alike_the_one_that_the_detector_likes_best_is_foremost(tower: ObjectModel) -> None:
    """Within and without a reveal: the list has the detector's best first."""
    base = base_of(tower)
    seen = view(base, [outline(WINDOW, 0.9), outline(shrunk(WINDOW, 0.9), 0.5), outline(WINDOW + 200.0, 0.4)])
    assert seen.foremost.tolist() == [0, 0, 2]


def test_outlines_of_other_classes_are_not_alike(tower: ObjectModel) -> None:
    base = base_of(tower)
    seen = view(base, [outline(WINDOW, 0.9, {"OPEN": 1.0}), outline(shrunk(WINDOW, 0.9), 0.5)])
    assert seen.foremost.tolist() == [0, 1]


def test_a_part_expected_roughly_takes_the_foremost_outline_and_one_expected_well_the_nearest(
    tower: ObjectModel,
) -> None:
    base = base_of(tower)
    world = world_of(base)
    seen = view(base, [outline(WINDOW, 0.9), outline(shrunk(WINDOW, 0.9), 0.5)])
    pairs = one_expected(world, shrunk(WINDOW, 0.88))
    taken = [match(world.layout, pairs, seen, np.array([30.0]), foremost=rough).detection[0] for rough in (True, False)]
    assert taken == [0, 1]
    # Beyond the gate the foremost is nobody's.
    assert match(world.layout, pairs, seen, np.array([3.0]), foremost=True).detection[0] == 1


def test_of_two_parts_that_want_one_foremost_outline_the_other_keeps_its_own(tower: ObjectModel) -> None:
    base = base_of(tower)
    world = world_of(base)
    seen = view(base, [outline(WINDOW, 0.9), outline(shrunk(WINDOW, 0.9), 0.5)])
    pairs = one_expected(world, WINDOW, 2)
    corners = np.stack([shrunk(WINDOW, 0.9), WINDOW])
    both = Pairs(pairs.hypothesis, pairs.part, corners, pairs.cosine)
    assert match(world.layout, both, seen, np.full(2, 30.0), foremost=True).detection.tolist() == [1, 0]


def test_likely_parts_vote_louder_than_clutter(tower: ObjectModel) -> None:
    """Two likely detections aside outvote three unlikely ones elsewhere."""
    base = base_of(tower)
    world = world_of(base)
    spots = [np.array([dx, 0.0]) for dx in (0.0, 90.0, 180.0)]
    pairs = one_expected(world, WINDOW, 3)
    expected = Pairs(pairs.hypothesis, pairs.part, np.stack([WINDOW + s for s in spots]), pairs.cosine)
    likely = [outline(WINDOW + s + [0.0, 60.0], 1.0) for s in spots[:2]]
    clutter = [outline(WINDOW + s - [0.0, 60.0], 0.1) for s in spots]
    seen = view(base, likely + clutter)
    assert vote_shift(expected, seen, 1, np.array([80.0])).shift_px[0, 0].tolist() == [0.0, 60.0]


@pytest.mark.parametrize("true_scale", [0.75, 1.0, 1.3])
def test_an_open_focal_length_is_found_with_the_shift(tower: ObjectModel, true_scale: float) -> None:
    base = base_of(tower)
    about = np.array([SIZE[0] / 2, SIZE[1] / 2])
    pairs = expecting(world_of(base), tower)
    shown = [(part, about + true_scale * (px - about) + [24.0, -12.0]) for part, px in visible(tower, CAMERA)]
    parts = detections(shown, Faults(), np.random.default_rng(0))
    factors = np.array([0.75, 0.87, 1.0, 1.14, 1.3])
    for free in (True, False):
        scale = OpenScale(factors, np.array([free]), about[None])
        found = vote_shift(pairs, view(base, parts), 1, np.array([100.0]), scale=scale)
        assert found.scale[0, 0] == (true_scale if free else 1.0)
        if free:
            assert np.abs(found.shift_px[0, 0] - [24.0, -12.0]).max() <= 12.0


def test_of_two_scales_that_bring_parts_onto_detections_the_one_that_fits_their_size_is_better(
    tower: ObjectModel,
) -> None:
    """A single part is brought to its place by any scale; only at one of them will it then be matched."""
    base = base_of(tower)
    pairs = one_expected(world_of(base), WINDOW, 1)
    about = WINDOW.mean(axis=0)
    parts = [outline(about + 1.2 * (WINDOW - about) + [20.0, 0.0], 1.0)]
    scale = OpenScale(np.array([1.0, 1.2]), np.array([True]), about[None])
    found = vote_shift(pairs, view(base, parts), 1, np.array([60.0]), scale=scale)
    assert found.scale[0, 0] == 1.2


def test_where_there_is_no_further_way_it_says_so(tower: ObjectModel) -> None:
    base = base_of(tower)
    pairs = expecting(world_of(base), tower)
    found = vote_shift(pairs, view(base, []), 1, np.array([50.0]), modes=3)
    assert found.shift_px[0, 0].tolist() == [0.0, 0.0]
    assert (found.votes[0] > NO_VOTES).tolist() == [True, False, False]
