"""The physical effects, one per file: its law, its parameters with units, bounds and sources, and its kernel.

A model file's ``[effects.<name>]`` sets an effect's parameters. To add an effect: write its file, add it to `Effects`
and to `EffectParameters`, and call its kernel where `evergym.stepper` lists the order.
"""

from __future__ import annotations

from evergym.effects.catalogue import EffectParameters, Effects, compile_effects

__all__ = ["EffectParameters", "Effects", "compile_effects"]
