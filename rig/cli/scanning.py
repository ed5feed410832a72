"""Command that takes pictures from many poses into an image grid: scan."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from rig.cli.help import example
from rig.cli.homing import HomeFirst, home_first
from rig.cli.showing import print_json
from rig.clock import SystemClock

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.bench import BenchConfig
    from rig.hal import Rig, RigPose
    from rig.imagegrid import GridInfo, GridWriter
    from rig.scan import Estimate, Scan, ScanPlan, Target

DONE, INTERRUPTED = 0, 130


def register(app: typer.Typer) -> None:
    """Add the command."""
    epilog = example(
        "rig scan examples/scan.yaml --bench bench.yaml --home --out grids/model",
        "rig scan examples/scan.yaml --bench bench.yaml --out grids/model --resume",
    )
    app.command(epilog=epilog)(scan)


def scan(
    plan_file: Annotated[Path, typer.Argument(metavar="PLAN", help="A scan plan (YAML).")],
    bench: Annotated[
        Path | None, typer.Option("--bench", metavar="BENCH", help="A bench file; may be left out where --grid is.")
    ] = None,
    grid: Annotated[
        Path | None, typer.Option("--grid", metavar="DIR", help="Put another image grid into a mock bench.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the scan in --out; nothing that is good is taken again.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="The new image grid's folder. [default: a new one under grids/]"),
    ] = None,
    home: HomeFirst = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was done as one JSON object.")] = False,
) -> None:
    """Take a picture from every pose of a plan, into an image grid that a mock bench can serve.

    All poses are checked, and time and disk space estimated, before anything moves. Ctrl-C stops the motion, stores the
    picture in hand and ends; twice is STOP. A scan that ended early, in whatever way, goes on with --resume.
    """
    from rig.bench import default_bench_for_grid, load_bench, open_rig
    from rig.errors import InputError
    from rig.scan import ScanRecord, load_plan, refuse_other_scan

    plan = load_plan(plan_file)
    if bench is None and grid is None:
        raise InputError("there is nothing to scan with", where="--bench", remedy="Name a bench file")
    if resume and out is None:
        raise InputError("which scan is to go on?", where="--resume", remedy="Name its folder with --out")
    config = load_bench(bench) if bench is not None else default_bench_for_grid(grid or Path())
    folder = out or Path("grids") / f"{datetime.now():%Y%m%d-%H%M%S}_{plan_file.stem}"
    if resume:
        # Before the bench is taken and homed: what can be seen from here should cost nobody a minute.
        refuse_other_scan(folder, ScanRecord.of(config, grid, plan, datetime.now(UTC)))
    with open_rig(config, grid) as rig:
        session = Session(rig, config, grid, plan, folder, resume, sys.stderr if as_json else sys.stdout)
        if home:
            if not resume:
                session.preflight(plan.poses)
            home_first(rig)
        try:
            code = session.run()
        finally:
            if as_json and session.scan is not None:
                print_json(session.result())
    raise typer.Exit(code)


class Session:
    """One call of ``rig scan``: what is to be done, and what was."""

    def __init__(
        self,
        rig: Rig,
        config: BenchConfig,
        grid: Path | None,
        plan: ScanPlan,
        folder: Path,
        resume: bool,
        stream: TextIO,
    ) -> None:
        self.rig, self.config, self.grid, self.plan = rig, config, grid, plan
        self.folder, self.resume, self.stream = folder, resume, stream
        self.scan: Scan | None = None
        self.expected: Estimate | None = None
        self.clock = SystemClock()
        self.begun_s = self.clock.now_s()
        self.kept = self.taken = 0

    def run(self) -> int:
        """Check, estimate, scan; returns the exit code.

        Raises:
            RigError: whatever kept the scan from its end; what is in the folder is safe.
        """
        from rig.cli.progress import shown
        from rig.scan import ScanRecord, numbered, open_scan_folder

        if not self.resume:
            self.preflight(self.plan.poses)
        targets = list(numbered(self.plan.poses, self.plan.suffix))
        if not self.resume:
            # Before the folder is made: a scan that does not fit should leave nothing behind.
            self._expect(targets, None)
        record = ScanRecord.of(self.config, self.grid, self.plan, datetime.now(UTC))
        with open_scan_folder(
            self.folder,
            record,
            self._info(),
            resume=self.resume,
            progress=lambda frames: shown(frames, "checking"),
        ) as writer:
            for message in writer.mended:
                typer.echo(f"mended: {message}", err=True)
            good = {frame.file for frame in writer.frames}
            targets = [target for target in targets if target.file not in good]
            self.kept = len(good)
            if self.resume:
                # Only what is missing is driven, by other ways than the whole plan.
                self.preflight([target.pose for target in targets])
                self._expect(targets, writer)
            return self._go(targets, writer)

    def result(self) -> dict[str, Any]:
        """What was done, as plain JSON."""
        return {
            "folder": str(self.folder),
            "outcome": None if self.scan is None else self.scan.finish.value,
            "planned": len(self.plan.poses),
            "kept": self.kept,
            "taken": self.taken,
            "seconds": round(self.clock.now_s() - self.begun_s, 3),
            "estimate": None if self.expected is None else asdict(self.expected),
        }

    def preflight(self, poses: Sequence[RigPose]) -> None:
        """Check the poses that will be gone to, and the ways between them.

        Raises:
            InputError: one cannot be gone to.
        """
        from rig.errors import InputError, UnreachableError
        from rig.scan import all_legs, preflight

        try:
            preflight(self.rig, list(all_legs(poses, self.plan.sides)))
        except UnreachableError as error:
            raise InputError(str(error), where=self.plan.name) from error

    def _expect(self, targets: list[Target], writer: GridWriter | None) -> None:
        """Tell how long it will take and how much disk; refuse what does not fit."""
        from rig.imagegrid.writer import encode_image
        from rig.scan import all_legs, estimate, refuse_small_disk
        from rig.scan.preflight import size_words, time_words

        sizes = [frame.size_bytes for frame in writer.frames if frame.size_bytes] if writer is not None else []
        if targets and not sizes:
            sizes = [len(encode_image(self.rig.capture().image, Path(targets[0].file), self.plan.quality))]
        mean = sum(sizes) / max(1, len(sizes))
        moves = list(all_legs((target.pose for target in targets), self.plan.sides))
        self.expected = found = estimate(self.rig, len(targets), moves, mean, self.folder)
        print(
            f"{found.frames} pictures to take: about {time_words(found.seconds)}, at most "
            f"{size_words(found.bytes_needed)} of {size_words(found.bytes_free)} free",
            file=self.stream,
            flush=True,
        )
        refuse_small_disk(found, self.folder)

    def _info(self) -> GridInfo:
        from rig.imagegrid import GridInfo

        note = f"; {self.plan.note}" if self.plan.note else ""
        return GridInfo(
            provenance=f"scanned by rig scan {self.plan.name} on {self.config.name}{note}",
            internals="fixed_by_zoom" if self.rig.internals_fixed_by_zoom else "change_every_view",
        )

    def _go(self, targets: list[Target], writer: GridWriter) -> int:
        from drivers.frame_checks import BadFrameError
        from rig.cli.interrupt import ends_gently
        from rig.cli.progress import shown
        from rig.scan import BackgroundStore, Finish, Scan

        plan = self.plan
        with BackgroundStore(writer, plan.quality) as store, ends_gently(self.rig) as stop:
            self.scan = Scan(
                self.rig,
                targets,
                store,
                clock=self.clock,
                sides=plan.sides,
                bad_frames=(BadFrameError,),
                retries=plan.retries,
                pause_s=plan.pause_s,
                stop=stop,
            )
            try:
                for _ in shown(self.scan, "scanning", len(targets)):
                    self.taken += 1
            except KeyboardInterrupt:
                self.scan.finish = Finish.INTERRUPTED
                raise
            finally:
                self._tell(self.scan)
        return DONE if self.scan.finish is Finish.DONE else INTERRUPTED

    def _tell(self, scan: Scan) -> None:
        from rig.scan import Finish

        print(f"{self.folder}: {self.kept + self.taken} of {len(self.plan.poses)} pictures", file=self.stream)
        if scan.broken_off:
            typer.echo(f"broken off: {scan.broken_off}", err=True)
        if scan.finish is not Finish.DONE:
            # A session that ends so leaves no record of where the gantry was homed.
            home = "--home " if self.config.is_live else ""
            typer.echo(f"to go on, add {home}--out {shlex.quote(str(self.folder))} --resume", err=True)
