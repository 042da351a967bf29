"""Sealing: what the diagnosis is given says nothing of the truth; every fault is what it says it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.blind.faults import FAULTS
from evergym.discrepancy.blind.folders import CaseFolders, fill_folder, read_json
from evergym.discrepancy.blind.instruments import Bench, format_dataset, measure_run, write_dataset
from evergym.discrepancy.blind.outside import OUTSIDE
from evergym.discrepancy.blind.plan import PlannedRun
from evergym.discrepancy.blind.seal import main
from evergym.discrepancy.blind.truth import Kind, draw_truth, find_kind
from evergym.discrepancy.data.columns import CHANNELS
from evergym.discrepancy.data.reading import load_dataset
from evergym.errors import ConfigError
from evergym.model import load_model

SEED = 77
BENCH = Bench({"tip_x_mm": 0.3, "tip_z_mm": 0.3, "everted_length_mm": 0.4, "tip_angle_deg": 0.7}, 0.6, 1, 0.02)


def first_of(kind: Kind) -> int:
    return next(index for index in range(30) if find_kind(SEED, index)[0] is kind)


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> CaseFolders:
    campaign = tmp_path_factory.mktemp("campaign")
    index = first_of(Kind.OUTSIDE)
    assert main([str(campaign), str(SEED), str(index)]) == 0
    return CaseFolders(campaign, index)


def good_files(seed: int = 2) -> dict[str, str]:
    truth = draw_truth(SEED, seed)
    generator = np.random.default_rng(seed)
    signals = [np.full((len(plan.time_s), len(CHANNELS)), 12.345) for plan in truth.plans]
    measured = [measure_run(generator, BENCH, plan, s) for plan, s in zip(truth.plans, signals, strict=True)]
    return format_dataset("bench", truth.plans, measured, BENCH, truth.overrides)


def test_the_dataset_is_read_back_as_it_was_played(sealed: CaseFolders) -> None:
    truth = draw_truth(SEED, sealed.index, attempt=read_json(sealed.truth)["attempt"])
    dataset = load_dataset(sealed.public / "dataset", load_model(sealed.public / "model.toml").robot)
    assert dataset.set_aside == ()
    assert load_model(sealed.public / "model.toml") == truth.lab
    for run, plan in zip(dataset.runs, truth.plans, strict=True):
        assert np.array_equal(run.commands, plan.commands)
        assert np.array_equal(run.time_s, plan.time_s)
        assert (run.id, run.experiment, run.setup, run.gravity) == (plan.id, plan.experiment, plan.setup, plan.gravity)


def test_the_noise_is_what_the_dataset_says(sealed: CaseFolders) -> None:
    dataset = load_dataset(sealed.public / "dataset")
    signals = list(np.load(sealed.signals).values())
    for name, sigma in dataset.noise.items():
        index = CHANNELS.index(name)
        gaps = [run.measured[:, index] - s[:, index] for run, s in zip(dataset.runs, signals, strict=True)]
        # Offsets and AR(1) leave some tens of independent values: within a third.
        assert np.sqrt(np.nanmean(np.concatenate(gaps) ** 2)) == pytest.approx(sigma, rel=0.33)


def test_what_the_diagnosis_gets_holds_no_truth(sealed: CaseFolders) -> None:
    truth = read_json(sealed.truth)
    (part,) = truth["parts"]
    files = [path for path in sealed.public.rglob("*") if path.is_file()]
    assert {path.name.partition("-")[0] for path in files} <= {"model.toml", "dataset.toml", "samples.csv", "pegs"}
    text = "".join(path.read_text() for path in files) + "".join(str(path.relative_to(sealed.public)) for path in files)
    for name in OUTSIDE:
        assert name not in text
    for word in ("sealed", "truth", "fault", "seed", "hidden"):
        assert word not in text
    assert not any(path.is_symlink() for path in sealed.public.rglob("*"))
    for value in truth["nominals"].values():
        assert repr(value) not in text
    assert part["form"] == "outside"


def test_what_is_sealed_judges_what_can_be_found(sealed: CaseFolders) -> None:
    truth = read_json(sealed.truth)
    (detection,) = truth["detections"]
    assert detection["detectable"] == (detection["sigmas"] >= 3.0 and detection["kept_share"] >= 0.1)
    sigmas = [cell["sigmas"] for cell in truth["cells"]]
    assert sigmas == sorted(sigmas, reverse=True)
    assert sigmas[0] == pytest.approx(detection["sigmas"], abs=1e-3)


def test_the_dataset_without_a_fault_is_good(tmp_path: Path) -> None:
    write_dataset(tmp_path / "dataset", good_files())
    assert load_dataset(tmp_path / "dataset").runs


@pytest.mark.parametrize("name", [name for name in FAULTS if name != "add_impossible_rows"])
def test_every_fault_is_refused_at_its_place(name: str, tmp_path: Path) -> None:
    spoiled = FAULTS[name](np.random.default_rng(4), good_files())
    write_dataset(tmp_path / "dataset", spoiled.files)
    with pytest.raises(ConfigError) as error:
        load_dataset(tmp_path / "dataset")
    for word in spoiled.words:
        assert word in str(error.value)


def test_impossible_rows_are_set_aside_and_counted(tmp_path: Path) -> None:
    spoiled = FAULTS["add_impossible_rows"](np.random.default_rng(4), good_files())
    write_dataset(tmp_path / "dataset", spoiled.files)
    assert {str(row) for row, _ in load_dataset(tmp_path / "dataset").set_aside} == set(spoiled.words)


def test_a_folder_that_was_not_filled_to_the_end_is_not_there(tmp_path: Path) -> None:
    def fail() -> None:
        with fill_folder(tmp_path / "case") as draft:
            (draft / "half").touch()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_repeats_share_an_experiment_and_differ_in_noise_only() -> None:
    truth = draw_truth(SEED, 3)
    by_experiment: dict[str, list[PlannedRun]] = {}
    for plan in truth.plans:
        by_experiment.setdefault(plan.experiment, []).append(plan)
    pairs = [plans for plans in by_experiment.values() if len(plans) == 2]
    assert pairs
    for one, other in pairs:
        assert np.array_equal(one.commands, other.commands)
        assert one.id != other.id
