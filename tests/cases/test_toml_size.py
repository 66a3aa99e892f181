"""The cost of parsing a case file is counted before a parser reads it: keys with many parts and nested brackets."""

import tomllib

import numpy as np
import pytest

from barbalat import InputError
from barbalat.cases import load
from barbalat.cases.load import MOST_NESTED, TomlSize, bundled, parse_case
from barbalat.studies import Budget

TEXTS = {
    "a = 1": (1, 1 + 1 + 1),
    "a.b.c = 1": (3, 9 + 1 + 3),
    "a . b\t.c = 'x.y.z'": (3, 9 + 1 + 3),
    '"a.b"."c = d".\'e.f\' = 0': (3, 9 + 1 + 3),
    "[a.b]\nc.d = 1": (2, 4 + 4 + 1 + 2),
    "# a.b.c.d = 1": (0, 0),
    'a = """x.y.z = 1\n\\""" b.c.d.e = 2"""': (1, 1 + 1),
    "a = '''x.y.z.u '' = 1\nb.c.d.e'''": (1, 1 + 1),
    'a = "x\\".b.c.d"': (1, 1 + 1 + 1),
    "a = { b.c = 1, d.e.f = 2 }": (3, 1 + 4 + 1 + 9 + 1 + 3 * 3),
    "a\nb\nc": (1, 3),  # not TOML, but counted
}


@pytest.mark.parametrize("text", TEXTS)
def test_keys_are_counted_and_texts_and_comments_are_not(text):
    size = TomlSize.of(text)
    assert (size.longest, size.pairs) == TEXTS[text]


def test_brackets_are_counted_where_they_are_brackets():
    assert TomlSize.of("a = [[1, [2]], {b = [3]}]  # [[[[[[").nested == 3
    assert TomlSize.of('a = "[[[[["\n[[b]]\nc = 1').nested == 2


@pytest.mark.parametrize("name", bundled())
def test_bundled_cases_are_small(name):
    text = bundled()[name].read_text("utf-8")
    size = TomlSize.of(text)
    assert size.nested <= 3 and size.longest <= 3
    assert size.pairs < len(text)


@pytest.mark.parametrize(
    "text", ['"' * 2001, "'''" * 2001, '"""' + "x" * 5000, '"' + "\\" * 5001, "a." * 3000, "[" * 3000, '"""' + '\\"' * 5000]
)
def test_what_is_no_toml_is_counted_too(text):
    assert TomlSize.of(text).pairs >= 0
    with pytest.raises(InputError):
        parse_case(text)


def test_the_count_is_linear():
    """A text of twice the length has twice the tokens, because nothing is read twice, even with unclosed brackets."""
    for unit in ("a.b = 1\n", '"', "'", '"""', "'''", "[", "\\", '"\\"', "x\n"):
        sizes = [sum(1 for _ in load_tokens(unit * count)) for count in (1000, 2000)]
        assert sizes[1] <= 2 * sizes[0] + 2


def load_tokens(text: str):
    from barbalat.cases.load import TOKEN

    return TOKEN.finditer(text)


def test_a_key_of_very_many_parts_is_refused_before_it_is_parsed(monkeypatch):
    monkeypatch.setattr(load.tomllib, "loads", lambda *_, **__: pytest.fail("it was parsed"))
    for text in (".".join("a" * 100_000) + " = 1", "[" + ".".join("a" * 100_000) + "]", "x = { " + "b." * 100_000 + "c = 1 }"):
        with pytest.raises(InputError, match=r"case has a key of 10000\d parts separated by dots.*; at most 200 can be read"):
            parse_case(text)


@pytest.mark.parametrize("text", ["[reference_model]\n{} = 1", "[{}]", "reference_model = {{ {} = 1 }}"])
def test_a_key_of_more_parts_than_tables_may_be_nested_is_refused_at_any_budget(text):
    told = []
    with Budget(memory=1e15, seconds=1e9, told=told.append):
        for parts in (30_000, MOST_NESTED + 1):
            with pytest.raises(InputError, match=rf"a key of {parts} parts separated by dots; at most 200 can be read"):
                parse_case(text.format(".".join("a" * parts)))
        with pytest.raises(InputError) as refused:
            parse_case(text.format(".".join("a" * MOST_NESTED)))
    assert "parts" not in str(refused.value) and not told


def test_keys_headers_and_lists_that_are_as_deep_as_may_be_are_an_unknown_key():
    key = ".".join("a" * MOST_NESTED)
    with pytest.raises(InputError, match="unknown key a"):
        parse_case(f"[{key}]\n{key} = {'[' * MOST_NESTED}1{']' * MOST_NESTED}")


def test_many_keys_of_many_parts_are_counted_together():
    lines = "\n".join(f"{'a.' * 99}b{i} = 1" for i in range(100))
    with Budget(memory=4.0 * 100 * 100**2 / 2), pytest.raises(InputError, match="a key of 100 parts"):
        parse_case(lines)


def test_brackets_beyond_pythons_calls_are_refused_in_a_sentence():
    for opened, closed in (("[", "]"), ("{a=", "}")):
        inside = f"a = {opened * (MOST_NESTED + 1)}1{closed * (MOST_NESTED + 1)}"
        with pytest.raises(InputError, match="the case has 201 nested lists or tables; at most 200 can be read"):
            parse_case(inside)
        as_many = f"a = {opened * MOST_NESTED}1{closed * MOST_NESTED}"
        tomllib.loads(as_many)
        with pytest.raises(InputError) as refused:
            parse_case(as_many)
        assert "nested lists" not in str(refused.value)


def test_random_texts_are_counted_as_the_parser_reads_them():
    """If tomllib accepts a text, its deepest table has no more levels than the longest key and header together."""
    rng = np.random.default_rng(22)
    words = ["a", "b", ".", " = ", "1", "\n", "[", "]", '"', "'", "#", "{", "}", ",", "1.5", "\\"]
    taken = 0
    for _ in range(3000):
        text = "".join(rng.choice(words, rng.integers(3, 14)))
        size = TomlSize.of(text)
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError:
            continue
        taken += 1
        assert depth(tables) <= 2 * size.longest + size.nested
    assert taken > 100


def depth(part: object) -> int:
    if isinstance(part, dict):
        return 1 + max(map(depth, part.values()), default=0) if part else 0
    return max(map(depth, part), default=0) if isinstance(part, list) else 0
