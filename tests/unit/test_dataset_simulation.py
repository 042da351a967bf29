"""Simulated runs: the channels' definitions, hold of the commands, fewer steps for the same answer, other robots."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from evergym.discrepancy.data.channels import read_channels
from evergym.discrepancy.data.columns import CHANNELS, COMMANDS
from evergym.discrepancy.data.dataset import Dataset, Run
from evergym.discrepancy.data.rig import Fidelity, choose_numerics
from evergym.discrepancy.schedule import plan_steps
from evergym.discrepancy.simulate import find_longest, fit_damping, make_command, simulate_run, try_simulate_run
from evergym.errors import ConfigError, SimulationDiverged
from evergym.model import Model, Numerics, load_model
from evergym.simulator import Command, Simulator
from evergym.units import DEG, MM
from evergym.world import World

Array = NDArray[np.float64]
MODEL = load_model("mammobot_2023")
NOISE = np.array([0.3, 0.3, 0.3, 0.5, 0.1, 0.1, 0.5, 0.5, 0.2])
"""What a good bench measures to, one sigma, in the order of the channels (prior)."""


def make_run(
    time: Array, setup: str = "full", everted_mm: float = 40.0, environment: str = "free", **commands: object
) -> Run:
    table = np.zeros((len(time), len(COMMANDS)))
    table[:, COMMANDS.index("tail_feed_mm_s")] = np.nan
    for name, values in commands.items():
        table[:, COMMANDS.index(name)] = values
    measured = np.full((len(time), len(CHANNELS)), np.nan)
    return Run("r", setup, (0.0, -9.81, 0.0), "e", environment, everted_mm, time, table, measured)


def channel(predicted: Array, name: str) -> Array:
    values: Array = predicted[:, CHANNELS.index(name)]
    return values


def make_dataset(robot: dict[str, float], *runs: Run) -> Dataset:
    return Dataset("d", "", {}, robot, (), runs, (), Path("d"))


# -- channels


def test_channels_are_what_the_contract_defines() -> None:
    simulator = Simulator(MODEL, World.free((0.0, -9.81, 0.0)), setup="full")
    simulator.reset(everted_length=0.06, pressure=20e3)
    reading = simulator.advance(Command(roll=2.0, tendon_pull=4e-3, pressure=20e3), 1.0)
    found = dict(zip(CHANNELS, read_channels(simulator).tolist(), strict=True))
    x, y, z = reading.tip_position
    tx, _, tz = reading.tip_direction
    assert found["tip_x_mm"] == pytest.approx(x / MM)
    assert found["tip_y_mm"] == pytest.approx(y / MM)
    assert found["tip_z_mm"] == pytest.approx(z / MM)
    assert found["everted_length_mm"] == pytest.approx(60.0)
    assert found["growth_speed_mm_s"] == 0.0
    assert found["tip_angle_deg"] == pytest.approx(math.degrees(math.acos(tz)), abs=1e-6)
    assert found["bending_angle_deg"] == pytest.approx(math.degrees(math.acos(z / math.hypot(x, y, z))), abs=1e-6)
    assert found["curvature_1_per_m"] == pytest.approx(math.acos(tz) / 0.060, abs=1e-6)
    assert found["pressure_measured_kpa"] == pytest.approx(20.0)
    signed = dict(zip(CHANNELS, read_channels(simulator, signed=True).tolist(), strict=True))
    assert signed["tip_angle_deg"] == pytest.approx(math.degrees(math.atan2(tx, tz)))
    assert signed["tip_angle_deg"] < 0.0 < found["tip_angle_deg"]  # rolled by 115 degrees: towards -x


def test_the_free_length_is_the_longest_part_outside() -> None:
    simulator = Simulator(MODEL, World.free(), setup="catheter")
    simulator.reset()
    found = dict(zip(CHANNELS, read_channels(simulator).tolist(), strict=True))
    assert found["everted_length_mm"] == 0.0
    assert found["curvature_1_per_m"] * 0.095 == pytest.approx(found["tip_angle_deg"] * DEG)


# -- hold of the commands


def test_a_row_shows_what_the_commands_before_it_did() -> None:
    """Zero-order hold: a command acts from its row on, so its row still shows the rest before."""
    run = make_run(np.array([0.0, 1.0, 2.0, 3.0]), "catheter", tendon_pull_mm=[0.0, 3.0, 3.0, 0.0])
    x = channel(simulate_run(MODEL, run), "tip_x_mm")
    assert x[1] == pytest.approx(x[0], abs=0.01)
    assert x[2] > x[1] + 30.0
    assert x[3] == pytest.approx(x[2], abs=0.01)


def test_a_run_starts_at_rest_under_its_first_commands() -> None:
    run = make_run(np.array([0.0, 2.0]), "catheter", tendon_pull_mm=3.0, roll_deg=90.0)
    predicted = simulate_run(MODEL, run)
    np.testing.assert_allclose(predicted[0], predicted[1], atol=0.01)
    assert predicted[0, CHANNELS.index("tip_y_mm")] > 40.0  # rolled by 90 degrees the tendon pulls up


def test_a_run_is_what_the_simulator_does_under_the_same_commands() -> None:
    """Only the damping and the length of the sections differ, by less than 0.05 mm or degree (see below)."""
    time = np.arange(0.0, 3.01, 0.1)
    run = make_run(time, insertion_mm_s=2.0, pressure_kpa=35.0, tendon_pull_mm=np.minimum(1.5 * time, 3.5))
    simulator = Simulator(MODEL, World.free((0.0, -9.81, 0.0)), Numerics(section_length_mm=1.0, step_s=0.01))
    simulator.reset(everted_length=0.04, pressure=35e3)
    rows = [read_channels(simulator)]
    for command, duration in zip(run.commands[:-1], np.diff(time), strict=True):
        simulator.advance(make_command(command), float(duration))
        rows.append(read_channels(simulator))
    np.testing.assert_allclose(simulate_run(MODEL, run), np.array(rows), atol=0.05)


def change_effect(name: str, **values: float) -> Model:
    effect = dataclasses.replace(getattr(MODEL.effects, name), **values)
    return dataclasses.replace(MODEL, effects=dataclasses.replace(MODEL.effects, **{name: effect}))


def test_the_regulator_controls_what_a_biased_gauge_reads() -> None:
    """The reading is as commanded, the robot has less: a sheath grows as if less had been commanded."""
    time = np.arange(0.0, 10.01, 0.5)
    run = make_run(time, "sheath", 20.0, pressure_kpa=30.0, tail_feed_mm_s=5.8)
    low = make_run(time, "sheath", 20.0, pressure_kpa=25.0, tail_feed_mm_s=5.8)
    biased = simulate_run(change_effect("pressure_bias", bias_kpa=5.0), run)
    np.testing.assert_allclose(channel(biased, "pressure_measured_kpa"), 30.0, atol=1e-6)
    np.testing.assert_allclose(
        channel(biased, "everted_length_mm"), channel(simulate_run(MODEL, low), "everted_length_mm"), atol=1e-6
    )


def test_tip_angles_and_curvatures_are_read_in_steps() -> None:
    run = make_run(np.arange(0.0, 3.01, 0.5), "catheter", tendon_pull_mm=np.linspace(0.0, 3.0, 7))
    exact = simulate_run(MODEL, run)
    read = simulate_run(change_effect("angle_quantisation", step_deg=5.0), run)
    angle = channel(read, "tip_angle_deg")
    np.testing.assert_allclose(angle, 5.0 * np.round(channel(exact, "tip_angle_deg") / 5.0), atol=1e-9)
    np.testing.assert_allclose(channel(read, "curvature_1_per_m"), angle * DEG / 0.095, rtol=1e-9)
    np.testing.assert_array_equal(channel(read, "tip_x_mm"), channel(exact, "tip_x_mm"))


def test_an_empty_tail_feed_is_coupled() -> None:
    row = np.zeros(len(COMMANDS))
    row[COMMANDS.index("tail_feed_mm_s")] = np.nan
    assert make_command(row).tail_feed_velocity is None
    row[COMMANDS.index("tail_feed_mm_s")] = 3.0
    assert make_command(row).tail_feed_velocity == pytest.approx(3e-3)


# -- fewer steps


def test_steps_are_joined_where_commands_ramp_and_not_across_events() -> None:
    time = np.arange(0.0, 8.001, 0.02)
    pull = np.interp(time, [0.0, 2.0, 4.0, 8.0], [0.0, 4.0, 0.0, 0.0])
    steps = plan_steps(make_run(time, tendon_pull_mm=pull), 0.125)
    assert len(steps) < len(time) / 4
    assert steps[0].first == 0
    assert steps[-1].last == len(time) - 1
    for before, after in itertools.pairwise(steps):
        assert after.first == before.last
    assert sum(step.duration for step in steps) == pytest.approx(8.0)
    ends = {round(float(time[step.last]), 6) for step in steps}
    assert {2.02, 4.02} <= ends  # the rows whose commands reverse and end the ramp
    assert max(step.duration for step in steps) <= 0.25 + 1e-9
    assert max(step.duration for step in steps if not step.rests) <= 0.125 + 1e-9


def test_rounding_and_jitter_of_a_logged_ramp_are_no_events() -> None:
    time = np.arange(0.0, 4.001, 0.02)
    rng = np.random.default_rng(0)
    pull = np.round(0.7 * time, 2)  # increments of 0.01 and 0.02
    pressure = 20.0 + 0.01 * rng.standard_normal(len(time))
    steps = plan_steps(make_run(time, tendon_pull_mm=pull, pressure_kpa=pressure), 0.125)
    assert len(steps) < len(time) / 3


def test_joined_rates_move_as_far_as_the_rows_did() -> None:
    time = np.arange(0.0, 2.001, 0.02)
    speed = 2.0 + np.sin(3.0 * time)
    run = make_run(time, insertion_mm_s=speed)
    steps = plan_steps(run, 0.125)
    moved = sum(step.duration * step.command[COMMANDS.index("insertion_mm_s")] for step in steps)
    assert moved == pytest.approx(float(np.sum(speed[:-1] * np.diff(time))), rel=1e-12)


@pytest.mark.parametrize(
    ("setup", "commands"),
    [
        ("full", {"tendon_pull_mm": lambda t: 4.5 * (1.0 - np.abs((t / 3.0) % 2.0 - 1.0)), "pressure_kpa": 20.0}),
        (
            "full",
            {"insertion_mm_s": lambda t: np.where(t < 4.0, 2.9, 0.0), "pressure_kpa": lambda t: 25.0 + 15.0 * (t > 2)},
        ),
        ("catheter", {"load_x_n": lambda t: 0.01 * np.floor(t / 2.0), "tendon_pull_mm": 2.0}),
        ("sheath", {"tail_feed_mm_s": 5.8, "pressure_kpa": lambda t: np.where(t < 3.0, 30.0, 45.0)}),
    ],
    ids=["pull", "growth", "load", "sheath"],
)
def test_fast_is_as_good_as_fine_below_any_noise(setup: str, commands: dict[str, object]) -> None:
    """At 10 Hz: within a tenth of the noise of a bench."""
    time = np.arange(0.0, 6.001, 0.1)
    values = {name: value(time) if callable(value) else value for name, value in commands.items()}
    run = make_run(time, setup, 20.0, **values)
    fast = simulate_run(MODEL, run, choose_numerics(MODEL, setup, Fidelity.FAST))
    fine = simulate_run(MODEL, run, choose_numerics(MODEL, setup, Fidelity.FINE))
    assert np.all(np.sqrt(np.mean((fast - fine) ** 2, axis=0)) < 0.1 * NOISE)


def test_joined_rows_say_what_each_row_would() -> None:
    """50 Hz, joined into a fifth of the steps, against a step per row: within a tenth of a bench's noise."""
    time = np.arange(0.0, 6.0001, 0.02)
    pull = np.interp(time, [0.0, 3.0, 6.0], [0.0, 4.5, 0.0])
    run = make_run(time, tendon_pull_mm=pull, pressure_kpa=20.0)
    assert len(plan_steps(run, 0.125)) < len(time) / 4
    joined = simulate_run(MODEL, run)
    single = simulate_run(MODEL, run, dataclasses.replace(choose_numerics(MODEL, "full"), step_s=0.02))
    assert len(plan_steps(run, 0.02)) == len(time) - 1
    assert np.all(np.sqrt(np.mean((joined - single) ** 2, axis=0)) < 0.1 * NOISE)
    assert np.ptp(channel(joined, "tip_x_mm")) > 8.0


