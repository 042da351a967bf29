"""Independent simulators say what ours says about a sagging rod; skipped where they are not installed."""

from __future__ import annotations

import pytest

from tests.crosscheck.sag_case import CASE, EXACT_TIP_MM, SagCase, run_evergym, solve_elastica

MISSING = "{} is not installed: pip install -c constraints.txt -e '.[crosscheck]'"


def test_exact_answer_is_that_of_the_elastica() -> None:
    assert solve_elastica() == pytest.approx(EXACT_TIP_MM, abs=1e-4)  # the digits given


def test_evergym_agrees_with_the_exact_answer() -> None:
    coarse, fine = run_evergym(links=10), run_evergym(links=20)
    exact = solve_elastica()
    assert fine.tip_mm == pytest.approx(exact, abs=1e-3)  # 20 links: 0.3 um
    # Second order: a quarter of the error with half the links' length.
    ratio = (coarse.tip_mm[1] - exact[1]) / (fine.tip_mm[1] - exact[1])
    assert ratio == pytest.approx(4.0, rel=0.2)


def test_evergym_follows_the_case() -> None:
    """A rod that is 1 % stiffer sags less, by as much as in closed form."""
    case = SagCase(modulus=1.01 * CASE.modulus)
    assert run_evergym(case).tip_mm == pytest.approx(solve_elastica(case), abs=1e-3)
    assert solve_elastica(case)[1] - EXACT_TIP_MM[1] > 0.1


@pytest.mark.slow
def test_pyelastica_agrees() -> None:
    pytest.importorskip("elastica", reason=MISSING.format("PyElastica"))
    from tests.crosscheck.pyelastica_rod import run_pyelastica

    # Shear and stretch, which ours leaves out, add 3 (r / L)^2 of the sag: 4 um.
    assert run_pyelastica().tip_mm == pytest.approx(run_evergym().tip_mm, abs=5e-3)


@pytest.mark.slow
def test_mujoco_agrees() -> None:
    pytest.importorskip("mujoco", reason=MISSING.format("MuJoCo"))
    from tests.crosscheck.mujoco_rod import run_mujoco

    # Its edges are held to their length by soft constraints (see STEP_S), 40 of them.
    assert run_mujoco().tip_mm == pytest.approx(run_evergym().tip_mm, abs=0.015)
