"""The list of effects explains all of them."""

from __future__ import annotations

import itertools

import pytest

from evergym.agents.cli import main
from evergym.agents.effect_pages import describe_effect
from evergym.agents.effect_separations import SEPARATIONS
from evergym.effects.catalogue import EFFECTS
from evergym.model import load_model


def test_list_names_every_effect(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "250")
    assert main(["effects"]) == 0
    words = capsys.readouterr().out.split()
    assert [name for name in EFFECTS if name not in words] == []


def test_explanation_has_law_parameters_and_partners(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "250")
    assert main(["effects", "tendon_backlash"]) == 0
    text = capsys.readouterr().out
    for part in ("play operator", "backlash_mm", "0.363", "tendon_stretch", "Pull, release and pull again"):
        assert part in text


def test_mistyped_name_is_suggested(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "tendon_backlsh"]) == 1
    assert "Did you mean 'tendon_backlash'?" in capsys.readouterr().err


def test_every_parameter_is_explained() -> None:
    """With a source or marked as prior, and within limits; the pages would show an empty cell."""
    model = load_model("mammobot_2023")
    pages = [describe_effect(name, model) for name in EFFECTS]
    bare = [f"{page.name}.{row.key}" for page in pages for row in page.parameters if not row.source]
    assert bare == []
    assert [page.name for page in pages if len(page.law) < 40 or not page.info.moves] == []


def test_every_partner_can_be_separated() -> None:
    """A sentence for every pair, and none for a pair that is not taken for each other."""
    pairs = {frozenset((name, partner)) for name, kind in EFFECTS.items() for partner in kind.info.partners}
    explained = {frozenset(pair) for group in SEPARATIONS for pair in itertools.combinations(group, 2)}
    assert sorted(map(sorted, pairs - explained)) == []
    for group in SEPARATIONS:
        assert set(group) <= set(EFFECTS)
        for name in group:
            assert any(frozenset((name, other)) in pairs for other in group), f"{name} in {group}"