def test_the_damping_is_fitted_to_the_step() -> None:
    time = np.arange(0.0, 1.01, 0.1)
    fitted = fit_damping(MODEL, make_run(time), 0.125).robot.catheter_damping_time_ms
    assert fitted == pytest.approx(0.5)  # a tenth of 5 ms: at 0.1 s nothing of a damped motion is left
    dense = np.arange(0.0, 0.01, 0.001)
    fitted = fit_damping(MODEL, make_run(dense), 0.125).robot.catheter_damping_time_ms
    tau, h = fitted * 1e-3, 1e-3
    assert tau / (tau + h) == pytest.approx(math.exp(-h / 5e-3))


# -- failures


def test_a_failure_leaves_nan_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    advance = Simulator.advance

    def fail_later(self: Simulator, command: Command, duration: float) -> object:
        calls.append(duration)
        if len(calls) > 3:
            raise SimulationDiverged("no equilibrium")
        return advance(self, command, duration)

    monkeypatch.setattr(Simulator, "advance", fail_later)
    run = make_run(np.arange(0.0, 10.0, 1.0), "catheter", tendon_pull_mm=np.arange(10.0) / 5.0)
    prediction = try_simulate_run(MODEL, run)
    assert prediction.failure == "run 'r': no equilibrium"
    assert np.isfinite(prediction.channels[0]).all()
    assert np.isnan(prediction.channels[-1]).all()


