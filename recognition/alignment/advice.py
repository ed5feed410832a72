"""What a scan does not tell about the mount, why, and how to scan so that it does."""

from __future__ import annotations

from recognition.alignment.estimate import MountEstimate
from recognition.alignment.moves import Moves

Y_IS_SILENT = (
    "y_mm cannot be seen from pans: the camera's height on the rotation axis moves all that is seen up or down alike. "
    "Leave it, or measure it with a ruler; only the height of the answer depends on it"
)

_WIDE_PAN_DEG = 10.0
_SHARP_PX, _MOST_AGREE, _MUCH_WORSE = 1.5, 0.8, 2.0


def advice(estimate: MountEstimate) -> tuple[str, ...]:
    """One sentence or two for each thing that the scan leaves open, and for a fit that is not to be trusted."""
    told = []
    arm = [name for name in ("x_mm", "z_mm") if name in estimate.open]
    if arm:
        told.append(f"{_and(arm)} of the lever arm: {_about_arm(estimate.moves)}")
    angles = [name for name in ("pan_zero_deg", "roll_deg", "pitch_deg") if name in estimate.open]
    if angles:
        told.append(f"{_and(angles)}: {_about_angles(estimate, angles)}")
    for unit, name in (("mm", "moves in x, y and z"), ("degrees", "pans")):
        expected, off = ((s.mm if unit == "mm" else s.deg) for s in (estimate.told, estimate.off))
        if off > _MUCH_WORSE * expected:
            told.append(
                f"{name} were off by {off:.2g} {unit} (sd), not by {expected:.2g} as was expected. The sds reckon with "
                "that as chance. If it is none (a wrong scale or gear ratio, a slipping screw, a zoom or focus that "
                "creeps), values are off by more. Mend it, or tell it in the bench file's `motion`"
            )
    if estimate.residual_px > _SHARP_PX:
        told.append(
            f"the fit is poor ({estimate.residual_px:.1f} px): pictures may be blurred, or the target may have moved. "
            "Expect values to be off by more than their sd"
        )
    if estimate.explained < _MOST_AGREE:
        told.append(
            f"only {estimate.explained:.0%} of the matches agree with the fit: the target repeats itself, something "
            "moved in the pictures, or the camera's internals changed. Expect values to be off by more than their sd"
        )
    return tuple(told)


def _about_arm(moves: Moves) -> str:
    if not moves.pans:
        return (
            "the scan has no pan moves, and only the pan swings the camera about the axis. "
            "Scan the same target at three pans or more, 10 degrees or more apart"
        )
    if moves.pan_span_deg < _WIDE_PAN_DEG:
        return (
            f"the pans span only {moves.pan_span_deg:.1f} degrees. "
            f"Scan over {_WIDE_PAN_DEG:g} degrees or more, as far as the target stays in view"
        )
    return "the views that pan share too little of the target. Use more pans, a larger target, or one with more texture"


def _about_angles(estimate: MountEstimate, angles: list[str]) -> str:
    still = [axis for axis, moved in zip("xyz", estimate.moves.moved, strict=True) if not moved]
    against = sorted({name for angle in angles for name in estimate.open[angle]} - set(angles))
    trade = f"turning the camera looks like another {_and(against)}. " if against else ""
    if still:
        axes = _and(still)
        return (
            f"{trade}The scan has no moves in {axes}. "
            f"Add moves in {axes} by a fifth of the distance to the target or more, and several pans"
        )
    if not estimate.moves.pans:
        return f"{trade}The scan has no pan moves. Scan at three pans or more"
    small = "The moves are too few, or too small beside the distance to the target"
    return f"{trade}{small}. Make them larger, or go nearer"


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
