"""Effects beside those that the catalogue says they are taken for, where no other test has both: one experiment each,
in which one answers and the other does not.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evergym.effects.catalogue import EFFECTS
from evergym.simulator import Command, Simulator
from evergym.world import World

KPA = 1e3
MM = 1e-3
LENGTH = 0.095
CATHETER = 4.23e-4
FILM = 3e8 * math.pi * 1.5e-3**3 * 35e-6
"""Bending stiffness of the taut film [N m^2]."""
NO_GROWTH = {"eversion_yield.static_kpa": 1000.0, "eversion_yield.kinetic_kpa": 1000.0}
STILL = {**NO_GROWTH, "wall_wrinkling.enabled": False, "tendon_backlash.lost_motion_mm": 5.0}

Create = Callable[..., Simulator]


def test_every_pair_of_partners_is_told_apart_in_some_test() -> None:
    """Some test of these files, with what it uses of its file, sets both effects."""
    texts: list[str] = []
    for path in sorted(Path(__file__).parent.glob("test_effect_*.py")):
        source = path.read_text(encoding="utf-8")
        nodes = ast.parse(source).body
        text = {node: ast.get_source_segment(source, node) or "" for node in nodes}
        shared = {}
        for node in nodes:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("test_"):
                shared[node.name] = text[node]
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                shared[node.targets[0].id] = text[node]
        for node in nodes:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                words = {word.id for word in ast.walk(node) if isinstance(word, ast.Name)}
                texts.append(text[node] + "".join(shared.get(word, "") for word in words))
    pairs = {tuple(sorted((name, partner))) for name, kind in EFFECTS.items() for partner in kind.info.partners}
    missing = [pair for pair in sorted(pairs) if not any(all(f'"{name}.' in text for name in pair) for text in texts)]
    assert missing == []


def _bend_by_push(create_robot: Create, changes: dict[str, Any], setup: str, push: float, pressure: float) -> float:
    """Return the compliance of the tip to a side load [m/N] beside a push along the robot [N]."""
    robot = create_robot({**NO_GROWTH, **changes}, setup=setup)
    robot.reset(everted_length=LENGTH, pressure=pressure)
    reading = robot.advance(Command(pressure=pressure, tip_load=(1e-7, 0.0, -push)), 20.0)
    return float(reading.tip_position[0]) / 1e-7


def test_buckling_of_the_wall_goes_with_the_push_and_wrinkling_with_the_pressure(create_robot: Create) -> None:
    euler = math.pi**2 * FILM / (4.0 * LENGTH**2)
    rest = _bend_by_push(create_robot, {"axial_buckling.enabled": True}, "sheath", 0.0, 40.0 * KPA)
    for pressure in (20.0 * KPA, 40.0 * KPA):
        for wrinkles in (True, False):
            changes = {"axial_buckling.enabled": True, "wall_wrinkling.enabled": wrinkles}
            pushed = _bend_by_push(create_robot, changes, "sheath", 0.5 * euler, pressure)
            # B8's factor, whatever the pressure and whether it could wrinkle: this side load does not make it.
            assert pushed / rest == pytest.approx(1.9863, rel=0.01)


def test_buckling_answers_a_push_to_all_sides_and_anisotropy_one_side(create_robot: Create) -> None:
    compliance = {}
    for effect, changes in {
        "both": {"axial_buckling.enabled": True, "bending_anisotropy.enabled": True},
        "isotropic": {"axial_buckling.enabled": True, "bending_anisotropy.enabled": False},
    }.items():
        robot = create_robot({**changes, "robot.catheter_anisotropy": 15.0})
        for push in (0.0, 0.05):
            tip = robot.advance(Command(tip_load=(1e-6, 1e-6, -push)), 20.0).tip_position
            compliance[effect, push] = tip[:2] / 1e-6
    np.testing.assert_allclose(compliance["isotropic", 0.0][0] / compliance["isotropic", 0.0][1], 1.0, rtol=1e-3)
    np.testing.assert_allclose(compliance["both", 0.0][0] / compliance["both", 0.0][1], 15.0, rtol=1e-2)
    np.testing.assert_allclose(compliance["both", 0.05][0], compliance["isotropic", 0.05][0], rtol=1e-3)
    assert compliance["both", 0.05][0] > 1.5 * compliance["both", 0.0][0]


def test_a_push_buckles_at_the_tip_and_a_pulled_tail_buckles_in_retraction(create_grower: Create) -> None:
    """Either switch off leaves the other's buckling as it was."""
    answers = {}
    for name, changes in {
        "axial_buckling": {"retraction_buckling.length_factor": 0.0, "axial_buckling.enabled": True},
        "retraction_buckling": {"retraction_buckling.length_factor": 2.0, "axial_buckling.enabled": False},
    }.items():
        robot = create_grower({**changes, "retraction_buckling.inversion_yield_kpa": 9.9}, step_s=1.0)
        pressure = 20.0 * KPA
        robot.reset(everted_length=LENGTH, pressure=pressure)
        pulled = robot.advance(Command(tail_feed_velocity=-1e-3, pressure=pressure), 1.0)
        retracted = (pulled.buckled, pulled.everted_length < LENGTH)
        robot.reset(everted_length=LENGTH, pressure=pressure)
        euler = math.pi**2 * FILM / (4.0 * LENGTH**2)
        pushed = robot.advance(Command(pressure=pressure, tip_load=(1e-7, 0.0, -0.7 * euler)), 20.0)
        amplified = pushed.tip_position[0] > 3.0 * 1e-7 * LENGTH**3 / (3.0 * FILM)
        answers[name] = (*retracted, bool(amplified) if name == "axial_buckling" else None)
    assert answers == {"axial_buckling": (False, True, True), "retraction_buckling": (True, False, None)}


