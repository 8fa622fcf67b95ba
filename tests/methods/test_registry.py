"""Methods by name: parameters in the name, and errors that say what would do."""

import pytest

from jaxvis import methods
from jaxvis.methods import MonteCarlo, Reference


def test_names_make_methods():
    assert methods.create("mc-mis") == MonteCarlo(strategy="mis")
    assert methods.create("mc-mis:spp=16,compensation=true") == MonteCarlo("mis", 16, True)
    assert methods.create("reference:error=0.01") == Reference(error=0.01)
    assert methods.create("reference:rows=none") == Reference()
    assert methods.create(MonteCarlo("brdf")) == MonteCarlo("brdf")


def test_overrides_fill_what_the_name_leaves_open():
    assert methods.create("mc-mis:spp=16", spp=4) == MonteCarlo("mis", 16)
    assert methods.create("mc-mis", spp=4) == MonteCarlo("mis", 4)
    assert methods.create("reference", spp=4) == Reference()
    assert methods.create("mc-mis", spp=None) == MonteCarlo("mis")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("mc-mi", r"unknown method 'mc-mi': did you mean mc-mis\b.*mc-brdf"),
        ("", "unknown method ''"),
        ("mc-mis:ssp=3", "has no parameter 'ssp'; it has spp, compensation"),
        ("mc-mis:strategy=brdf", "has no parameter 'strategy'"),
        ("mc-mis:spp", "'spp' is not parameter=value"),
        ("mc-mis:spp=1,spp=2", "spp is set twice"),
        ("mc-mis:spp=many", "spp must be int, got 'many'"),
        ("mc-mis:spp=0", "spp must be at least 1, got 0"),
        ("mc-mis:compensation=maybe", "compensation must be true or false, got 'maybe'"),
        ("mc-brdf:compensation=true", "compensation needs strategy 'mis'"),
        ("reference:error=-1", "error must be positive"),
    ],
)
def test_a_wrong_spec_says_what_is_wrong(spec, message):
    with pytest.raises(ValueError, match=message):
        methods.create(spec)


def test_lists_keep_parameters_with_their_method():
    assert methods.parse_list("mc-mis:spp=4,compensation=true,mc-brdf") == [
        "mc-mis:spp=4,compensation=true",
        "mc-brdf",
    ]
    every = methods.parse_list("all")
    assert set(every) == set(methods.names()) - {"reference"}
    with pytest.raises(ValueError, match="'spp=4' follows no method"):
        methods.parse_list("spp=4,mc-mis")
    with pytest.raises(ValueError, match="no methods given"):
        methods.parse_list(" , ")


def test_each_family_but_the_reference_has_one_representative():
    families = {entry.family for entry in methods.table()} - {"reference"}
    names = [spec.partition(":")[0] for spec in methods.representatives()]
    chosen = [entry.family for entry in methods.table() if entry.name in names]
    assert sorted(chosen) == sorted(families)
    assert all(methods.create(spec) for spec in methods.representatives())


def test_registering_a_name_twice_is_refused():
    with pytest.raises(ValueError, match="registered already"):
        methods.register("mc-mis", MonteCarlo, family="monte-carlo", summary="again")


def test_every_default_makes_a_method_with_parameters():
    for entry in methods.table():
        method = methods.create(entry.name)
        assert entry.summary
        assert set(entry.defaults()) <= set(method.parameters())


def test_parameters_of_several_kinds_are_numbers_or_names():
    assert methods.create("vectorized:sharpness=paper").sharpness == "paper"
    assert methods.create("vectorized:sharpness=7.5").sharpness == 7.5
    assert methods.create("vectorized:pieces=3").pieces == 3
    assert methods.create("vectorized:pieces=none").pieces is None
    with pytest.raises(
        ValueError, match="sharpness must be float or one of paper, scaled, got 'x'"
    ):
        methods.create("vectorized:sharpness=x")
    with pytest.raises(ValueError, match="pieces must be int, got"):
        methods.create("vectorized:pieces=2.5")
