"""The truth generator: what it draws, and that the plan and the model do not give it away."""

from __future__ import annotations

import collections

import numpy as np
import pytest

from evergym.config import to_mapping
from evergym.discrepancy.blind.hidden import HIDDEN, list_hidden
from evergym.discrepancy.blind.outside import OUTSIDE
from evergym.discrepancy.blind.rig import NOMINALS, OFF, list_nominals
from evergym.discrepancy.blind.truth import BLOCK, Kind, Truth, draw_truth, find_kind
from evergym.discrepancy.parameters import get_value, list_paths
from evergym.model import check_model

CASES = 120


@pytest.fixture(scope="module")
def truths() -> list[Truth]:
    return [draw_truth(31, index) for index in range(CASES)]


def test_a_seed_draws_the_same_case_again() -> None:
    first, second = draw_truth(31, 5), draw_truth(31, 5)
    assert first.to_json() == second.to_json()
    assert first.lab == second.lab
    for one, other in zip(first.plans, second.plans, strict=True):
        assert np.array_equal(one.commands, other.commands)
        assert (one.id, one.experiment, one.setup, one.gravity) == (
            other.id,
            other.experiment,
            other.setup,
            other.gravity,
        )


def test_another_seed_or_attempt_draws_another_case() -> None:
    case = draw_truth(31, 5).to_json()
    assert draw_truth(32, 5).to_json() != case
    assert {**draw_truth(31, 5, attempt=1).to_json(), "attempt": 0} != case


def test_every_dozen_cases_holds_every_kind_in_its_share() -> None:
    for block in range(3):
        kinds = [find_kind(31, len(BLOCK) * block + i) for i in range(len(BLOCK))]
        assert collections.Counter(kind for kind, _ in kinds) == collections.Counter(BLOCK)
    orders = {tuple(find_kind(seed, i)[0] for i in range(len(BLOCK))) for seed in range(20)}
    assert len(orders) > 10  # the number of a case does not say its kind


def test_cases_of_a_kind_are_counted_through() -> None:
    numbers = [find_kind(31, i) for i in range(60)]
    for kind in Kind:
        assert [number for found, number in numbers if found is kind] == list(range(5 * BLOCK.count(kind)))


def test_at_least_half_of_the_single_effects_have_another_form(truths: list[Truth]) -> None:
    single = [truth for truth in truths if truth.kind is Kind.SINGLE]
    other = [truth for truth in single if truth.parts[0].form == "other"]
    assert 2 * len(other) >= len(single)
    assert all(HIDDEN[truth.parts[0].name].has_form for truth in other)


def test_all_outside_effects_come_in_turn(truths: list[Truth]) -> None:
    outside = [truth.parts[0].name for truth in truths if truth.kind is Kind.OUTSIDE]
    counts = collections.Counter(outside)
    assert set(counts) == set(OUTSIDE)
    assert max(counts.values()) - min(counts.values()) <= 1
    assert not set(OUTSIDE) & set(list_hidden())


def test_a_campaign_is_what_a_lab_would_run(truths: list[Truth]) -> None:
    for truth in truths:
        assert 10 <= len(truth.plans) <= 20
        assert 100.0 <= sum(plan.duration for plan in truth.plans) <= 155.0
        assert len({plan.experiment for plan in truth.plans}) >= 5
        assert len({plan.id for plan in truth.plans}) == len(truth.plans)
        repeats = collections.Counter(plan.experiment for plan in truth.plans)
        assert max(repeats.values()) >= 2


def test_the_hidden_effects_are_not_in_the_lab_s_model(truths: list[Truth]) -> None:
    for truth in truths:
        for part in truth.parts:
            if part.form == "outside":
                continue
            known = to_mapping(truth.known)["effects"][part.name]
            for key, value in OFF.get(part.name, {}).items():
                assert known[key] == value
            assert any(known[key] != value for key, value in part.values.items())


def test_what_is_off_does_not_say_what_is_missing(truths: list[Truth]) -> None:
    """Every effect that can be hidden and is on by default is off in many models that lack something else."""
    for name, off in OFF.items():
        innocent = [truth for truth in truths if name not in {part.name for part in truth.parts}]
        absent = [
            truth
            for truth in innocent
            if all(get_value(truth.lab, f"effects.{name}.{key}") == value for key, value in off.items())
        ]
        assert len(absent) >= 5, name


def test_nominals_stay_within_their_tolerances(truths: list[Truth]) -> None:
    for truth in truths:
        for path, value in truth.nominals.items():
            nominal = float(get_value(truth.known, path))
            limit = 1.2 if path in truth.wrong else 0.7
            assert abs(value / nominal - 1.0) <= limit * NOMINALS[path] + 1e-12
        assert all(not path.startswith(f"effects.{part.name}.") for part in truth.parts for path in truth.nominals)


def test_half_of_the_cases_with_nothing_missing_have_wrong_nominals(truths: list[Truth]) -> None:
    none = [truth for truth in truths if truth.kind is Kind.NONE]
    assert [bool(truth.wrong) for truth in none] == [number % 2 == 1 for number in range(len(none))]
    assert all(set(truth.wrong) <= set(list_nominals(truth.known)) for truth in none)


def test_the_truth_is_computed_in_another_resolution_than_the_diagnosis(truths: list[Truth]) -> None:
    assert all(truth.numerics.step_s < 0.1 for truth in truths)
    assert len({truth.numerics.section_length_mm for truth in truths}) > 20


def test_every_rig_can_be_assembled_and_every_name_exists(truths: list[Truth]) -> None:
    for truth in truths:
        check_model(truth.known, "rig")
    assert set(NOMINALS) <= set(list_paths())
    for name, hidden in list_hidden().items():
        for key in (*hidden.ranges, *hidden.switches):
            assert f"effects.{name}.{key}" in list_paths()
