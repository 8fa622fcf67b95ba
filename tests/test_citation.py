"""BibTeX of the methods."""

import re
from dataclasses import dataclass

import pytest

import jaxvis
from jaxvis.methods import citations, registry


def entries(text: str) -> dict[str, dict[str, str]]:
    """A small reader of BibTeX: fields by key. Braces must balance."""
    assert text.count("{") == text.count("}")
    found = {}
    for entry in text.split("\n\n"):
        first, *lines, last = entry.splitlines()
        assert last == "}"
        kind, key = re.fullmatch(r"@(\w+)\{([\w-]+),", first).groups()
        fields = [re.fullmatch(r"  (\w+) = \{(.*)\},", line).groups() for line in lines]
        assert key not in found
        found[key] = {"kind": kind, **dict(fields)}
    return found


@pytest.mark.parametrize("name", registry.names())
def test_every_registered_method_has_one(name):
    for fields in entries(jaxvis.citation(name)).values():
        assert fields["author"]
        assert fields["title"]
        if fields["kind"] == "article":
            assert fields["journal"]
        if fields["kind"] == "inproceedings":
            assert fields["booktitle"]
        if fields["kind"] != "misc":
            assert 1980 < int(fields["year"]) < 2030


@pytest.mark.parametrize(
    ("name", "doi"),
    [
        ("correspondence", "10.1109/ACCESS.2021.3084611"),
        ("visibility-field", "10.2312/sr.20221158"),
        ("adaptive", "10.1016/j.cag.2013.10.036"),
        ("hybrid-cones", "10.1109/ACCESS.2020.2994597"),
    ],
)
def test_the_four_papers_come_first(name, doi):
    first = next(iter(entries(jaxvis.citation(name)).values()))
    assert first["doi"] == doi


def test_what_a_method_is_set_to_counts():
    plain = set(entries(jaxvis.citation("mc-mis")))
    compensated = set(entries(jaxvis.citation("mc-mis:compensation=true")))
    assert compensated - plain == {"karlik2019mis"}
    assert "veach1995optimally" in plain
    assert "veach1995optimally" not in entries(jaxvis.citation("mc-brdf"))
    both = set(entries(jaxvis.citation("mc-mis+denoise:compensation=true")))
    assert both - compensated == {"oidn"}


def test_an_object_is_cited_as_its_name_is():
    assert jaxvis.citation(jaxvis.MonteCarlo("mis")) == jaxvis.citation("mc-mis")
    assert jaxvis.citation("mc-ides-acdf") != jaxvis.citation("mc-ides")


def test_every_work_is_used():
    used = {key for name in registry.names() for key in entries(jaxvis.citation(name))}
    assert used | {"karlik2019mis", "oidn"} == set(citations.WORKS)


def test_an_unknown_name_is_one_line_with_suggestions():
    with pytest.raises(ValueError, match=r"'vectorised': did you mean vectorized"):
        jaxvis.citation("vectorised")
    with pytest.raises(ValueError, match="has no parameter 'zeto'"):
        jaxvis.citation("vectorized:zeto=1")


def test_a_method_of_ones_own_is_refused_not_misattributed():
    @dataclass(frozen=True)
    class Mine(jaxvis.Reference):
        pass

    with pytest.raises(ValueError, match="no citation is known for Mine") as caught:
        jaxvis.citation(Mine())
    assert "\n" not in str(caught.value)