def test_burst_is_a_threshold_for_good_and_a_leak_a_share(create_robot: Create) -> None:
    pressures = {}
    for name, changes in {
        "burst_limit": {"burst_limit.pressure_kpa": 45.0},
        "pressure_leak": {"pressure_leak.share": 0.2},
    }.items():
        robot = create_robot({**NO_GROWTH, **changes}, setup="sheath")
        robot.reset(everted_length=0.05)
        steps = (20.0, 40.0, 50.0, 20.0)
        pressures[name] = [robot.advance(Command(pressure=p * KPA), 1.0).pressure / KPA for p in steps]
    assert pressures["burst_limit"] == [20.0, 40.0, 0.0, 0.0]
    np.testing.assert_allclose(pressures["pressure_leak"], [16.0, 32.0, 40.0, 16.0])


def test_leak_goes_with_the_pressure_and_tail_friction_with_the_length(create_grower: Create) -> None:
    """Both slow growth; the leak as much in a long robot, the friction as much at any pressure."""
    losses = {}
    for name, changes in {
        "pressure_leak": {"pressure_leak.share": 0.15},
        "tail_coulomb_friction": {"tail_coulomb_friction.gradient_kpa_per_mm": 0.1},
    }.items():
        for length, pressure in ((30.0, 20.0), (60.0, 20.0), (30.0, 40.0)):
            robot = create_grower({**changes, "viscous_eversion.resistance_kpa_s_mm": 20.0}, step_s=0.01)
            robot.reset(everted_length=length * MM, pressure=pressure * KPA)
            rate = robot.advance(Command(tail_feed_velocity=0.1, pressure=pressure * KPA), 0.01).growth_rate
            losses[name, length, pressure] = pressure - rate / MM * 20.0
    leak, friction = "pressure_leak", "tail_coulomb_friction"
    for name, length, pressure, expected in (
        (leak, 30.0, 20.0, 3.0),
        (leak, 60.0, 20.0, 3.0),
        (leak, 30.0, 40.0, 6.0),
        (friction, 30.0, 20.0, 3.0),
        (friction, 60.0, 20.0, 6.0),
        (friction, 30.0, 40.0, 3.0),
    ):
        assert losses[name, length, pressure] == pytest.approx(expected, rel=1e-3)


