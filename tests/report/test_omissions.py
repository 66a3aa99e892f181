"""Sentences on schemes that are left out, on terminals and pages."""

from barbalat.report.omissions import grouped_omissions


def test_schemes_that_are_omitted_for_one_reason_share_a_sentence():
    others = "all schemes but robust-mrac and linear support uncertainty.input_gain"
    given = [
        "gains above 100 are not tried",
        f"Robust MRAC is omitted: robust-mrac takes the input gain as known; {others}",
        "mit-rule is omitted: it declares no tunable setting",
        f"Normalised MRAC is omitted: mrac-normalized takes the input gain as known; {others}",
        "known-parameters is omitted: it declares no tunable setting",
        "ADRC is omitted: adrc needs independent columns of plant.b",
    ]
    assert grouped_omissions(given) == [
        "gains above 100 are not tried",
        "Robust MRAC, Normalised MRAC are omitted: each takes the input gain as known",
        "mit-rule, known-parameters are omitted: they declare no tunable setting",
        given[-1],
    ]


def test_names_with_commas_are_told_apart():
    given = [f"{name} is omitted: mrac takes the input gain as known" for name in ("MRAC, closed-loop model", "L1 piecewise")]
    assert grouped_omissions(given) == ["MRAC, closed-loop model; L1 piecewise are omitted: each takes the input gain as known"]
