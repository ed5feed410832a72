"""Takes a picture at each pose of a plan, stores it while the rig moves on, and stops where something is not right."""

from __future__ import annotations

import enum
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass

from rig.devices import Clock
from rig.errors import HardwareError, RigError
from rig.guard.ways import Play, arrived, legs
from rig.hal import Frame, Rig, RigPose
from rig.imagegrid import GridFrame
from rig.scan.order import OneSided, overshoot
from rig.scan.store import FrameStore


class Finish(enum.Enum):
    """How a scan ended."""

    RUNNING = "running"
    DONE = "done"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Target:
    """A pose that a picture is wanted from, and the file that it goes to."""

    pose: RigPose
    file: str


def numbered(poses: Iterable[RigPose], suffix: str = ".png") -> Iterator[Target]:
    """Targets with the files ``images/00001.png`` and so on; the poses may come one by one, from a planner."""
    for number, pose in enumerate(poses, start=1):
        yield Target(pose, f"images/{number:05d}{suffix}")


class Scan:
    """Iterate over it: each frame that comes out is acknowledged, safe on the disk.

    A picture is stored while the rig moves to the next pose, and the next is not exposed before it is safe: a kill
    loses at most the picture in hand. If the rig, a picture or the disk fails, the picture in hand is stored if that
    can be done, and the error is raised; the rig is then at rest.

    Args:
        rig: moves and takes the pictures.
        targets: where; any iterable, asked for the next only when it is needed.
        store: keeps the pictures.
        clock: for the pauses.
        sides: axes that are approached from one side.
        bad_frames: errors by which the rig's camera says that it gives pictures, but bad ones.
        retries: how often a bad picture is taken again.
        pause_s: waited before each retry.
        stop: asked before and after each move; true ends the scan. A move that fails while it is true was broken off
            for it, and is no fault.

    Attributes:
        finish: how it ended.
        broken_off: what a move that was broken off said of it; empty if none was.
    """

    def __init__(
        self,
        rig: Rig,
        targets: Iterable[Target],
        store: FrameStore,
        *,
        clock: Clock,
        sides: Sequence[OneSided] = (),
        bad_frames: tuple[type[HardwareError], ...] = (),
        retries: int = 2,
        pause_s: float = 1.0,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.finish = Finish.RUNNING
        self.broken_off = ""
        self._rig, self._targets, self._store, self._clock = rig, targets, store, clock
        self._overshoot, self._retries, self._pause_s = overshoot(sides), retries, pause_s
        self._bad_frames, self._stop = bad_frames, stop
        self._play: Play | None = None

    def __iter__(self) -> Iterator[GridFrame]:
        """Run.

        Raises:
            HardwareError: a device failed, or pictures stay bad.
            UnreachableError: a pose cannot be reached.
            RigError: a picture cannot be stored.
        """
        try:
            yield from self._frames()
        except BaseException as error:
            stopped = isinstance(error, KeyboardInterrupt | GeneratorExit)
            self.finish = Finish.INTERRUPTED if stopped else Finish.FAILED
            raise

    def _frames(self) -> Iterator[GridFrame]:
        for target in self._targets:
            if self._stop():
                self.finish = Finish.INTERRUPTED
                break
            arrived = yield from self._go(target.pose)
            if not arrived:
                self.finish = Finish.INTERRUPTED
                return
            try:
                frame = self._good_frame(target)
            except RigError as error:
                if not self._stop():
                    raise
                # Ctrl-C has held the motion just before the picture: it is no fault of the bench.
                self.finish, self.broken_off = Finish.INTERRUPTED, str(error)
                break
            self._store.put(frame, target.file)
        else:
            self.finish = Finish.DONE
        yield from self._stored()

    def _go(self, pose: RigPose) -> Generator[GridFrame, None, bool]:
        """Move, and meanwhile see the picture in hand safe; says if the rig has arrived and the scan goes on."""
        try:
            for leg in legs(self._play or Play(pose), pose, self._overshoot):
                if self._stop():
                    break
                self._rig.move_to(leg)
            self._play = arrived(pose, self._overshoot)
        except RigError as error:
            yield from self._stored()
            if not self._stop():
                raise
            self.broken_off = str(error)
        yield from self._stored()
        return not self._stop()

    def _stored(self) -> Iterator[GridFrame]:
        frame = self._store.collect()
        if frame is not None:
            yield frame

    def _good_frame(self, target: Target) -> Frame:
        trouble = ""
        for attempt in range(self._retries + 1):
            if attempt:
                self._clock.sleep_s(self._pause_s)
            try:
                return self._rig.capture()
            except self._bad_frames as error:
                trouble = str(error)
        raise HardwareError(
            f"{target.file}: no good picture at {target.pose} in {self._retries + 1} attempts: {trouble}. "
            "Look at the camera and the light, then go on with --resume"
        )
