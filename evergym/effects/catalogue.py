"""All effects of a model, by name, and their parameters as the kernels take them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

from evergym.effects.angle_quantisation import AngleQuantisation
from evergym.effects.axial_buckling import AxialBuckling, AxialBucklingParameters
from evergym.effects.bending_anisotropy import BendingAnisotropy
from evergym.effects.burst_limit import BurstLimit, BurstLimitParameters
from evergym.effects.catheter_protrusion import CatheterProtrusion
from evergym.effects.clearance_play import ClearancePlay, ClearancePlayParameters
from evergym.effects.contact_friction import ContactFriction, ContactFrictionParameters
from evergym.effects.duct_compliance import DuctCompliance, DuctComplianceParameters
from evergym.effects.eversion_yield import EversionYield, EversionYieldParameters
from evergym.effects.feed_limit import FeedLimit, FeedLimitParameters
from evergym.effects.notch_closure import NotchClosure, NotchClosureParameters
from evergym.effects.pre_curvature import PreCurvature
from evergym.effects.pressure_bias import PressureBias, PressureBiasParameters
from evergym.effects.pressure_droop import PressureDroop, PressureDroopParameters
from evergym.effects.pressure_lag import PressureLag, PressureLagParameters
from evergym.effects.pressure_leak import PressureLeak, PressureLeakParameters
from evergym.effects.pressure_ripple import PressureRipple, PressureRippleParameters
from evergym.effects.retraction_buckling import RetractionBuckling, RetractionBucklingParameters
from evergym.effects.root_kink import RootKink, RootKinkParameters
from evergym.effects.saline_weight import SalineWeight, SalineWeightParameters
from evergym.effects.tail_capstan_friction import TailCapstanFriction, TailCapstanFrictionParameters
from evergym.effects.tail_catheter_friction import TailCatheterFriction, TailCatheterFrictionParameters
from evergym.effects.tail_coulomb_friction import TailCoulombFriction, TailCoulombFrictionParameters
from evergym.effects.tendon_backlash import TendonBacklash, TendonBacklashParameters
from evergym.effects.tendon_friction import TendonFriction, TendonFrictionParameters
from evergym.effects.tendon_stretch import TendonStretch, TendonStretchParameters
from evergym.effects.torsional_windup import TorsionalWindup, TorsionalWindupParameters
from evergym.effects.viscous_eversion import ViscousEversion, ViscousEversionParameters
from evergym.effects.wall_compliance import WallCompliance, WallComplianceParameters
from evergym.effects.wall_creep import WallCreep, WallCreepParameters
from evergym.effects.wall_pretension import WallPretension, WallPretensionParameters
from evergym.effects.wall_shear import WallShear, WallShearParameters
from evergym.effects.wall_wrinkling import WallWrinkling
from evergym.robot import RobotConfig
from evergym.units import MM, MPA, UM

__all__ = ["EFFECTS", "EffectParameters", "Effects", "compile_effects"]


@dataclass(frozen=True)
class Effects:
    """The effects of a model: one field per name of the catalogue."""

    eversion_yield: EversionYield = field(default_factory=EversionYield)
    viscous_eversion: ViscousEversion = field(default_factory=ViscousEversion)
    feed_limit: FeedLimit = field(default_factory=FeedLimit)
    tail_coulomb_friction: TailCoulombFriction = field(default_factory=TailCoulombFriction)
    tail_catheter_friction: TailCatheterFriction = field(default_factory=TailCatheterFriction)
    tail_capstan_friction: TailCapstanFriction = field(default_factory=TailCapstanFriction)
    wall_wrinkling: WallWrinkling = field(default_factory=WallWrinkling)
    root_kink: RootKink = field(default_factory=RootKink)
    tendon_backlash: TendonBacklash = field(default_factory=TendonBacklash)
    tendon_stretch: TendonStretch = field(default_factory=TendonStretch)
    bending_anisotropy: BendingAnisotropy = field(default_factory=BendingAnisotropy)
    pre_curvature: PreCurvature = field(default_factory=PreCurvature)
    saline_weight: SalineWeight = field(default_factory=SalineWeight)
    pressure_lag: PressureLag = field(default_factory=PressureLag)
    burst_limit: BurstLimit = field(default_factory=BurstLimit)
    contact_friction: ContactFriction = field(default_factory=ContactFriction)
    duct_compliance: DuctCompliance = field(default_factory=DuctCompliance)
    catheter_protrusion: CatheterProtrusion = field(default_factory=CatheterProtrusion)
    retraction_buckling: RetractionBuckling = field(default_factory=RetractionBuckling)
    wall_shear: WallShear = field(default_factory=WallShear)
    axial_buckling: AxialBuckling = field(default_factory=AxialBuckling)
    tendon_friction: TendonFriction = field(default_factory=TendonFriction)
    notch_closure: NotchClosure = field(default_factory=NotchClosure)
    torsional_windup: TorsionalWindup = field(default_factory=TorsionalWindup)
    wall_pretension: WallPretension = field(default_factory=WallPretension)
    wall_creep: WallCreep = field(default_factory=WallCreep)
    wall_compliance: WallCompliance = field(default_factory=WallCompliance)
    pressure_droop: PressureDroop = field(default_factory=PressureDroop)
    pressure_ripple: PressureRipple = field(default_factory=PressureRipple)
    pressure_leak: PressureLeak = field(default_factory=PressureLeak)
    pressure_bias: PressureBias = field(default_factory=PressureBias)
    angle_quantisation: AngleQuantisation = field(default_factory=AngleQuantisation)
    clearance_play: ClearancePlay = field(default_factory=ClearancePlay)


EFFECTS: dict[str, type[Any]] = {entry.name: type(getattr(Effects(), entry.name)) for entry in fields(Effects)}
"""Every effect of the catalogue: its class, whose `info` says what it does, by name."""


class EffectParameters(NamedTuple):
    """SI parameters of the effects that have a kernel (the others shape the lattice, see `evergym.lattice`)."""

    eversion_yield: EversionYieldParameters
    viscous_eversion: ViscousEversionParameters
    feed_limit: FeedLimitParameters
    tail_coulomb_friction: TailCoulombFrictionParameters
    tail_catheter_friction: TailCatheterFrictionParameters
    tail_capstan_friction: TailCapstanFrictionParameters
    root_kink: RootKinkParameters
    tendon_backlash: TendonBacklashParameters
    tendon_stretch: TendonStretchParameters
    saline_weight: SalineWeightParameters
    pressure_lag: PressureLagParameters
    burst_limit: BurstLimitParameters
    contact_friction: ContactFrictionParameters
    duct_compliance: DuctComplianceParameters
    retraction_buckling: RetractionBucklingParameters
    wall_shear: WallShearParameters
    axial_buckling: AxialBucklingParameters
    tendon_friction: TendonFrictionParameters
    notch_closure: NotchClosureParameters
    torsional_windup: TorsionalWindupParameters
    wall_pretension: WallPretensionParameters
    wall_creep: WallCreepParameters
    wall_compliance: WallComplianceParameters
    pressure_droop: PressureDroopParameters
    pressure_ripple: PressureRippleParameters
    pressure_leak: PressureLeakParameters
    pressure_bias: PressureBiasParameters
    clearance_play: ClearancePlayParameters


def compile_effects(effects: Effects, robot: RobotConfig) -> EffectParameters:
    """Return the SI parameters of ``effects`` on ``robot``."""
    radius = 0.5 * robot.sheath_outer_diameter_mm * MM
    wall = robot.sheath_wall_um * UM
    modulus = robot.sheath_modulus_mpa * MPA
    poisson_ratio = effects.retraction_buckling.wall_poisson_ratio
    return EffectParameters(
        eversion_yield=effects.eversion_yield.compile(),
        viscous_eversion=effects.viscous_eversion.compile(),
        feed_limit=effects.feed_limit.compile(),
        tail_coulomb_friction=effects.tail_coulomb_friction.compile(),
        tail_catheter_friction=effects.tail_catheter_friction.compile(),
        tail_capstan_friction=effects.tail_capstan_friction.compile(),
        root_kink=effects.root_kink.compile(),
        tendon_backlash=effects.tendon_backlash.compile(),
        tendon_stretch=effects.tendon_stretch.compile(),
        saline_weight=effects.saline_weight.compile(),
        pressure_lag=effects.pressure_lag.compile(),
        burst_limit=effects.burst_limit.compile(),
        contact_friction=effects.contact_friction.compile(),
        duct_compliance=effects.duct_compliance.compile(),
        retraction_buckling=effects.retraction_buckling.compile(radius, wall, modulus),
        wall_shear=effects.wall_shear.compile(radius, wall, modulus, poisson_ratio),
        axial_buckling=effects.axial_buckling.compile(),
        tendon_friction=effects.tendon_friction.compile(),
        notch_closure=effects.notch_closure.compile(),
        torsional_windup=effects.torsional_windup.compile(),
        wall_pretension=effects.wall_pretension.compile(),
        wall_creep=effects.wall_creep.compile(),
        wall_compliance=effects.wall_compliance.compile(radius, wall, modulus, poisson_ratio),
        pressure_droop=effects.pressure_droop.compile(),
        pressure_ripple=effects.pressure_ripple.compile(),
        pressure_leak=effects.pressure_leak.compile(),
        pressure_bias=effects.pressure_bias.compile(),
        clearance_play=effects.clearance_play.compile(),
    )
