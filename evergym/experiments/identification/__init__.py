"""Estimate the robot's parameters from the paper's figures: what is free, how it is fitted, what is left out."""

from evergym.experiments.identification.command import Identify

__all__ = ["Identify"]
