"""The latency timer of FTDI adapters: how long they keep bytes back. 16 ms unless set, on every answer of a servo."""

from __future__ import annotations

from pathlib import Path

from drivers.serial_link import SerialPort, open_serial
from drivers.serial_ports import resolve_port
from rig.errors import HardwareError

_SYSFS = Path("/sys/class/tty")


def latency_timer_ms(device: str, sysfs: Path = _SYSFS) -> int | None:
    """The timer of a port, ms; ``None`` where it has none. ``device`` is its own path, links resolved."""
    timer = _timer(device, sysfs)
    return int(timer.read_text()) if timer.exists() else None


def lower_latency_timer(device: str, most_ms: int, sysfs: Path = _SYSFS) -> None:
    """Set the timer to ``most_ms`` where it is longer.

    Raises:
        HardwareError: it is longer, and this user may not change it.
    """
    now_ms = latency_timer_ms(device, sysfs)
    if now_ms is None or now_ms <= most_ms:
        return
    timer = _timer(device, sysfs)
    try:
        timer.write_text(f"{most_ms}\n")
    except OSError as error:
        raise HardwareError(
            f"{device}: the adapter's latency timer is {now_ms} ms, more than {most_ms} ms. "
            f"Run: echo {most_ms} | sudo tee {timer}, or set latency_timer_ms to {now_ms} in the bench file"
        ) from error


def open_prompt(name: str, baud: int, most_ms: int) -> SerialPort:
    """Open and lock a port for this process alone, with a latency timer of at most ``most_ms``.

    Raises:
        HardwareError: as `drivers.serial_link.open_serial` and `lower_latency_timer`.
    """
    port = open_serial(name, baud)
    try:
        lower_latency_timer(resolve_port(name), most_ms)
    except (HardwareError, OSError):
        port.close()
        raise
    return port


def _timer(device: str, sysfs: Path) -> Path:
    return sysfs / Path(device).name / "device" / "latency_timer"
