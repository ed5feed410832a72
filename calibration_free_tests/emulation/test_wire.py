"""The faulty wire takes short cuts where no fault is near; they must change nothing."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backends.faults import Fault, FaultKind, FaultyWire, Side, WireByte, random_script

KINDS = list(FaultKind)
MESSAGE = b"\xff\xff\xfd\x00\x01\xff\xff\xff\xfd\x00"


def script_of(rng: np.random.Generator) -> list[Fault]:
    """Faults of all triggers: by time, by byte and by message."""
    timed = list(random_script(rng, list(rng.uniform(0.0, 3.0, 20)), KINDS))
    numbers = rng.integers(0, 3000, 40)
    by_byte = [Fault(FaultKind.FLIP, at_byte=int(n), mask=4) for n in numbers[:20]]
    by_message = [Fault(FaultKind.DROP, Side.FROM_DEVICE, at_message=int(n) // 8, count=3) for n in numbers[20:]]
    return [*timed, *by_byte, *by_message]


@pytest.mark.parametrize("seed", range(5))
def test_bytes_arrive_alike_whether_sent_at_once_or_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    script = script_of(rng)
    at_once, one_by_one = (FaultyWire(script, boundary=MESSAGE[:4], seconds_per_byte=1e-4) for _ in range(2))
    for now_s in np.cumsum(rng.exponential(0.01, 300)):
        data = (MESSAGE * 3)[: int(rng.integers(1, 30))]
        for side in Side:
            singly: list[WireByte] = []
            for value in data:
                singly += one_by_one.carry(side, bytes([value]), float(now_s))
            assert at_once.carry(side, data, float(now_s)) == singly
        assert at_once.due(float(now_s)) == one_by_one.due(float(now_s))
    assert at_once.fired == one_by_one.fired
    assert len(at_once.fired) >= 40


def test_faults_of_one_moment_strike_in_the_order_of_the_script() -> None:
    wire = FaultyWire(
        [Fault(FaultKind.DROP, at_byte=0), Fault(FaultKind.DROP, at_s=0.0), Fault(FaultKind.FLIP, at_byte=0)]
    )
    arriving = wire.carry(Side.TO_DEVICE, b"abcd", 0.0)
    assert [chr(byte.value) for byte in arriving] == [chr(ord("c") ^ 1), "d"]
