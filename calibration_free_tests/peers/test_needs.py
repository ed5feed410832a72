"""Without the extra ``peers`` there is one clear message, with the remedy, before any work begins."""

from __future__ import annotations

import pytest

from benchmarks.peers import castle, needs, pose
from rig.errors import InputError


def test_missing_packages_are_named_with_the_remedy() -> None:
    with pytest.raises(InputError, match=r"no_such_peer not installed\. .*pip install -e '\.\[peers\]'"):
        needs.require(("json", "no_such_peer"))
    needs.require(("json",))


@pytest.mark.parametrize("command", [pose, castle])
def test_the_commands_look_for_their_packages_first(
    command: object, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(needs, "find_spec", lambda name: None)
    monkeypatch.setattr("sys.argv", ["peers"])
    with pytest.raises(SystemExit) as end:
        command.main()  # type: ignore[attr-defined]  # both modules have it
    assert end.value.code == 2
    told = capsys.readouterr()
    assert "pycolmap" in told.err
    assert "pip install -e '.[peers]'" in told.err
    assert "Traceback" not in told.err + told.out
