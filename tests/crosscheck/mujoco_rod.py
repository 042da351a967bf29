"""The sag case in MuJoCo: a one-dimensional flex, whose edges are held to their length by constraints."""

from __future__ import annotations

import time

import mujoco

from tests.crosscheck.sag_case import CASE, Result, SagCase

__all__ = ["run_mujoco"]

STEP_S = 1e-4
"""The constraints' stiffness goes with it: the edges give by 20 um in sum at 2e-4 s, by 5 um at 1e-4 s."""

SETTLING_S = 0.8


def _create_model(case: SagCase, edges: int) -> mujoco.MjModel:
    # Two pinned vertices are the clamp, and the hinge at the second has the stiffness of a whole edge: half an edge
    # lies behind the clamp.
    size = case.length / (edges - 0.5)
    text = f"""
<mujoco>
  <option gravity="0 0 {-case.gravity}" timestep="{STEP_S}" integrator="discrete" solver="CG" tolerance="1e-10">
    <flag contact="disable"/>
  </option>
  <size memory="50M"/>
  <worldbody>
    <flexcomp name="rod" type="grid" dim="1" count="{edges + 1} 1 1" spacing="{size!r} 1 1" radius="{case.radius}"
        pos="{case.length - 0.5 * edges * size!r} 0 0" mass="{case.mass_per_length * size * (edges + 1)!r}" dof="full">
      <elasticity young="{case.modulus}" poisson="0.3" damping="0.03"/>
      <edge equality="true" solref="{2.0 * STEP_S} 1"/>
      <pin id="0 1"/>
      <contact selfcollide="none"/>
    </flexcomp>
  </worldbody>
</mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    # All vertices get the same mass; the last one has half an edge only.
    model.body_mass[model.flex_vertbodyid[-1]] *= 0.5
    return model


def run_mujoco(case: SagCase = CASE, edges: int = 40) -> Result:
    """Return what MuJoCo says about the rod at rest."""
    model = _create_model(case, edges)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    start = time.process_time()
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / STEP_S))
    seconds = time.process_time() - start
    along, _, up = data.flexvert_xpos[-1] * 1e3
    name = f"MuJoCo {mujoco.__version__}"
    return Result(name, "1-D flex, implicit", edges, (float(along), float(up)), seconds)
