"""Strict YAML: what one reader reads as another would is accepted, all else is refused with its place and a remedy."""

from __future__ import annotations

import contextlib
import json
import math
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.errors import ImageGridError, InputError
from rig.schema import BENCH_MAX_BYTES, load_yaml, parse_yaml
from rig.strictyaml import MAX_DEPTH, plain_scalar

REFUSED: dict[str, tuple[str, str, str]] = {
    # name: (text, place, words that the message must hold)
    "anchor": ("a: 1\nb: &x 2\n", "2:4", "anchors"),
    "alias": ("a: &x [1]\nb: *x\n", "1:4", "anchors"),
    "alias bomb": ("a: &a [x, x]\nb: &b [*a, *a]\n", "1:4", "anchors"),
    "merge key": ("a: {b: 1}\nc:\n  <<: {d: 2}\n", "3:3", "merge keys"),
    "python tag": ("a: 1\nb: !!python/object/apply:os.system ['true']\n", "2:4", "tags"),
    "standard tag": ("a: !!str 1\n", "1:4", "tags"),
    "own tag": ("a: !thing 1\n", "1:4", "tags"),
    "duplicate key": ("a: 1\nb: 2\na: 3\n", "3:1", "'a' stands twice"),
    "duplicate key inside": ("a:\n  - {x: 1, y: 2, x: 3}\n", "2:18", "'x' stands twice"),
    "duplicate quoted key": ("a: 1\n'a': 2\n", "2:1", "stands twice"),
    "list as key": ("? [1, 2]\n: 3\n", "1:3", "key must be a word"),
    "number as key": ("1: one\n", "1:1", "could be read as something else"),
    "off as key": ("off: 1\n", "1:1", "could be read as something else"),
    "null as key": ("a: {~: 1}\n", "1:5", "could be read as something else"),
    "second document": ("a: 1\n---\nb: 2\n", "2:1", "second document"),
    "directive": ("%YAML 1.1\n---\na: 1\n", "1:1", "directives"),
    "tag directive": ("%TAG ! tag:x,2000:\n---\na: 1\n", "1:1", "directives"),
    "base 60": ("a: 1:30\n", "1:4", "base 60"),
    "octal": ("a: 010\n", "1:4", "different numbers"),
    "new octal": ("a: 0o10\n", "1:4", "different numbers"),
    "hexadecimal": ("a: [0x1F]\n", "1:5", "different numbers"),
    "binary": ("a: 0b101\n", "1:4", "different numbers"),
    "underscores": ("a: 1_000\n", "1:4", "different numbers"),
    "no leading digit": ("a: .5\n", "1:4", "different numbers"),
    "no trailing digit": ("a: 5.\n", "1:4", "different numbers"),
    "plus sign": ("a: +5\n", "1:4", "different numbers"),
    "off": ("a: off\n", "1:4", "truth value"),
    "Yes": ("a: Yes\n", "1:4", "truth value"),
    "True": ("a: True\n", "1:4", "truth value"),
    "not a number": ("a: .nan\n", "1:4", "not a finite number"),
    "infinity": ("a: -.inf\n", "1:4", "not a finite number"),
    "infinity in words": ("a: Infinity\n", "1:4", "not a finite number"),
    "overflow": ("a: 1e400\n", "1:4", "too large"),
    "endless integer": (f"a: {'9' * 5000}\n", "1:4", "5000 characters"),
    "date": ("a: 2024-01-31\n", "1:4", "date"),
    "nothing": ("a:\nb: 1\n", "1:3", "no value"),
    "tilde": ("a: ~\n", "1:4", "no value"),
    "equals sign": ("a: =\n", "1:4", "special meaning"),
    "deep nesting": ("[" * 20_000, f"1:{MAX_DEPTH + 1}", "levels of nesting"),
    "deep mappings": ("{a: " * 5_000, f"1:{4 * MAX_DEPTH + 1}", "levels of nesting"),
    "open bracket": ("a: [1, 2\nb: 3\n", "2:2", "not YAML"),
    "tab": ("a:\n\tb: 1\n", "2:1", "not YAML"),
    "control character": ("a: 1\nb: x\x07y\n", "2:5", "not allowed"),
    "empty": ("", "1:1", "empty"),
    "comment only": ("# nothing\n", "1:1", "empty"),
}


