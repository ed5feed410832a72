"""The doctor on pseudo-terminals, with this computer's own ports, locks and clock; short, since it does wait."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from calibration_free_tests.doctor.sample import Workbench, text_of
from rig.bench import load_bench
from rig.doctor import Finding, Verdict, examine, this_computer
from sim_backends.pty_server import PtyServer

HOLD = (
    "import sys; from drivers.serial_link import open_serial\n"
    "port = open_serial(sys.argv[1], 115200); print('open', flush=True); sys.stdin.read()"
)


def serial_lines(bench: Workbench, gantry: PtyServer, bus: PtyServer) -> list[Finding]:
    """What is found on the serial ports; there is no camera."""
    bench.file["devices"]["gantry"]["port"] = gantry.path
    for role in ("pan", "zoom"):
        # A pseudo-terminal on a busy machine answers late now and then.
        bench.file["devices"][role] |= {"port": bus.path, "latency_timer_ms": 100}
    world = replace(this_computer(), runtime=bench.world.runtime, disk=bench.world.disk)
    findings = list(examine(load_bench(bench.bench_file), world, bench.folder))
    return [finding for finding in findings if finding.subject in ("gantry", "pan", "zoom")]


def test_a_healthy_bench_passes_through_real_ports(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    with PtyServer(bench.gantry_wire) as gantry, PtyServer(bench.bus_line) as bus, bench.untouched():
        findings = serial_lines(bench, gantry, bus)
    assert {finding.subject for finding in findings} == {"gantry", "pan", "zoom"}
    assert {finding.ok for finding in findings} == {Verdict.PASS}, text_of(findings)


def test_a_process_that_holds_a_real_port_is_named(tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    with PtyServer(bench.gantry_wire) as gantry, PtyServer(bench.bus_line) as bus:
        command = [sys.executable, "-c", HOLD, gantry.path]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "open\n"
            findings = serial_lines(bench, gantry, bus)
            holder.kill()
    (held,) = [finding for finding in findings if finding.ok is Verdict.FAIL]
    assert (held.subject, held.what) == ("gantry", "in use")
    assert f"in use by process {holder.pid}" in held.told
