"""YAML from strangers."""

import time

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from scenes.files.strict_yaml import MAX_BYTES, key_path, load_yaml, read_text
from scenes.input_error import InputError


def is_word(text):
    """PyYAML writes 1e5 without quotes, because YAML 1.1 takes it for text."""
    try:
        float(text)
    except ValueError:
        return True
    return False


WORDS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=8).filter(is_word)
SCALARS = st.one_of(st.none(), st.booleans(), st.integers(-(10**6), 10**6), st.floats(allow_nan=False), WORDS)
DATA = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=4), max_leaves=20
)


@given(DATA)
def test_what_pyyaml_writes_is_read_back(data):
    text = yaml.safe_dump(data, allow_unicode=True)
    if "&id" not in text:
        assert load_yaml(text, "it") == data


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("010", 10),
        ("1:30", "1:30"),
        ("on", "on"),
        ("'1'", "1"),
        ("2024-01-01", "2024-01-01"),
        ("1_000", "1_000"),
        ("~", None),
        ("-.5", -0.5),
        ("1e999", float("inf")),
        ("9" * 5000, float("inf")),
    ],
)
def test_scalars_mean_what_they_look_like(text, value):
    assert load_yaml(f"key: {text}", "it") == {"key": value}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\na: 2", "it: the key 'a' appears twice (line 2)"),
        ("a: {b: [{c: 1, c: 2}]}", "it: a.b[0]: the key 'c' appears twice (line 1)"),
        ("a: 1\n---\nb: 1", "it: expected one document, a second begins (line 2)"),
        ("1: 2", "it: expected a key, got 1 (line 1)"),
        ("? [1, 2]\n: 3", "it: expected a key, got [1, 2] (line 1)"),
        ("a: !!python/object/apply:os.system [ls]", "are not allowed (line 1)"),
        ("a: &x [1, *x]", "alias *x refers to a node that contains it or comes later"),
        ("a: *x", "alias *x refers to a node that contains it or comes later"),
        ("a: [1, 2", "not YAML (did not find expected"),
        ("a: \x07", "not YAML"),
    ],
)
def test_each_fault_is_one_line_that_says_where(text, expected):
    with pytest.raises(InputError) as error:
        load_yaml(text, "it")
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_aliases_are_followed():
    assert load_yaml("a: &x [1, 2]\nb: *x\nc: {d: *x}", "it") == {"a": [1, 2], "b": [1, 2], "c": {"d": [1, 2]}}


def test_merge_keys_are_keys_like_any_other():
    assert load_yaml("a: &x {b: 1}\nc: {<<: *x}", "it")["c"] == {"<<": {"b": 1}}


def bomb(levels):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (bomb(12), "once its aliases are followed"),
        ("[" * 200_000, "nested deeper"),
        ("- " * 200_000, "nested deeper"),
        ("{a: " * 200_000, "nested deeper"),
    ],
    ids=["aliases", "brackets", "dashes", "braces"],
)
def test_bombs_are_refused_sooner_than_a_plain_list_of_ten_thousand_words_is_read(text, expected):
    begin = time.perf_counter()
    with pytest.raises(InputError, match=expected):
        load_yaml(text, "it")
    refused = time.perf_counter() - begin
    assert load_yaml("[" + "x, " * 10_000 + "]", "it") == ["x"] * 10_000
    assert refused < time.perf_counter() - begin - refused


def test_key_paths_read_as_one_writes_them():
    assert key_path(["surfaces", 3, "vertices", 0]) == "surfaces[3].vertices[0]"
    assert key_path([]) == ""


def test_files_that_are_none_or_too_large_or_no_text_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_text(tmp_path / "missing.yaml")
    with pytest.raises(InputError, match="not a plain file"):
        read_text(tmp_path)
    large = tmp_path / "large.yaml"
    with large.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(InputError, match="larger than 32 MiB"):
        read_text(large)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes("name: Geröll".encode("latin-1"))
    with pytest.raises(InputError, match="byte 9 is not"):
        read_text(latin)


def test_a_byte_order_mark_is_no_part_of_the_first_key(tmp_path):
    marked = tmp_path / "marked.yaml"
    marked.write_bytes(b"\xef\xbb\xbfname: x")
    assert load_yaml(read_text(marked), "it") == {"name": "x"}