@pytest.mark.parametrize(("text", "place", "words"), REFUSED.values(), ids=REFUSED.keys())
def test_ambiguous_yaml_is_refused_with_place_and_remedy(text: str, place: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        load_yaml(file, max_bytes=BENCH_MAX_BYTES)
    assert caught.value.where == f"{file}:{place}"
    assert words in caught.value.message
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("10", 10), ("-0.5", -0.5), ("1e3", 1000.0), ("0", 0), ("-0", 0), ("true", True), ("null", None),
        ("word", "word"), ("y", "y"), ("1.2.3", "1.2.3"), ("12 mm", "12 mm"), ("/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("10:aa", "10:aa"), ("2024-run", "2024-run"), ("nano", "nano"), ("only", "only"),
    ],
)  # fmt: skip
def test_plain_values_mean_what_json_says(text: str, value: Any) -> None:
    read, trouble = plain_scalar(text)
    assert trouble is None
    assert read == value
    assert type(read) is type(value)


def test_quoted_values_are_always_text() -> None:
    assert parse_yaml("a: 'off'\nb: \"010\"\nc: ''\n", "t").data == {"a": "off", "b": "010", "c": ""}


def test_all_ambiguous_values_are_told_at_once() -> None:
    with pytest.raises(InputError) as caught:
        parse_yaml("a: 010\nb: off\nc: [1, .5]\n", "rig.yaml")
    assert [line.split(" ")[0] for line in str(caught.value).splitlines()] == [
        "rig.yaml:1:4:",
        "rig.yaml:2:4:",
        "rig.yaml:3:8:",
    ]


def test_file_over_the_limit_is_refused_without_reading_it_all(tmp_path: Path) -> None:
    file = tmp_path / "big.yaml"
    with file.open("wb") as stream:
        stream.truncate(200 * 1024 * 1024)
    tracemalloc.start()
    with pytest.raises(InputError, match="larger than 256 KiB"):
        load_yaml(file, max_bytes=BENCH_MAX_BYTES)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2 * 1024 * 1024


def test_bytes_that_are_not_utf8_are_told_with_their_place(tmp_path: Path) -> None:
    file = tmp_path / "latin.yaml"
    file.write_bytes("a: 1\nb: é\n".encode("latin-1"))
    with pytest.raises(InputError, match="0xe9 is not UTF-8") as caught:
        load_yaml(file, max_bytes=BENCH_MAX_BYTES)
    assert caught.value.where == f"{file}:2:4"


def test_utf16_is_refused_and_a_utf8_mark_is_not(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_bytes("a: 1\n".encode("utf-16"))
    with pytest.raises(InputError, match="not UTF-8"):
        load_yaml(file, max_bytes=BENCH_MAX_BYTES)
    file.write_bytes("a: é\n".encode("utf-8-sig"))
    assert load_yaml(file, max_bytes=BENCH_MAX_BYTES).data == {"a": "é"}


@pytest.mark.parametrize("name", ["absent.yaml", ".", "nul\0.yaml"])
def test_paths_that_are_no_files_are_input_errors(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(f"{tmp_path}/{name}", max_bytes=BENCH_MAX_BYTES)
    assert caught.value.remedy


def test_the_kind_of_error_can_be_chosen(tmp_path: Path) -> None:
    with pytest.raises(ImageGridError):
        load_yaml(tmp_path / "absent.yaml", max_bytes=10, error=ImageGridError)
    for text in ("a: 010", "a: &x 1", "a: ["):
        with pytest.raises(ImageGridError):
            parse_yaml(text, "t", error=ImageGridError)


def test_places_are_found_after_reading() -> None:
    document = parse_yaml("a:\n  b: [1, {c: 2}]\n  'd e': 3\n", "t.yaml")
    assert document.where(("a", "b", 1, "c")) == "t.yaml:2:14"
    assert document.where(("a", "b", 1, "c"), key=True) == "t.yaml:2:11"
    assert document.where(("a", "d e"), key=True) == "t.yaml:3:3"
    assert document.where(("a", "b", 1, "gone", "deeper")) == "t.yaml:2:10"


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**30), 10**30) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs", "Cc"])),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("abcxyz-_ ", min_size=1), inner, max_size=4),
    max_leaves=20,
)  # fmt: skip


@given(json_values)
def test_any_json_document_reads_as_json_reads_it(value: Any) -> None:
    assert parse_yaml(json.dumps(value, ensure_ascii=False), "t").data == json.loads(json.dumps(value))


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_but_never_crashes(text: str) -> None:
    with contextlib.suppress(InputError):
        parse_yaml(text, "t")


@given(st.text("0123456789.eE+-_:xob", min_size=1, max_size=12))
def test_what_looks_like_a_number_is_a_finite_number_as_in_json_or_text(text: str) -> None:
    value, trouble = plain_scalar(text)
    if trouble is None and not isinstance(value, str):
        assert math.isfinite(value)
        assert json.loads(text) == value
