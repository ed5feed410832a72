"""Random faults on the wire and in the controller while a gantry is driven through a list of places.

Three things must hold whatever happens: an arrival that the driver accepts is a true one, nothing forbidden is ever
commanded, and everything ends in bounded time. A stuck axis is left out: a controller without feedback cannot show it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from calibration_free_tests.gantry.simulated_bench import BOTH, Bench, name_of
from rig.devices import Motion
from rig.errors import HardwareError
from sim_backends.faults import FaultKind, random_script
from sim_backends.grbl_emulator.dialects import Dialect
from sim_backends.grbl_emulator.eeprom import BENCH

KINDS = [kind for kind in FaultKind if kind not in (FaultKind.STUCK_AXIS, FaultKind.OVERHEAT)]
PLACES = [(x, y, z) for z in (-20.0, -60.0) for y in (-40.0, -90.0, -140.0) for x in (-50.0, -120.0, -190.0)]
EVERY_S = 4.0
QUICK_HOMING = {**BENCH, 24: 600, 25: 6000}
LONGEST_S = 240.0
"""No call may take longer: homing's deadline, a time-out or two, and a STOP that is not answered."""


@dataclass
class Tally:
    """What a run came to."""

    arrived: int = 0
    failed: int = 0
    fired: int = 0
    worst_mm: float = 0.0


def survive(dialect: Dialect, seed: int, faults: int) -> Tally:
    """Drive through the places, recovering as a person would, until all faults have struck."""
    rng = np.random.default_rng(seed)
    times = 30.0 + np.cumsum(rng.exponential(EVERY_S, faults))
    script = random_script(rng, list(times), KINDS)
    bench = Bench(dialect, script, firmware=QUICK_HOMING, start_delay_s=float(rng.choice([0.0, 0.02])))
    tally, number, connected = Tally(), 0, False
    while bench.clock.now_s() < times[-1]:
        began_s = bench.clock.now_s()
        try:
            if not connected:
                bench.gantry.connect()
                connected = True
            status = bench.gantry.status()
            if not status.homed:
                bench.gantry.home()
            elif status.motion is Motion.ALARM:
                bench.gantry.unlock()
            place = PLACES[number % len(PLACES)]
            read = bench.gantry.move_to(*place)
            error_mm = max(abs(a - b) for a, b in zip(bench.truth, read, strict=True))
            missed_mm = max(abs(a - b) for a, b in zip(bench.truth, place, strict=True))
            tally.worst_mm = max(tally.worst_mm, error_mm, missed_mm)
            tally.arrived += 1
            number += 1
        except HardwareError as error:
            tally.failed += 1
            if not connected:
                bench.gantry.stop()  # as the error says: a controller that met a limit answers only after a reset
            connected = connected and "onnect" not in str(error)
            bench.clock.sleep_s(0.2)
        assert bench.clock.now_s() - began_s <= LONGEST_S
    tally.fired = len(bench.device.wire.fired)
    assert bench.monitor.blamed_on_host == []
    assert tally.worst_mm <= 0.05
    return tally


@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("seed", [1, 2])
def test_random_faults_never_pass_off_a_wrong_place_as_right(dialect: Dialect, seed: int) -> None:
    tally = survive(dialect, seed, 60)
    assert tally.fired >= 50
    assert tally.arrived >= 20


@pytest.mark.soak
@pytest.mark.timeout(0)
@pytest.mark.parametrize("dialect", BOTH, ids=name_of)
@pytest.mark.parametrize("seed", range(5))
def test_ten_thousand_faults_never_pass_off_a_wrong_place_as_right(dialect: Dialect, seed: int) -> None:
    tally = survive(dialect, 1000 + seed, 5000)
    assert tally.fired >= 4900
