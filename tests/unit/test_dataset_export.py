"""Datasets that are written: round trips, recorded simulators, the paper's figures."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Run
from evergym.discrepancy.data.export import add_noise, write_dataset
from evergym.discrepancy.data.paper import PAPER_FIGURES, export_paper, make_paper_runs
from evergym.discrepancy.data.reading import load_dataset
from evergym.discrepancy.data.record import Recorder, record_simulator
from evergym.discrepancy.data.rig import Fidelity, choose_numerics
from evergym.discrepancy.simulate import simulate_run
from evergym.errors import ConfigError
from evergym.experiments.paper import read_table
from evergym.model import load_model
from evergym.simulator import Command, Simulator
from evergym.units import KPA, MM
from evergym.world import World

MODEL = load_model("mammobot_2023")
NOISE = dict.fromkeys(CHANNELS, 0.5)


def make_run(name: str = "r1", rows: int = 5) -> Run:
    rng = np.random.default_rng(3)
    commands = np.zeros((rows, len(COMMANDS)))
    commands[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    commands[2:, COMMANDS.index("tail_feed_mm_s")] = 1.0 / 3.0
    commands[:, COMMANDS.index("pressure_kpa")] = rng.uniform(10.0, 30.0, rows)
    measured = np.full((rows, len(CHANNELS)), np.nan)
    measured[1:, CHANNELS.index("tip_x_mm")] = rng.normal(size=rows - 1)
    time = np.cumsum(rng.uniform(0.1, 0.2, rows))
    return Run(name, "full", (1.0, -9.0, 0.5), "e1", "free", 12.5, time, commands, measured)


def assert_same(one: Run, other: Run) -> None:
    for name in ("id", "setup", "gravity", "experiment", "environment", "initial_everted_length_mm"):
        assert getattr(one, name) == getattr(other, name)
    np.testing.assert_array_equal(one.time_s, other.time_s)
    np.testing.assert_array_equal(one.commands, other.commands)
    np.testing.assert_array_equal(one.measured, other.measured)


# -- round trip


@pytest.mark.parametrize("parquet", [False, True])
def test_what_is_written_is_read_back_to_the_last_bit(tmp_path: Path, parquet: bool) -> None:
    runs = (make_run("r1"), dataclasses.replace(make_run("r2", 3), environment="free", setup="catheter"))
    write_dataset(tmp_path / "d", runs, NOISE, description="two\nlines", robot={"tendon_arm_mm": 0.8}, parquet=parquet)
    dataset = load_dataset(tmp_path / "d")
    assert (dataset.name, dataset.description, dataset.robot) == ("d", "two\nlines", {"tendon_arm_mm": 0.8})
    for one, other in zip(runs, dataset.runs, strict=True):
        assert_same(one, other)


def test_columns_that_no_run_uses_are_left_out(tmp_path: Path) -> None:
    write_dataset(tmp_path, [make_run()], NOISE)
    header = (tmp_path / "samples.csv").read_text().splitlines()[0]
    assert header == "run,time_s,insertion_mm_s,tail_feed_mm_s,pressure_kpa,tip_x_mm"


def test_a_dataset_is_not_overwritten_by_accident(tmp_path: Path) -> None:
    write_dataset(tmp_path, [make_run()], NOISE)
    with pytest.raises(ConfigError, match="is there already"):
        write_dataset(tmp_path, [make_run()], NOISE)
    write_dataset(tmp_path, [make_run("other")], NOISE, parquet=True, overwrite=True)
    assert load_dataset(tmp_path).runs[0].id == "other"
    assert not (tmp_path / "samples.csv").exists()


def test_a_measured_channel_without_noise_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'tip_x_mm' was measured but has no noise"):
        write_dataset(tmp_path / "d", [make_run()], {})
    assert not (tmp_path / "d").exists()


def test_noise_is_white_and_leaves_gaps() -> None:
    run = dataclasses.replace(make_run(rows=4000), measured=np.zeros((4000, len(CHANNELS))))
    run.measured[7] = np.nan
    noisy = add_noise(run, {"tip_x_mm": 0.3}, np.random.default_rng(1)).measured
    x = noisy[:, CHANNELS.index("tip_x_mm")]
    assert np.isnan(x[7])
    assert np.nanstd(x) == pytest.approx(0.3, rel=0.05)  # 4.5 standard errors of 1.1 %
    assert np.isnan(noisy[:, CHANNELS.index("tip_y_mm")]).all()


# -- recorded simulators


def drive(advance: object, reset_pressure_kpa: float = 0.0) -> None:
    for i in range(12):
        command = Command(
            insertion_velocity=2e-3, pressure=(25.0 + reset_pressure_kpa) * KPA, tendon_pull=2.5 * MM * (i >= 4)
        )
        advance(command, 0.25)  # type: ignore[operator]


def test_a_recorded_simulator_is_simulated_alike(tmp_path: Path) -> None:
    """Through the file: the same commands, the same rests, so the same channels but for the fitted damping."""
    numerics = choose_numerics(MODEL, "full", Fidelity.STANDARD)
    simulator = Simulator(MODEL, World.free(), numerics)
    simulator.reset(everted_length=0.03)  # at no pressure: the first command raises it
    recorder = Recorder(simulator, period=0.125)
    drive(recorder.advance)
    run = recorder.finish("r1", "growth")
    assert len(run.time_s) == 1 + 24 + 1  # the rest before the first command, and each sample
    write_dataset(tmp_path, [run], NOISE)
    again = load_dataset(tmp_path).runs[0]
    assert_same(run, again)
    predicted = simulate_run(MODEL, again, numerics)
    np.testing.assert_allclose(predicted, run.measured, atol=0.02)
    assert again.measured[-1, CHANNELS.index("everted_length_mm")] > 32.0


def test_a_simulator_is_recorded_while_others_advance_it() -> None:
    simulator = Simulator(MODEL)
    simulator.reset(pressure=25e3)
    with record_simulator(simulator) as recorder:
        drive(simulator.advance)
    simulator.advance(Command(), 1.0)  # no longer recorded
    run = recorder.finish("r1")
    assert run.time_s.tolist() == pytest.approx((0.25 * np.arange(13)).tolist())
    assert run.experiment == "r1"
    assert run.commands[5, COMMANDS.index("tendon_pull_mm")] == pytest.approx(2.5)
    assert np.isnan(run.commands[:, COMMANDS.index("tail_feed_mm_s")]).all()


def test_a_record_starts_at_a_reset_that_a_dataset_can_say() -> None:
    simulator = Simulator(MODEL)
    simulator.advance(Command(), 0.1)
    with pytest.raises(ConfigError, match="starts at the simulator's reset"):
        Recorder(simulator)
    simulator.reset(catheter_length=0.002)
    with pytest.raises(ConfigError, match=r"10 mm of catheter inserted .*reset with 2 mm"):
        Recorder(simulator)
    simulator.reset()
    with pytest.raises(ConfigError, match="holds no step"):
        Recorder(simulator).finish("r1")
    with pytest.raises(ConfigError, match="sampling period"):
        Recorder(simulator, period=0.0)


# -- the paper's figures


def test_the_papers_figures_become_a_dataset(tmp_path: Path) -> None:
    dataset = load_dataset(export_paper(tmp_path))
    assert {run.experiment for run in dataset.runs} == {
        "fig6", "fig7", "fig8", "fig9", "fig10", "fig11a", "fig11b", "fig11c", "fig11d",
    }  # fmt: skip
    assert {run.setup for run in dataset.runs} == {"catheter", "sheath", "full"}
    assert dataset.noise["tip_angle_deg"] == pytest.approx(1.0 / 12.0**0.5)
    assert dataset.set_aside == ()
    assert all(run.signed_angles for run in dataset.runs)


def test_every_reading_of_the_paper_is_there_once() -> None:
    """But those that the description leaves out: the starts of Fig. 8a at 0 mm."""
    runs = make_paper_runs()
    counts = {
        figure: sum(int(np.isfinite(run.measured).sum()) for run in runs if run.experiment.startswith(figure))
        for figure in PAPER_FIGURES
    }
    growth = read_table("fig8a")
    assert counts == {
        "fig6": len(read_table("fig6")),
        "fig7": len(read_table("fig7")),
        "fig8": int((growth.time_s > 0).sum()),
        "fig9": len(read_table("fig9")),
        "fig10": len(read_table("fig10")),
        "fig11": len(read_table("fig11")),
    }


def test_pressures_are_gauge_and_loads_are_weights() -> None:
    (run,) = make_paper_runs(["fig10"])
    assert run.commands[0, COMMANDS.index("pressure_kpa")] == pytest.approx(110.0 - 101.3)
    assert run.commands[:, COMMANDS.index("tendon_pull_mm")].tolist() == [4.9] * 10
    opposite = next(run for run in make_paper_runs(["fig11"]) if run.id == "fig11a-5g")
    assert opposite.commands[0, COMMANDS.index("load_x_n")] == pytest.approx(-5 * 9.81e-3)
    assert opposite.gravity == (-9.81, 0.0, 0.0)


def test_the_catheters_figures_are_predicted_by_the_model_fitted_to_them() -> None:
    """Figs. 6 and 7 gave the model its stiffness and its tendon: within 2 degrees rms (read to 1 degree)."""
    for run in make_paper_runs(["fig6", "fig7"]):
        seen = np.isfinite(run.measured)
        error = (simulate_run(MODEL, run) - run.measured)[seen]
        assert np.sqrt(np.mean(error**2)) < 2.0


def test_an_unknown_figure_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no figure 'fig12'"):
        export_paper(tmp_path / "d", ["fig12"])
    assert not (tmp_path / "d").exists()
