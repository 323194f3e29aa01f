"""YAML of users: repeated keys, nesting, aliases and excessive size are each refused in one line."""

import os
import time

import pytest

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import read_budget
from gliderhpc.mission.settings import build_settings
from gliderhpc.platform import platform_text, read_platform, with_overrides
from gliderhpc.simulator import load_scenario
from gliderhpc.yaml_text import MAX_FILE_BYTES, parse_yaml

READERS = {"platform": read_platform, "scenario": load_scenario, "budget": read_budget}

BOMB = "a: &a [x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)

CASES = {
    "a key twice": (
        "depth: 100\nprofiles: 2\ndepth: 200\n",
        "the key 'depth' occurs twice, first at line 1; remove one at line 3",
    ),
    "a key twice below": ("actuation:\n  pitch: 20\n  pitch: 25\n", "the key 'pitch' occurs twice, first at line 2"),
    "10,000 levels": ("a: " + "[" * 10_000, "nested more than 20 levels deep"),
    "deep sections": ("".join(" " * n + f"k{n}:\n" for n in range(60)), "nested more than 20 levels deep"),
    "an alias bomb": (BOMB, "the alias '*"),
    "itself": ("a: &a [*a]\n", "the alias '*a' is not accepted: there are too many"),
    "too large": ("# " + "x" * MAX_FILE_BYTES, "MB large, too large for a"),
    "thousands of digits": ("depth: " + "9" * 5000, "a value cannot be read"),
    "no date": ("start: 2024-02-31\n", "a value cannot be read"),
    "no key": ("? [1, 2]\n: 3\n", "not YAML at line 1"),
    "control characters": ("name: \x00\n", "not YAML"),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("case", CASES)
def test_odd_yaml_is_refused_in_one_line(tmp_path, kind, case):
    content, words = CASES[case]
    path = tmp_path / "file.yaml"
    path.write_text(content)
    began = time.monotonic()
    with pytest.raises(InputError) as refused:
        READERS[kind](path)
    assert time.monotonic() - began < 5.0
    assert str(refused.value).startswith(f"{path}: ")
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 400 + len(str(path))


@pytest.mark.parametrize("kind", READERS)
def test_a_pipe_is_not_waited_for(tmp_path, kind):
    pipe = tmp_path / "hull.yaml"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="it is not a regular file; give a YAML"):
        READERS[kind](pipe)


@pytest.mark.parametrize("year", [1600, 9999])
def test_a_mission_begins_in_the_years_of_gliders(tmp_path, year):
    path = tmp_path / "late.yaml"
    path.write_text(f"start: {year}-05-01T00:00:00\n")
    with pytest.raises(InputError, match="start is datetime"):
        load_scenario(path)


def test_a_byte_order_mark_and_a_few_aliases_are_read(tmp_path):
    path = tmp_path / "hull.yaml"
    path.write_text("\ufeff" + platform_text("petrel-l"), "utf-8")
    assert read_platform(path) == read_platform("petrel-l")
    assert parse_yaml("base: &b {x: 1}\nmore: {<<: *b, y: 2}\nless: *b\n", "") == {
        "base": {"x": 1}, "more": {"x": 1, "y": 2}, "less": {"x": 1}
    }  # fmt: skip


@pytest.mark.parametrize("value", ["nan", ".nan", ".inf", "-.inf", "1e400", "9" * 5000, "[[[[" * 3000])
def test_invalid_numbers_are_refused_in_one_short_line(value):
    with pytest.raises(InputError) as refused:
        build_settings({}, {"window.length": value})
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 400
    with pytest.raises(InputError) as refused:
        with_overrides(read_platform("petrel-l"), {"mass.total": value})
    assert len(str(refused.value)) < 400