def test_catheter_leads_by_insertion_and_the_sheath_by_feed(create_grower: Create) -> None:
    """Protrusion moves the tip without growth; slip of the feed slows growth and leaves the catheter alone."""
    tips = {}
    for protrudes in (True, False):
        for slip in (0.0, 0.5):
            changes = {"catheter_protrusion.enabled": protrudes, "feed_limit.slip": slip}
            robot = create_grower({**changes, "viscous_eversion.resistance_kpa_s_mm": 1.0}, setup="full", step_s=0.01)
            robot.reset(everted_length=0.040, catheter_length=0.040, pressure=20.0 * KPA)
            command = Command(insertion_velocity=3e-3, tail_feed_velocity=4e-3, pressure=20.0 * KPA)
            reading = robot.advance(command, 2.0)
            tips[protrudes, slip] = (reading.everted_length, reading.tip_position[2])
    assert tips[True, 0.0][0] == pytest.approx(0.044, abs=1e-6)
    assert tips[True, 0.5][0] < 0.0422
    for slip in (0.0, 0.5):
        assert tips[False, slip][0] == pytest.approx(tips[True, slip][0], rel=1e-9)
        assert tips[True, slip][1] == pytest.approx(0.046, abs=1e-6)
        assert tips[False, slip][1] == pytest.approx(tips[False, slip][0], abs=1e-6)


def test_feed_bounds_the_speed_and_the_rate_law_goes_with_the_pressure(create_grower: Create) -> None:
    """Twice the feed or twice the pressure: which of them doubles the speed?"""
    rates = {}
    for name, changes in {
        "feed_limit": {"feed_limit.slip": 0.5, "viscous_eversion.resistance_kpa_s_mm": 0.01},
        "viscous_eversion": {"feed_limit.slip": 0.0, "viscous_eversion.resistance_kpa_s_mm": 20.0},
    }.items():
        for feed, pressure in ((4e-3, 20.0), (8e-3, 20.0), (4e-3, 40.0)):
            robot = create_grower(changes)
            robot.reset(everted_length=0.03, pressure=pressure * KPA)
            command = Command(tail_feed_velocity=feed, pressure=pressure * KPA)
            rates[name, feed, pressure] = robot.advance(command, 1.0).growth_rate
    doubled = {
        name: [rates[name, *case] / rates[name, 4e-3, 20.0] for case in ((8e-3, 20.0), (4e-3, 40.0))]
        for name in ("feed_limit", "viscous_eversion")
    }
    np.testing.assert_allclose(doubled["feed_limit"], [2.0, 1.0], rtol=1e-3)
    np.testing.assert_allclose(doubled["viscous_eversion"], [1.0, 2.0], rtol=1e-3)


def _record_pressure(create_grower: Create, changes: dict[str, Any], feed: float) -> np.ndarray:
    """Return the pressure [kPa] after a step of the set point from 10 to 20 kPa, every 0.05 s over 6 s."""
    changes = {"viscous_eversion.resistance_kpa_s_mm": 20.0, **changes}
    robot = create_grower(changes, step_s=0.01)
    robot.reset(everted_length=0.03, pressure=10.0 * KPA)
    command = Command(tail_feed_velocity=feed, pressure=20.0 * KPA)
    return np.array([robot.advance(command, 0.05).pressure / KPA for _ in range(120)])


def test_lag_ends_droop_stays_and_ripple_goes_on(create_grower: Create) -> None:
    """After a step of the set point: late but full; short as long as it grows; up and down about it."""
    effects: dict[str, dict[str, Any]] = {
        "pressure_lag": {"pressure_lag.time_s": 0.5},
        "pressure_droop": {"pressure_droop.resistance_kpa_s_mm": 5.0},
        "pressure_ripple": {"pressure_ripple.amplitude_kpa": 2.0, "pressure_ripple.frequency_hz": 0.5},
    }
    answers = {}
    for name, changes in effects.items():
        growing = _record_pressure(create_grower, changes, 0.1)
        still = _record_pressure(create_grower, changes, 0.0)
        late = growing[80:]
        answers[name] = (
            bool(growing[4] < 17.5 and still[4] < 17.5),  # late
            bool(abs(late.mean() - 20.0) > 1.0 and abs(still[80:].mean() - 20.0) < 0.1),  # short while it grows
            bool(np.ptp(late) > 2.0),  # goes on
        )
    assert answers == {
        "pressure_lag": (True, False, False),
        "pressure_droop": (False, True, False),
        "pressure_ripple": (False, False, True),
    }


def _lean(
    create_robot: Create, changes: dict[str, Any], gravity: tuple[float, float, float], roll_deg: float = 0.0
) -> np.ndarray:
    """Return where the tip of the assembled robot rests across the insertion [mm], shape (2,)."""
    robot = create_robot({**STILL, **changes}, setup="full", world=World.free(gravity=gravity))
    roll = math.radians(roll_deg)
    robot.reset(everted_length=LENGTH, pressure=20.0 * KPA, roll=roll)
    return robot.advance(Command(pressure=20.0 * KPA, roll=roll), 10.0).tip_position[:2] / MM


