"""Without the extra ``peers`` there is one clear message, with the remedy, before any work begins."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from benchmarks.peers import castle, needs, pose
from rig.errors import InputError


def test_missing_packages_are_named_with_the_remedy() -> None:
    with pytest.raises(InputError, match=r"no_such_peer not installed\. .*pip install -e '\.\[peers\]'"):
        needs.require(("json", "no_such_peer"))
    needs.require(("json",))


@pytest.mark.parametrize("peers", [pose, castle])
def test_the_commands_look_for_their_packages_first(
    peers: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(needs, "find_spec", lambda name: None)
    monkeypatch.setattr("sys.argv", ["peers"])
    with pytest.raises(SystemExit) as end:
        needs.command(peers.main)
    assert end.value.code == 2
    told = capsys.readouterr()
    assert "pycolmap" in told.err
    assert "pip install -e '.[peers]'" in told.err
    assert told.out == ""


def test_without_photographs_the_castle_says_where_it_looked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(castle, "require", lambda packages: None)
    monkeypatch.setattr(castle, "quiet", lambda: None)
    monkeypatch.setattr("sys.argv", ["castle", "--data", str(tmp_path)])
    with pytest.raises(SystemExit):
        needs.command(castle.main)
    told = capsys.readouterr().err
    assert str(tmp_path) in told
    assert "RIG_REAL_DATA" in told
