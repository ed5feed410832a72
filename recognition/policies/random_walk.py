"""The policy to beat: any reachable view, drawn evenly."""

from __future__ import annotations

from recognition.policies import Situation
from recognition.steps import Move


class RandomPolicy:
    """Draws the next view evenly from all candidates."""

    def choose(self, situation: Situation) -> Move | None:
        """A candidate drawn evenly; ``None`` if all have been visited."""
        if not situation.candidates:
            return None
        pick = int(situation.rng.integers(len(situation.candidates)))
        return Move(
            situation.candidates[pick],
            f"drawn at random from {len(situation.candidates)} reachable views",
            cost_s=float(situation.cost_s[pick]),
        )
