"""What can be locked is locked at what was told or found, and what the device did not let is said."""

from __future__ import annotations

from typing import Any

import cv2
import pytest

from calibration_free_tests.camera.emulated_bench import Bench, settings
from drivers.camera_locks import lock_controls
from rig.errors import HardwareError

WEBCAM = {
    cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
    cv2.CAP_PROP_EXPOSURE: 157.0,
    cv2.CAP_PROP_AUTO_WB: 1.0,
    cv2.CAP_PROP_WB_TEMPERATURE: 4600.0,
    cv2.CAP_PROP_AUTOFOCUS: 1.0,
    cv2.CAP_PROP_FOCUS: 30.0,
    cv2.CAP_PROP_GAIN: 12.0,
}


class Device(dict[int, float]):
    """Controls and their values; ``stubborn`` ones say yes and stay."""

    stubborn: frozenset[int] = frozenset()

    def set(self, prop: int, value: float) -> bool:
        if prop in self and prop not in self.stubborn:
            self[prop] = value
        return prop in self

    def get(self, prop: int) -> float:  # type: ignore[override]  # OpenCV's get has no default
        return dict.get(self, prop, -1.0)


def locks(device: Device, **told: Any) -> dict[str, Any]:
    return {lock.name: lock for lock in lock_controls(device, settings(**told))}


def test_told_values_are_set_and_the_automatics_are_off() -> None:
    device = Device(WEBCAM)
    found = locks(device, exposure_s=0.012, white_balance_k=5200.0, focus=45.0, gain=3.0)
    assert {name: (lock.held, lock.value) for name, lock in found.items()} == {
        "exposure": (True, 0.012),
        "white_balance": (True, 5200.0),
        "focus": (True, 45.0),
        "gain": (True, 3.0),
    }
    assert device[cv2.CAP_PROP_EXPOSURE] == 120.0  # V4L2 counts in 100 microseconds
    assert [device[p] for p in (cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_AUTO_WB, cv2.CAP_PROP_AUTOFOCUS)] == [1, 0, 0]


def test_what_is_not_told_stays_where_the_automatics_have_brought_it() -> None:
    class FallsBack(Device):
        """Goes back to an old manual value when its automatic is switched off, as many webcams do."""

        def set(self, prop: int, value: float) -> bool:
            if prop == cv2.CAP_PROP_AUTO_EXPOSURE:
                self[cv2.CAP_PROP_EXPOSURE] = 3.0
            return super().set(prop, value)

    device = FallsBack(WEBCAM)
    found = locks(device)
    assert set(found) == {"exposure", "white_balance", "focus"}
    assert all(lock.held for lock in found.values())
    assert device[cv2.CAP_PROP_EXPOSURE] == 157.0
    assert device[cv2.CAP_PROP_GAIN] == 12.0


def test_what_the_bench_leaves_automatic_is_not_touched() -> None:
    device = Device(WEBCAM)
    assert set(locks(device, automatic=("focus", "exposure"))) == {"white_balance"}
    assert device[cv2.CAP_PROP_AUTOFOCUS] == 1.0
    assert device[cv2.CAP_PROP_AUTO_EXPOSURE] == 3.0


@pytest.mark.parametrize(
    ("controls", "stubborn", "trouble"),
    [
        ({}, [], "offers no such control"),
        (WEBCAM, [cv2.CAP_PROP_AUTO_EXPOSURE], "keeps its automatic on"),
        (WEBCAM, [cv2.CAP_PROP_EXPOSURE], r"holds 0.0157 instead of 0.012"),
    ],
)
def test_what_the_device_does_not_let_lock_is_told(
    controls: dict[int, float], stubborn: list[int], trouble: str
) -> None:
    device = Device(controls)
    device.stubborn = frozenset(stubborn)
    lock = locks(device, exposure_s=0.012)["exposure"]
    assert not lock.held
    assert trouble in lock.trouble


def test_connecting_tells_what_became_of_each_control() -> None:
    bench = Bench(controls=WEBCAM, stubborn=frozenset({cv2.CAP_PROP_AUTOFOCUS}), exposure_s=0.02)
    assert bench.camera.locks == ()
    bench.camera.connect()
    told = {lock.name: lock for lock in bench.camera.locks}
    assert told["exposure"].held
    assert told["white_balance"].held
    assert told["focus"].trouble == "the device keeps its automatic on"


def test_a_size_that_the_camera_does_not_give_is_refused() -> None:
    bench = Bench(width_px=1280, height_px=720)
    with pytest.raises(HardwareError, match=r"gives 64x48 pixels, not 1280x720"):
        bench.camera.connect()
    assert not bench.captures[0].isOpened()
