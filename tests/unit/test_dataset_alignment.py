"""Tables whose rows hold their own readings, and robots that started without a command."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.alignment import Alignment, align_dataset, find_alignment, is_table, realign
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.export import add_noise
from evergym.discrepancy.data.paper import make_paper_runs
from evergym.discrepancy.simulate import simulate_run
from evergym.model import Model, load_model

MODEL = load_model("mammobot_2023")
NOISE = {"tip_x_mm": 0.3, "tip_z_mm": 0.3, "curvature_1_per_m": 0.09}
PULLS = (1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0)


def make_blank(hold: float, setup: str = "catheter", **commands: object) -> Run:
    count = max(np.size(values) for values in commands.values())  # type: ignore[call-overload]
    table = np.zeros((count, len(COMMANDS)))
    table[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    for name, values in commands.items():
        table[:, COMMANDS.index(name)] = values
    time = hold * np.arange(count)
    return Run("t", setup, (0.0, -9.81, 0.0), "e", "free", 40.0, time, table, np.zeros((count, len(CHANNELS))))


def measure(run: Run, truth: Model, alignment: Alignment, seed: int) -> Dataset:
    """What a lab with this habit would have written."""
    signal = simulate_run(truth, realign(run, alignment))[-len(run.time_s) :]
    noisy = add_noise(dataclasses.replace(run, measured=signal), NOISE, np.random.default_rng(seed))
    return Dataset("d", "", NOISE, {}, (), (noisy,), (), Path("d"))


def change_backlash(backlash_mm: float) -> Model:
    backlash = dataclasses.replace(MODEL.effects.tendon_backlash, backlash_mm=backlash_mm)
    return dataclasses.replace(MODEL, effects=dataclasses.replace(MODEL.effects, tendon_backlash=backlash))


@pytest.mark.parametrize("alignment", [Alignment.AS_WRITTEN, Alignment.SAME_ROW])
@pytest.mark.parametrize("backlash_mm", [0.363, 0.0, 1.2], ids=["no gap", "gap", "large gap"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_tables_habit_is_told_even_by_a_model_that_lacks_something(
    alignment: Alignment, backlash_mm: float, seed: int
) -> None:
    data = measure(make_blank(5.0, tendon_pull_mm=PULLS), change_backlash(backlash_mm), alignment, seed)
    assert find_alignment(MODEL, data, data.runs[0]) is alignment


@pytest.mark.parametrize("alignment", [Alignment.AS_WRITTEN, Alignment.FROM_ZERO])
def test_a_start_without_commands_is_told(alignment: Alignment) -> None:
    run = make_blank(0.1, tendon_pull_mm=[3.0] * 20, load_x_n=[0.0] * 10 + [0.02] * 10)
    data = measure(run, MODEL, alignment, 0)
    assert find_alignment(MODEL, data, data.runs[0]) is alignment


def test_a_gap_at_the_start_is_no_start_from_zero() -> None:
    """A play that the model lacks hides the first pull: the robot rests all the same."""
    data = measure(make_blank(0.1, tendon_pull_mm=[0.8] * 20), change_backlash(1.2), Alignment.AS_WRITTEN, 0)
    assert find_alignment(MODEL, data, data.runs[0]) is Alignment.AS_WRITTEN


def test_realigned_rows_mean_by_the_format_what_was_meant() -> None:
    run = make_blank(5.0, tendon_pull_mm=PULLS)
    same_row = simulate_run(MODEL, realign(run, Alignment.SAME_ROW))[1:, 0]
    pulled = make_blank(5.0, tendon_pull_mm=[1.0, 1.0])
    assert same_row[0] == pytest.approx(simulate_run(MODEL, pulled)[-1, 0], abs=0.05)
    assert int(np.argmax(same_row)) == 3  # the row of the largest pull
    from_zero = realign(run, Alignment.FROM_ZERO)
    assert len(from_zero.time_s) == len(run.time_s) + 1
    assert simulate_run(MODEL, from_zero)[1, 0] == pytest.approx(
        simulate_run(MODEL, make_blank(1.0, tendon_pull_mm=[0.0, 0.0]))[0, 0], abs=0.01
    )


def test_growth_and_dense_samples_are_no_tables() -> None:
    assert is_table(make_blank(5.0, tendon_pull_mm=PULLS))
    assert not is_table(make_blank(0.1, tendon_pull_mm=PULLS))
    assert not is_table(make_blank(5.0, tendon_pull_mm=PULLS, insertion_mm_s=1.0))
    assert not is_table(make_blank(5.0, tendon_pull_mm=[1.0] * 7))
    assert not is_table(make_blank(5.0, tendon_pull_mm=PULLS[:3]))


def test_the_papers_tables_are_as_written(tmp_path: Path) -> None:
    noise = {"everted_length_mm": 1.8, "tip_angle_deg": 0.3, "bending_angle_deg": 0.15}
    data = Dataset("p", "", noise, {}, (), make_paper_runs(), (), tmp_path)
    aligned, remarks = align_dataset(MODEL, data)
    assert remarks == ()
    assert aligned.runs == data.runs


def test_a_shifted_table_is_remarked() -> None:
    data = measure(make_blank(5.0, tendon_pull_mm=PULLS), MODEL, Alignment.SAME_ROW, 3)
    aligned, (remark,) = align_dataset(MODEL, data)
    assert "run 't': a row's measurements belong to its own commands" in remark
    assert len(aligned.runs[0].time_s) == len(PULLS) + 1
    again, remarks = align_dataset(MODEL, aligned)
    assert remarks == ()  # once is enough
    assert len(again.runs[0].time_s) == len(PULLS) + 1