# -- surroundings


def test_pegs_stand_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "pegs.csv").write_text("x_mm,z_mm,diameter_mm\n8,30,5\n")
    time = np.arange(0.0, 3.01, 0.25)
    free = make_run(time, everted_mm=60.0, tendon_pull_mm=1.6 * time, pressure_kpa=10.0)
    pegs = dataclasses.replace(free, environment="pegs:pegs.csv", folder=tmp_path)
    free_x, peg_x = (channel(simulate_run(MODEL, run), "tip_x_mm") for run in (free, pegs))
    assert peg_x[0] == pytest.approx(free_x[0], abs=0.1)
    assert peg_x[-1] < free_x[-1] - 0.3


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("x_mm,z_mm\n1,2\n", "row 1: the columns are"),
        ("x_mm,z_mm,diameter_mm\n1,2,\n", "row 2: needs three numbers"),
        ("x_mm,z_mm,diameter_mm\n1,2,5\n1,2,-5\n", "row 3: needs finite numbers and a diameter above 0"),
        ("x_mm,z_mm,diameter_mm\n1,nan,5\n", "row 2: needs finite numbers"),
        ("x_mm,z_mm,diameter_mm\n", "holds no pegs"),
    ],
)
def test_a_wrong_table_of_pegs_is_named(tmp_path: Path, text: str, fragment: str) -> None:
    (tmp_path / "pegs.csv").write_text(text)
    run = dataclasses.replace(make_run(np.zeros(1)), environment="pegs:pegs.csv", folder=tmp_path)
    with pytest.raises(ConfigError, match=fragment):
        simulate_run(MODEL, run)