def test_weight_follows_gravity_a_set_catheter_its_roll_and_a_tense_wall_neither(create_robot: Create) -> None:
    effects: dict[str, dict[str, Any]] = {
        "saline_weight": {"saline_weight.share": 1.0},
        "pre_curvature": {"pre_curvature.curvature_1_per_m": 0.5},
        "wall_pretension": {"wall_pretension.moment_n_m": 1e-4},
    }
    answers = {}
    for name, changes in effects.items():
        start = _lean(create_robot, changes, (9.81, 0.0, 0.0))
        assert start[0] > 0.5, name
        turned = _lean(create_robot, changes, (-9.81, 0.0, 0.0))
        rolled = _lean(create_robot, changes, (9.81, 0.0, 0.0), roll_deg=180.0)
        answers[name] = [bool(np.hypot(*(other - start)) > 0.5) for other in (turned, rolled)]
    # (with gravity, with the roll of the catheter)
    assert answers == {
        "saline_weight": [True, False],
        "pre_curvature": [False, True],
        "wall_pretension": [False, False],
    }


def test_play_ends_at_its_angle_and_weight_goes_on(create_robot: Create) -> None:
    """Twice the gravity, beyond what the play's centring holds: only the elastic part doubles."""
    # The sheath's root is limp: it would hold the catheter in its play.
    play = {
        "clearance_play.angle_deg": 4.0,
        "clearance_play.centring_moment_n_m": 1e-5,
        "root_kink.pressure_share": 1e-6,
    }
    weight = {"saline_weight.share": 1.0}
    single, double = ((9.81, 0.0, 0.0), (19.62, 0.0, 0.0))
    elastic = [_lean(create_robot, weight, gravity)[0] for gravity in (single, double)]
    assert elastic[1] == pytest.approx(2.0 * elastic[0], rel=0.01)
    tilted = [_lean(create_robot, {**weight, **play}, gravity)[0] for gravity in (single, double)]
    tilt = LENGTH / MM * math.sin(math.radians(4.0))
    # 5 %: the first link tilts in place of bending.
    np.testing.assert_allclose(np.array(tilted) - elastic, tilt, rtol=0.05)


def test_windup_remembers_the_way_and_play_does_not(create_robot: Create) -> None:
    """Base at 30 deg from below and from above: where the tip's soft plane is, and where the tip."""
    answers = {}
    for name, changes in {
        "clearance_play": {"clearance_play.angle_deg": 4.0},
        "torsional_windup": {"torsional_windup.mu": 0.1},
    }.items():
        robot = create_robot({**STILL, "robot.catheter_anisotropy": 15.0, **changes}, setup="full")
        robot.reset(everted_length=LENGTH, pressure=40.0 * KPA)
        tips = []
        for roll_deg in (0.0, 30.0, 60.0, 30.0):
            command = Command(pressure=40.0 * KPA, roll=math.radians(roll_deg), tip_load=(1e-3, 0.0, 0.0))
            tips.append(robot.advance(command, 10.0).tip_position[:2] / MM)
        answers[name] = bool(np.hypot(*(tips[3] - tips[1])) > 0.01)
    assert answers == {"clearance_play": False, "torsional_windup": True}


def test_friction_of_the_tendon_opens_a_loop_and_closed_notches_none(create_robot: Create) -> None:
    """Both bend the robot less than the pull says; paid out again, only friction keeps it bent."""
    kept = {}
    for name, changes in {
        "tendon_friction": {"tendon_friction.mu": 0.2},
        "notch_closure": {"notch_closure.curvature_1_per_m": 4.0, "notch_closure.stiffness_n_m2": 2e-3},
    }.items():
        robot = create_robot(changes)
        pulls = np.concatenate([np.linspace(0.1, 3.0, 30), np.linspace(2.9, 2.0, 10)]) * MM
        bends = [float(robot.advance(Command(tendon_pull=float(pull)), 2.0).tip_position[0]) for pull in pulls]
        free = create_robot({}).advance(Command(tendon_pull=3.0 * MM), 5.0).tip_position[0]
        assert bends[29] < 0.95 * free
        kept[name] = bends[-1] / bends[19]  # at 2 mm, from above over from below
    assert kept["tendon_friction"] > 1.1
    assert kept["notch_closure"] == pytest.approx(1.0, rel=1e-6)


