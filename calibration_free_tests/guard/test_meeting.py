"""Two processes of one user meet, whatever their environment and whichever name their bench files have for the port."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rig.errors import InputError
from rig.runtime import runtime_folder

ROOT = Path(__file__).parents[2]


# The folder.


def folder_of_a_process(environment: dict[str, str], home: Path) -> str:
    """Where a process with nothing else in its environment meets others; ``home`` stands for the folder /tmp."""
    code = (
        "import sys\nfrom pathlib import Path\nimport rig.runtime.folder as folder\n"
        "folder.SHARED = Path(sys.argv[1])\nprint(folder.runtime_folder())"
    )
    command = [sys.executable, "-c", code, str(home)]
    answer = subprocess.run(
        command, env={"PYTHONPATH": str(ROOT), **environment}, capture_output=True, text=True, timeout=30.0
    )
    assert answer.returncode == 0, answer.stderr
    return answer.stdout.strip()


def test_processes_of_one_user_meet_whatever_their_environment(tmp_path: Path) -> None:
    session, temporary = tmp_path / "session", tmp_path / "temporary"
    for folder in (session, temporary):
        folder.mkdir(mode=0o700)
    of_cron = folder_of_a_process({}, tmp_path)
    assert of_cron == str(tmp_path / f"rig-{os.getuid()}")
    of_a_login = folder_of_a_process(
        {"XDG_RUNTIME_DIR": str(session), "TMPDIR": str(temporary), "HOME": str(session), "USER": "x"}, tmp_path
    )
    assert of_a_login == of_cron


def test_who_asks_for_a_folder_of_his_own_meets_nobody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "apart"))
    assert runtime_folder() == tmp_path / "apart"
    assert runtime_folder().stat().st_mode & 0o777 == 0o700
    monkeypatch.setenv("RIG_RUNTIME_DIR", "apart")
    with pytest.raises(InputError, match="RIG_RUNTIME_DIR to a full path"):
        runtime_folder()


@pytest.mark.parametrize("spoiled", ["others may write", "a file", "a link", "no such place"])
@pytest.mark.parametrize("apart", [True, False], ids=["a folder of its own", "the shared place"])
def test_a_runtime_folder_that_is_not_private_is_refused(
    spoiled: str, apart: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "missing" if spoiled == "no such place" else tmp_path
    folder = place / f"rig-{os.getuid()}"
    if apart:
        monkeypatch.setenv("RIG_RUNTIME_DIR", str(folder))
    else:
        monkeypatch.delenv("RIG_RUNTIME_DIR", raising=False)
        monkeypatch.setattr("rig.runtime.folder.SHARED", place)
    if spoiled == "a file":
        folder.touch()
    elif spoiled == "others may write":
        assert runtime_folder() == folder
        folder.chmod(0o777)
    elif spoiled == "a link":
        (tmp_path / "mine").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match=r"[sS]et RIG_RUNTIME_DIR"):
        runtime_folder()
