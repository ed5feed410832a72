"""The mock rig and the rendered rig keep the contract of a rig."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.imagegrid.sample import lattice, write_grid
from calibration_free_tests.renderer.bench_building import building
from calibration_free_tests.rigs.conformance import RigConformance
from recognition.geometry import Pose4
from rig.bench import default_bench_for_grid, load_bench, open_rig
from rig.hal import Rig
from rig.imagegrid import read_grid
from sim_backends.image_grid_rig import ImageGridRig, limits_of
from sim_backends.rendered_rig import Lattice, RenderedRig
from sim_backends.scene import Scene
from sim_backends.viewpoints import limits_around, viewing_poses


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_grid(tmp_path_factory.mktemp("grid"), lattice())


@pytest.fixture(scope="module")
def circling(tmp_path_factory: pytest.TempPathFactory) -> Path:
    poses = lattice([0.0, 7.5], [0.0], np.arange(-170.0, 171.0, 20.0).tolist(), [0.0])
    rng = np.random.default_rng(5)
    return write_grid(tmp_path_factory.mktemp("circle"), [poses[int(k)] for k in rng.permutation(len(poses))[:25]])


class TestLattice(RigConformance):
    @pytest.fixture
    def rig(self, folder: Path) -> Rig:
        return open_rig(default_bench_for_grid(folder))


class TestIrregularFullCircle(RigConformance):
    @pytest.fixture
    def rig(self, circling: Path) -> Rig:
        return open_rig(default_bench_for_grid(circling))


class TestImpreciseReadBack(RigConformance):
    tolerance_mm, tolerance_deg = 0.6, 0.3

    @pytest.fixture
    def rig(self, folder: Path) -> Rig:
        grid, rng = read_grid(folder), np.random.default_rng(1)
        return ImageGridRig(
            grid,
            limits_of(grid),
            internals_fixed_by_zoom=True,
            repeatability_mm=0.1,
            repeatability_deg=0.05,
            rng=rng,
        )


class TestRenderedStations(RigConformance):
    offers: Lattice | None = None

    @pytest.fixture
    def rig(self) -> Rig:
        model, place = building(), Pose4(7.0, 30.0, 5.0, -60.0)
        poses = viewing_poses(model, place, (250.0,), step_mm=120.0, zooms=(0.0, 1.0))
        return RenderedRig(
            Scene(model, place), limits_around(poses), self.offers or poses, size=(64, 48), start=poses[0]
        )


class TestRenderedLattice(TestRenderedStations):
    offers = Lattice(zooms=(0.0, 1.0))


@pytest.mark.realdata
class TestCastle(RigConformance):
    @pytest.fixture
    def rig(self, real_data: Path) -> Rig:
        bench = load_bench(Path(__file__).parents[2] / "examples" / "castle.yaml")
        return open_rig(bench, real_data / "castle")
