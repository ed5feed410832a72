"""Halts a servo: goal := where it stands or can brake to, or torque off where its policy says so or the goal fails."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.dynamixel.servo import Servo
from drivers.dynamixel.table import GOAL, TORQUE, WATCHDOG, ServoState
from drivers.serial_link import LinkLostError
from rig.devices import StopReport
from rig.errors import HardwareError


def halt(servo: Servo) -> StopReport:
    """Stop now, as the torque policy says, and wait until at rest. Never raises."""
    if servo.settings.torque_at_stop == "release":
        return _switch_off(servo)
    report = _stop_here(servo)
    if report.confirmed:
        return report
    second = _switch_off(servo)
    sent_at_s = second.sent_at_s if report.sent_at_s is None else report.sent_at_s
    outcome = "was switched off instead" if second.confirmed else f"could not be switched off: {second.trouble}"
    trouble = f"{report.trouble}. Its torque {outcome}"
    return StopReport(sent_at_s, second.confirmed, second.position_kept, trouble)


def _stop_here(servo: Servo) -> StopReport:
    """Goal := present, or where it can brake to on its way."""

    def refuse_limp(states: Mapping[int, ServoState]) -> None:
        # One that has let go is at rest, and after a reboot its count is another: no goal for it.
        for state in states.values():
            servo.see(state)
            if not state.torque:
                raise HardwareError(f"{servo.name} has let go: its torque is off")

    sent_at_s: float | None = None
    try:
        state = servo.read()
        sent_at_s = servo.bus.clock.now_s()
        # One that has let go, or was stopped by its watchdog, stands already.
        if state.torque and state.watchdog >= 0:
            servo.write(GOAL, state.halt_ticks, refuse_limp)
        return _await_rest(servo, sent_at_s)
    except HardwareError as error:
        return StopReport(_sent(sent_at_s, error), False, False, str(error))


def _switch_off(servo: Servo) -> StopReport:
    """Torque off, even if nothing can be read."""
    sent_at_s = servo.bus.clock.now_s()
    try:
        servo.write(TORQUE, 0)
        return _await_rest(servo, sent_at_s)
    except HardwareError as error:
        return StopReport(_sent(sent_at_s, error), False, False, str(error))


def _await_rest(servo: Servo, sent_at_s: float) -> StopReport:
    clock, settings = servo.bus.clock, servo.settings
    braking_s = settings.speed_deg_per_s / settings.acceleration_deg_per_s2
    deadline_s = clock.now_s() + braking_s + settings.stop_s
    state = servo.read()
    while not state.at_rest:
        if clock.now_s() > deadline_s:
            late_s = clock.now_s() - sent_at_s
            late = f"{servo.name} still moves {late_s:.1f} s after it was stopped. Switch its power off"
            return StopReport(sent_at_s, False, servo.turns is not None, late)
        clock.sleep_s(settings.poll_s)
        state = servo.read()
    if state.watchdog > 0:
        servo.write(WATCHDOG, 0)
    return StopReport(sent_at_s, True, servo.turns is not None)


def _sent(at_s: float | None, error: HardwareError) -> float | None:
    return None if isinstance(error, LinkLostError) else at_s