def test_a_play_taken_up_within_a_joined_step_is_seen() -> None:
    """The dead band ends amid a steady ramp: interpolation across it would be 0.1 mm off."""
    time = np.arange(0.0, 3.0001, 0.02)
    run = make_run(time, tendon_pull_mm=1.5 * time, pressure_kpa=20.0)
    joined = simulate_run(MODEL, run)
    single = simulate_run(MODEL, run, dataclasses.replace(choose_numerics(MODEL, "full"), step_s=0.02))
    assert np.abs(joined - single)[:, : CHANNELS.index("growth_speed_mm_s")].max() < 0.02


def test_a_sheath_may_start_from_nothing() -> None:
    """The simulator's shortest sheath is 2 mm: where less is written, it starts there."""
    run = make_run(np.array([0.0, 5.0]), "sheath", 0.0, tail_feed_mm_s=5.8, pressure_kpa=40.0)
    prediction = try_simulate_run(MODEL, run)
    assert prediction.failure == ""
    length = channel(prediction.channels, "everted_length_mm")
    assert length[0] == pytest.approx(2.0)
    assert length[1] > 5.0


@pytest.mark.parametrize(
    "commands",
    [
        {"pressure_kpa": -20.0},
        {"tendon_pull_mm": -3.0},
        {"insertion_mm_s": -5.0},
        {"insertion_mm_s": 30.0, "pressure_kpa": 40.0},
        {"pressure_kpa": 100.0},
        {"tendon_pull_mm": 20.0, "load_z_n": -0.5},
    ],
    ids=["suction", "slack", "withdrawal", "far beyond the sheath", "burst", "overload"],
)
def test_commands_beyond_the_robot_give_numbers_or_a_reason(commands: dict[str, float]) -> None:
    prediction = try_simulate_run(MODEL, make_run(np.arange(0.0, 10.0, 0.5), **commands))  # type: ignore[arg-type]
    assert np.isfinite(prediction.channels).all() or prediction.failure