def test_creep_goes_on_while_it_is_held_and_backlash_does_not(create_robot: Create) -> None:
    """Both leave a bend behind; creep takes time, on the way there and back."""
    answers = {}
    for name, changes in {
        "wall_creep": {"wall_creep.share": 0.5, "wall_creep.time_s": 20.0},
        "tendon_backlash": {"tendon_backlash.backlash_mm": 0.5, "tendon_backlash.lost_motion_mm": 0.0},
    }.items():
        robot = create_robot({**STILL, "tendon_backlash.lost_motion_mm": 0.0, **changes}, setup="full")
        robot.reset(everted_length=LENGTH, pressure=20.0 * KPA)
        bends = [
            float(robot.advance(Command(pressure=20.0 * KPA, tendon_pull=pull * MM), wait).tip_position[0] / MM)
            for pull, wait in ((2.0, 2.0), (2.0, 100.0), (1.0, 2.0), (1.0, 100.0))
        ]
        answers[name] = (abs(bends[1] - bends[0]) > 0.1, abs(bends[3] - bends[2]) > 0.1)
    assert answers == {"wall_creep": (True, True), "tendon_backlash": (False, False)}


def test_compliance_lengthens_pretension_bends_and_shear_slides(create_robot: Create) -> None:
    """Under pressure without load, and under a side load: what changes of length, direction and place?"""
    effects: dict[str, dict[str, Any]] = {
        "wall_compliance": {"wall_compliance.share": 50.0},
        "wall_pretension": {"wall_pretension.eccentricity_mm": 0.2},
        "wall_shear": {"wall_shear.enabled": True},
    }

    def read(changes: dict[str, Any], load: float) -> np.ndarray:
        sheath = create_robot({**STILL, **changes}, setup="sheath")
        sheath.reset(everted_length=LENGTH, pressure=20.0 * KPA)
        reading = sheath.advance(Command(pressure=20.0 * KPA, tip_load=(load, 0.0, 0.0)), 10.0)
        return np.array([reading.everted_length, reading.tip_direction[0], reading.tip_position[0]])

    plain = read({}, 0.0)
    compliance = read({}, 1e-5)[2] / 1e-5
    answers = {}
    for name, changes in effects.items():
        change = read(changes, 0.0) - plain
        sideways = (read(changes, 1e-5)[2] - change[2]) / 1e-5 / compliance - 1.0
        answers[name] = (bool(change[0] > 1e-5), bool(abs(change[1]) > 1e-3), bool(0.0015 < sideways < 0.003))
    # (longer, bent, more compliant by Fichter's 0.2 %)
    assert answers == {
        "wall_compliance": (True, False, False),
        "wall_pretension": (False, True, False),
        "wall_shear": (False, False, True),
    }


def test_tissue_gives_way_to_a_press_and_friction_to_a_pull_along_it(
    create_robot: Create, create_plane: Callable[..., Any]
) -> None:
    """On a flat wall below: how deep a press makes it go, and whether it slides back when it is let go."""
    wall = create_plane((1.0, 0.0, 0.0), -0.5e-3 - 0.925e-3)
    results = {}
    for name, changes in {
        "contact_friction": {"contact_friction.mu_tissue": 0.5, "duct_compliance.compliance_1_per_kpa": 0.0},
        "duct_compliance": {"contact_friction.mu_tissue": 0.0, "duct_compliance.compliance_1_per_kpa": 0.1},
    }.items():
        options = {"robot.catheter_damping_time_ms": 5.0, "duct_compliance.damping_time_s": 0.0, **changes}
        robot = create_robot(options, world=World(wall=wall), step_s=0.05, tolerance_j=1e-12)
        pressed = robot.advance(Command(tip_load=(-0.02, 0.0, 0.0)), 5.0)
        robot.advance(Command(tip_load=(-0.02, 4e-3, 0.0)), 5.0)
        held = robot.advance(Command(tip_load=(-0.02, 0.0, 0.0)), 5.0)
        results[name] = (pressed.penetration_max > 0.05 * MM, abs(held.tip_position[1]) > 0.02 * MM)
    assert results == {"contact_friction": (False, True), "duct_compliance": (True, False)}
