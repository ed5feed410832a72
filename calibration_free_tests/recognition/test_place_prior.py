"""The prior over places: by area, or by what random views show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.recognition.synthetic import (
    base_of,
    before_front,
    believed,
    regular,
    seen_from,
    three_buildings,
    world_of,
)
from recognition.belief import weigh
from recognition.layout import compile_layout
from recognition.modelbase import Face, ModelBase, ObjectModel
from recognition.place_prior import PlacePrior, by_area, read_prior, sample_in_parallel, sample_views, write_prior
from recognition.settings import BenchBounds, RecogniserSettings
from recognition.visibility import walls_of
from rig.errors import InputError

NEAR = BenchBounds(150.0, 300.0, 30.0, 60.0)


def walled(name: str, columns: int) -> ObjectModel:
    """A wall of equal windows."""
    thing = regular(name, columns)
    wide, tall = 80.0 * columns + 20.0, 470.0
    corners = np.array([[0, 0, 0], [wide, 0, 0], [wide, tall, 0], [0, tall, 0]], dtype=np.float64)
    return replace(thing, faces=(Face("front", corners),))


def pair() -> ModelBase:
    return base_of(walled("long", 12), walled("short", 4))


def test_an_object_with_more_wall_is_likelier_and_its_places_alike() -> None:
    layout = compile_layout(pair())
    weight = np.exp(by_area(layout, walls_of(layout)).log_weight)
    assert weight.sum() == pytest.approx(1.0)
    long, short = weight[layout.object_of == 0], weight[layout.object_of == 1]
    assert long.sum() / short.sum() == pytest.approx(980.0 / 340.0)
    assert np.ptp(long) == pytest.approx(0.0)


def test_without_walls_every_part_is_alike() -> None:
    layout = compile_layout(base_of(regular("a", 12), regular("b", 3)))
    assert np.ptp(by_area(layout, walls_of(layout)).log_weight) == pytest.approx(0.0)


def test_sampled_views_show_each_object_by_its_area_and_the_same_seed_draws_the_same() -> None:
    layout = compile_layout(pair())
    seen = sample_views(layout, walls_of(layout), NEAR, 4000, seed=3)
    assert seen.sum() == 4000
    share = seen[layout.object_of == 0].sum() / 4000
    assert share == pytest.approx(980.0 / 1320.0, abs=0.04)
    np.testing.assert_array_equal(seen, sample_views(layout, walls_of(layout), NEAR, 4000, seed=3))


def test_any_number_of_processes_draws_the_same_views() -> None:
    alone = sample_in_parallel(pair(), NEAR, 10_000, seed=1, jobs=1)
    assert alone.sum() == 10_000
    np.testing.assert_array_equal(alone, sample_in_parallel(pair(), NEAR, 10_000, seed=1, jobs=2))


def test_a_part_that_no_view_can_show_is_rarest() -> None:
    """A screen of wall before all windows hides them from everywhere."""
    yard = walled("yard", 4)
    wall = yard.faces[0].corners_mm
    before = Face("screen", wall + np.array([0.0, 0.0, -40.0]))
    hidden = base_of(replace(yard, faces=(*yard.faces, before)), walled("open", 4))
    layout = compile_layout(hidden)
    seen = sample_views(layout, walls_of(layout), NEAR, 2000, seed=0)
    assert seen[layout.object_of == 0].sum() == 0


def test_views_that_show_nothing_end_with_the_remedy() -> None:
    layout = compile_layout(pair())
    with pytest.raises(InputError, match="show a whole part"):
        sample_views(layout, walls_of(layout), BenchBounds(5.0, 6.0, 5.0, 6.0), 100, seed=0)


def test_a_prior_is_read_as_it_was_written_and_only_for_its_own_base(tmp_path: Path) -> None:
    layout = compile_layout(pair())
    seen = sample_views(layout, walls_of(layout), NEAR, 1000, seed=0)
    write_prior(tmp_path / "p.json", layout, seen)
    again = read_prior(tmp_path / "p.json", layout)
    np.testing.assert_allclose(again.log_weight, PlacePrior.of(seen + 0.5).log_weight)
    with pytest.raises(InputError, match="another model base"):
        read_prior(tmp_path / "p.json", compile_layout(three_buildings()))


@pytest.mark.parametrize("spoilt", ["", "[]", "{}", '{"format": "rig-place-prior", "version": 2}'])
def test_what_is_no_prior_is_refused_by_name(spoilt: str, tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text(spoilt)
    with pytest.raises(InputError, match=r"p\.json.*no prior over places"):
        read_prior(tmp_path / "p.json", compile_layout(pair()))


def test_a_count_that_is_no_count_is_refused(tmp_path: Path) -> None:
    layout = compile_layout(pair())
    write_prior(tmp_path / "p.json", layout, np.ones(len(layout.part_ids)))
    told = json.loads((tmp_path / "p.json").read_text())
    told["views"]["long"]["front 0.0"] = -3
    (tmp_path / "p.json").write_text(json.dumps(told))
    with pytest.raises(InputError, match="fewer than none"):
        read_prior(tmp_path / "p.json", layout)


def test_the_prior_counts_in_the_belief() -> None:
    base = three_buildings()
    world = world_of(base)
    hypotheses, before = believed(world, [seen_from(base, base.objects[0], before_front(300.0), group=0)])
    doubtful = np.where(world.layout.object_of == 0, 1e-6, 1.0)
    after = weigh(replace(world, places=PlacePrior.of(doubtful)), hypotheses)
    assert after.by_object(3)[0] < 0.01 * before.by_object(3)[0]


def test_paper_mode_has_its_own_prior() -> None:
    with pytest.raises(InputError, match="paper mode has the paper's prior"):
        RecogniserSettings(mode="paper", prior=Path("p.json"))