def test_a_ripple_is_followed_not_sampled() -> None:
    """2 Hz at 10 samples a second: as with steps of 4 ms; with 0.125 s a swing of 4 kPa would be missed or aliased."""
    time = np.arange(0.0, 4.01, 0.1)
    run = make_run(time, "sheath", 20.0, pressure_kpa=30.0, tail_feed_mm_s=5.8)
    model = change_effect("pressure_ripple", amplitude_kpa=4.0, frequency_hz=2.0)
    fine = simulate_run(model, run, dataclasses.replace(choose_numerics(model, "sheath"), step_s=1.0 / 256.0))
    fast = simulate_run(model, run)
    gauge = channel(fine, "pressure_measured_kpa")
    assert np.ptp(gauge[10:]) > 2.0  # the lag of 0.15 s leaves half of 8 kPa
    np.testing.assert_allclose(channel(fast, "pressure_measured_kpa"), gauge, atol=0.25)  # 10 ms late
    np.testing.assert_allclose(channel(fast, "everted_length_mm"), channel(fine, "everted_length_mm"), atol=0.05)


def test_a_hanging_sheath_has_its_kink_in_a_short_section() -> None:
    run = make_run(np.array([0.0, 4.0, 8.0]), "sheath", 95.0, pressure_kpa=20.0)
    fast = simulate_run(MODEL, run)
    fine = simulate_run(MODEL, run, Numerics(section_length_mm=0.25, step_s=0.05))
    droop = channel(fine, "bending_angle_deg")[-1]
    assert droop > 20.0
    assert channel(fast, "bending_angle_deg")[-1] == pytest.approx(droop, abs=0.6)  # 0.3 degrees a half millimetre


def test_steps_are_short_enough_for_friction_along_the_tendon() -> None:
    """Which takes the bend of a step's start: without the refinement 0.6 of a bench's noise, with it 0.2."""
    time = np.arange(0.0, 6.001, 0.1)
    run = make_run(time, "catheter", tendon_pull_mm=4.5 * (1.0 - np.abs(time / 3.0 - 1.0)))
    model = change_effect("tendon_friction", mu=0.15)
    fine = simulate_run(model, run, dataclasses.replace(choose_numerics(model, "catheter"), step_s=1.0 / 128.0))
    error = simulate_run(model, run) - fine
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.25 * NOISE)
    assert np.abs(simulate_run(MODEL, run) - fine).max() > 5.0  # the effect itself is seen


def test_a_short_robot_of_much_material_has_sections() -> None:
    """Sections follow what a run can grow to, not only the material: a load bends 60 of 5000 mm as it should."""
    robot = dataclasses.replace(MODEL.robot, sheath_material_length_mm=10_000.0)
    model = dataclasses.replace(MODEL, robot=robot)
    run = make_run(np.array([0.0, 2.0]), everted_mm=60.0, load_x_n=0.01, pressure_kpa=20.0)
    assert choose_numerics(model, "full").section_length_mm == 50.0
    x = channel(simulate_run(model, run), "tip_x_mm")[-1]
    fine = channel(simulate_run(model, run, Numerics(section_length_mm=1.0)), "tip_x_mm")[-1]
    assert x == pytest.approx(fine, abs=0.05)
    assert find_longest(make_run(np.array([0.0, 2.0, 4.0]), insertion_mm_s=[3.0, 1.0, 9.0])) == pytest.approx(48.0)
