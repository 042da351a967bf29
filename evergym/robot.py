"""The robot's dimensions and materials: the ``[robot]`` table of a model file."""

from __future__ import annotations

from dataclasses import dataclass

from evergym.config import parameter

__all__ = ["RobotConfig"]


@dataclass(frozen=True)
class RobotConfig:
    """Dimensions, materials and drive limits of a robot, in the units that its model file uses.

    The defaults are the second-generation MAMMOBOT of Wu et al., RA-L 2023, doi 10.1109/LRA.2023.3234823 ("the paper").
    """

    catheter_length_mm: float = parameter(95.0, unit="mm", low=1.0, high=1000.0, source="paper, Table I")
    catheter_inner_diameter_mm: float = parameter(1.50, unit="mm", low=0.0, high=20.0, source="paper, Table I")
    catheter_outer_diameter_mm: float = parameter(1.85, unit="mm", low=0.05, high=25.0, source="paper, Table I")
    catheter_bending_stiffness_n_m2: float = parameter(
        4.23e-4,
        unit="N m^2",
        low=1e-8,
        high=1.0,
        source="elastica fit of the paper's Fig. 6, RMS 1.0 deg",
        help="Soft plane, over the flexible length; the fibres are sized to give it.",
    )
    catheter_anisotropy: float = parameter(
        15.0,
        unit="1",
        low=1.0,
        high=1000.0,
        source="uncut tube 6.5e-3 over 4.23e-4 N m^2; the measured range is 5 to 15",
        help="Stiff over soft bending stiffness.",
    )
    catheter_flexible_length_mm: float = parameter(
        95.0, unit="mm", low=0.0, high=1000.0, source="paper, Table I: the distal 95 mm are notched"
    )
    catheter_proximal_stiffness_n_m2: float = parameter(
        6.5e-3, unit="N m^2", low=1e-8, high=10.0, source="uncut nitinol tube of Table I at 20 GPa"
    )
    catheter_torsional_stiffness_n_m2: float = parameter(
        7.4e-4,
        unit="N m^2",
        low=1e-9,
        high=10.0,
        prior=True,
        source="0.15 of the uncut tube's 4.9e-3 (notched: 0.05-0.3)",
    )
    catheter_mass_g: float = parameter(0.215, unit="g", low=0.0, high=100.0, source="paper, Table I")
    catheter_damping_time_ms: float = parameter(
        5.0, unit="ms", low=0.0, high=1000.0, prior=True, help="Kelvin-Voigt relaxation time of the fibres."
    )
    tendon_arm_mm: float = parameter(
        0.75, unit="mm", low=0.01, high=20.0, source="catheter centre to the notches' neutral axis, CAD mesh (0.75-1.3)"
    )
    tendon_max_pull_mm: float = parameter(4.9, unit="mm", low=0.0, high=100.0, source="paper, Figs. 10 and 11")
    sheath_outer_diameter_mm: float = parameter(3.00, unit="mm", low=0.1, high=100.0, source="paper, Table I")
    sheath_wall_um: float = parameter(35.0, unit="um", low=1.0, high=2000.0, source="paper, Table I: 35 um")
    sheath_modulus_mpa: float = parameter(300.0, unit="MPa", low=0.1, high=1e5, source="paper, Table I: 0.3 GPa")
    sheath_material_length_mm: float = parameter(
        280.0, unit="mm", low=1.0, high=1e4, source="paper: 280 mm of material, so at most 140 mm grown"
    )
    sheath_mass_g: float = parameter(
        0.056, unit="g", low=0.0, high=100.0, source="paper, Table I (double wall over 95 mm)"
    )
    fluid_density_kg_m3: float = parameter(1005.0, unit="kg/m^3", low=0.0, high=2e4, source="physiological saline")
    feed_max_mm_s: float = parameter(
        5.8, unit="mm/s", low=0.01, high=1000.0, source="paper: bench feeds 2.9 and 5.8 mm/s"
    )
    pressure_max_kpa: float = parameter(
        50.0, unit="kPa", low=0.1, high=1e4, source="paper: much above 150 kPa absolute the sheath sometimes bursts"
    )
