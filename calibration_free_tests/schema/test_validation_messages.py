"""Schema errors tell file, line, column, path, what is wrong and what to do, all of one file at once."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field

from rig.errors import InputError
from rig.schema import MAX_PROBLEMS, parse_yaml, validate


class Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Direction(StrEnum):
    UP = "up"
    DOWN = "down"


class Axis(Strict):
    limits_mm: tuple[float, float]
    speed_mm_s: Annotated[float, Field(gt=0)] = 1.0
    steps: int = 0
    direction: Direction = Direction.UP


class Grbl(Strict):
    kind: Literal["grbl"]
    port: str


class Mock(Strict):
    kind: Literal["mock"]
    folder: str | None = None


class Bench(Strict):
    axes: dict[str, Axis]
    device: Annotated[Grbl | Mock, Field(discriminator="kind")] = Mock(kind="mock")
    names: list[str] = []
    spare: Axis | None = None
    quiet: bool = False


GOOD = "axes:\n  x: {limits_mm: [0, 10.5], direction: down}\n"


def problems(text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        validate(Bench, parse_yaml(text, "rig.yaml"))
    return str(caught.value).splitlines()


def test_a_good_file_gives_the_frozen_model() -> None:
    bench = validate(Bench, parse_yaml(GOOD, "rig.yaml"))
    assert bench.axes["x"] == Axis(limits_mm=(0.0, 10.5), direction=Direction.DOWN)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "axes:\n  x:\n    limits_mm: [0, 1]\n    sped_mm_s: 3\n",
            "rig.yaml:4:5: axes.x.sped_mm_s: unknown key. Did you mean 'speed_mm_s'?",
        ),
        (GOOD + "qiet: true\n", "rig.yaml:3:1: qiet: unknown key. Did you mean 'quiet'?"),
        (GOOD + "spare: {limits_mm: [0, 1], stepz: 1}\n", "rig.yaml:3:28: spare.stepz: unknown key. "
         "Did you mean 'steps'?"),
        (GOOD + "device: {kind: grbl, prot: a, port: b}\n", "rig.yaml:3:22: device.prot: unknown key. "
         "Did you mean 'port'?"),
        ("axes:\n  x: {steps: 1}\n", "rig.yaml:2:6: axes.x.limits_mm: this key is missing. Add `limits_mm: ...`."),
        ("axes:\n  x: {limits_mm: [0, '1']}\n", "rig.yaml:2:22: axes.x.limits_mm[1]: should be a number, "
         "not the text '1'. Remove the quotes."),
        ("axes:\n  x: {limits_mm: [0, ten]}\n", "rig.yaml:2:22: axes.x.limits_mm[1]: should be a number, "
         "not the text 'ten'"),
        ("axes:\n  x: {limits_mm: [0]}\n", "rig.yaml:2:18: axes.x.limits_mm: the list is too short: "
         "entry 2 is missing"),
        (GOOD + "quiet: 1\n", "rig.yaml:3:8: quiet: should be true or false, not 1"),
        (GOOD + "names: a\n", "rig.yaml:3:8: names: should be a list, not the text 'a'"),
        ("axes: [1]\n", "rig.yaml:1:7: axes: should be a mapping (lines of `key: value`), not a list"),
        ("- 1\n", "rig.yaml:1:1: should be a mapping (lines of `key: value`), not a list"),
        ("axes:\n  x: {limits_mm: [0, 1], speed_mm_s: -1}\n",
         "rig.yaml:2:38: axes.x.speed_mm_s: should be greater than 0 (it is -1)"),
        ("axes:\n  x: {limits_mm: [0, 1], direction: upp}\n",
         "rig.yaml:2:37: axes.x.direction: should be 'up' or 'down', not the text 'upp'. Did you mean 'up'?"),
        ("axes:\n  x: {limits_mm: [0, 1], steps: 1.5}\n",
         "rig.yaml:2:33: axes.x.steps: should be a whole number, not 1.5"),
    ],
)  # fmt: skip
def test_each_problem_has_place_path_and_words(text: str, expected: str) -> None:
    assert problems(text) == [expected]


def test_an_unknown_kind_of_device_is_told_at_its_place() -> None:
    (line,) = problems(GOOD + "device:\n  kind: grlb\n")
    assert line.startswith("rig.yaml:4:")
    assert "should be 'grbl' or 'mock', not the text 'grlb'" in line


def test_all_problems_of_a_file_are_told_at_once() -> None:
    found = problems("axes:\n  x: {limits_mm: [a, 1], stps: 3}\nquiet: maybe\n")
    assert [line.split(" ")[1] for line in found] == ["axes.x.limits_mm[0]:", "axes.x.stps:", "quiet:"]


def test_the_list_of_problems_is_bounded() -> None:
    found = problems("axes: {}\nnames: [" + ", ".join("1" * 50) + "]\n")
    assert len(found) == MAX_PROBLEMS + 1
    assert found[-1] == "... and 30 more problems"


def test_a_list_with_a_wrong_entry_is_not_called_too_short() -> None:
    class Holder(Strict):
        axes: Annotated[list[Axis], Field(min_length=1)]

    with pytest.raises(InputError) as caught:
        validate(Holder, parse_yaml("axes:\n- {steps: a}\n", "t"))
    assert "at least" not in str(caught.value)
    with pytest.raises(InputError, match="needs at least 1 entries, has 0"):
        validate(Holder, parse_yaml("axes: []\n", "t"))
