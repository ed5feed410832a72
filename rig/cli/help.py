"""What the commands' help has in common."""

from __future__ import annotations


def example(*lines: str) -> str:
    r"""An epilog that shows examples; ``\b`` keeps its lines as they are."""
    return "\b\nExample:\n" + "\n".join(f"  {line}" for line in lines)
